"""A work dir with a trained head, shared by the tests of evaluation."""

import shutil

import pytest
from evaluated import FAST, images
from flat import evaluate, train_head

from rsa_data.store.tables import WorkDir


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    work = WorkDir(tmp_path_factory.mktemp("work"))
    images(work, "nyuv2", 64, "train")
    images(work, "nyuv2", 16, "test", first_part=1)
    train_head(work, epochs=10, **FAST)
    return work.store.location


@pytest.fixture(scope="session")
def evaluated(trained, tmp_path_factory):
    place = tmp_path_factory.mktemp("evaluated") / "work"
    shutil.copytree(trained, place)
    evaluate(WorkDir(place))
    return place


@pytest.fixture
def measured(evaluated, tmp_path) -> WorkDir:
    """A head with its evaluation."""
    shutil.copytree(evaluated, tmp_path / "measured")
    return WorkDir(tmp_path / "measured")


@pytest.fixture
def work(trained, tmp_path) -> WorkDir:
    shutil.copytree(trained, tmp_path / "work")
    return WorkDir(tmp_path / "work")
