"""Heads that read objects: a set in any order and of any size, none included."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
import torch

from rsa_data.heads.checkpoint import build_network
from rsa_data.heads.inputs.objects import NUMBERS, Objects, numbers, of_table
from rsa_data.registry import HEADS, resolve
from rsa_data.store import schemas

DIM = 5 + len(NUMBERS)
SETS = [name for name in HEADS if "object" in name and not name.startswith(("text", "image"))]


@pytest.fixture
def images() -> Objects:
    """Three images: two objects, none, three."""
    rng = np.random.default_rng(0)
    share, center = rng.uniform(0.01, 0.5, 5), rng.uniform(size=(5, 2))
    center[3] = np.nan
    about = numbers(share, center, np.array([1, 0, 1, 1, 0], bool))
    names = rng.normal(size=(4, 5)).astype(np.float32)
    return Objects(
        names, np.array([0, 1, 2, 0, 3]), about, np.array([0, 2, 2, 5]), np.ones(3, bool)
    )


def outputs(name: str, rows: np.ndarray) -> torch.Tensor:
    torch.manual_seed(0)
    network = build_network({"name": name, "object_dim": DIM}, DIM).eval()
    return torch.stack(network(torch.from_numpy(rows)), 1)


@pytest.mark.parametrize("name", SETS)
def test_neither_order_nor_padding_matters(name, images):
    rows = images.rows(np.arange(3), np.zeros(3))
    assert rows.shape == (3, 3 * DIM)
    whole = outputs(name, rows)
    assert whole.isfinite().all() and (whole > 0).all()
    other = rows.reshape(3, 3, DIM)[:, [2, 0, 1]].reshape(3, -1)
    torch.testing.assert_close(outputs(name, other), whole)
    alone = [outputs(name, images.rows(np.array([i]), np.zeros(1)))[0] for i in range(3)]
    torch.testing.assert_close(torch.stack(alone), whole)


def test_what_a_head_does_not_read_does_not_move_it(images):
    rows = images.rows(np.arange(3), np.zeros(3)).reshape(3, 3, DIM)
    moved, resized = rows.copy(), rows.copy()
    moved[:2, :2, 5 + 3 : 5 + 5] += 0.2
    resized[:2, :2, 5 + 1] *= 0.5
    for name, blind in (
        ("objects", ()),
        ("objects-without-places", (moved,)),
        ("object-names", (moved, resized)),
    ):
        plain = outputs(name, rows.reshape(3, -1))
        for other in (moved, resized):
            same = torch.equal(outputs(name, other.reshape(3, -1)), plain)
            assert same == any(other is b for b in blind)


@pytest.mark.parametrize("name", SETS)
def test_the_set_is_the_last_of_the_inputs(name):
    cls = resolve("head", HEADS, name)
    before = [SimpleNamespace(width=7, objects=1) for _ in cls.reads[:-1]]
    sizes = cls.sizes([*before, SimpleNamespace(width=DIM, objects=1)])
    network = build_network({"name": name, **sizes}, 7 * len(before) + DIM)
    assert sizes == {"object_dim": DIM} and network.before == 7 * len(before)


def test_a_part_in_which_nothing_is_named_joins_others(images):
    nothing = {
        "sample_id": ["a", "b"],
        "status": ["ok", "failed"],
        **{name: [[], []] for name in ("name", "share", "is_thing", "new_name", "new_feature")},
        **{name: [None, None] for name in ("error", "center")},
    }
    empty = of_table(pa.chunked_array([["b", "a"]]), schemas.from_columns("objects", nothing))
    assert empty.names.size == 0 and empty.there.tolist() == [False, True]
    assert empty.width == len(NUMBERS)  # a part without a name does not know how long features are


def test_a_part_keeps_the_names_that_it_uses(images):
    last = images.take(np.array([2]))
    assert len(last.names) == 3 and last.width == DIM
    both = images.take(np.array([0, 1])).joined([last])
    np.testing.assert_array_equal(
        both.rows(np.arange(3), np.zeros(3)), images.rows(np.arange(3), np.zeros(3))
    )


def test_what_is_hidden_and_a_list_that_does_not_count(images):
    twice = images.take(np.array([0, 0])).joined([images])
    names = [twice.name[a:b].tolist() for a, b in pairwise(twice.first)]
    again = Objects(
        twice.names,
        np.concatenate([n + n for n in names]).astype(np.int64),
        np.concatenate([np.tile(twice.numbers[a:b], (2, 1)) for a, b in pairwise(twice.first)]),
        2 * twice.first,
        twice.there,
    )
    once = again.once()
    for mine, theirs in zip(
        (once.name, once.numbers, once.first), (twice.name, twice.numbers, twice.first), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    about = dict(zip(NUMBERS, images.hidden(shares=True).numbers.T, strict=True))
    assert not any(about[name].any() for name in ("log share", "share", "share known"))
    assert about["place known"].any() and about["there"].all()
    places = dict(zip(NUMBERS, images.hidden(places=True).numbers.T, strict=True))
    assert not any(places[name].any() for name in ("x", "y", "place known"))
    assert places["share known"].all()
    # What is hidden is what the heads that never see it are blind to.
    every = np.arange(3), np.zeros(3)
    for name, hidden in (
        ("objects-without-places", images.hidden(places=True)),
        ("object-names", images.hidden(shares=True, places=True)),
    ):
        assert torch.equal(outputs(name, hidden.rows(*every)), outputs(name, images.rows(*every)))
