"""Job files: checked whole before anything is loaded or written."""

import pytest

from rsa_data import jobs, tables
from rsa_data.errors import UsageError

SHIPPED = sorted(path.stem for path in tables.shipped("pipelines").glob("*.toml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_jobs_load_and_say_what_they_are_for(name):
    job = jobs.load(jobs.Path(name))
    assert job["doc"] and job["dataset"]
    assert (name, dict(jobs.described())[name]) in jobs.described()


def written(tmp_path, text):
    path = tmp_path / "job.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[dataset.nyuv2]\n[caption]\n", r"unknown table 'caption'. Did you mean 'captions'\?"),
        ("[captions]\n", r"expected at least one \[dataset.NAME\]; found none"),
        ("[dataset.nyu2]\n", r"unknown dataset 'nyu2'. Did you mean 'nyuv2'\?"),
        ("[dataset.nyuv2]\n[captions]\nvariant = 3\n", "Did you mean 'variants'"),
        ("[dataset.nyuv2]\n[captions]\nvariants = 'x'\n", "variants: expected int, found 'x'"),
        ("[dataset.nyuv2.embedd]\nx = 1\n", "unknown stage in .dataset.nyuv2. 'embedd'"),
        ("[dataset.nyuv2]\n[[train-head]]\nname = 'a'\n[[train-head]]\nlrr = 1\n", "'lr'"),
        ("[dataset", "not a TOML file"),
    ],
    ids=lambda value: None if value.startswith("[") else value[:20],
)
def test_mistakes_are_named_before_anything_runs(tmp_path, text, message):
    with pytest.raises(UsageError, match=message):
        jobs.load(written(tmp_path, text))


def test_an_unknown_job_gets_the_nearest():
    with pytest.raises(UsageError, match="Did you mean '7scenes'"):
        jobs.load(jobs.Path("7scene"))


def test_changes_are_put_over_the_file(tmp_path):
    path = written(tmp_path, "[dataset.nyuv2]\n[captions]\nvariants = 3\n")
    job = jobs.load(path, {"captions.variants": "5", "dataset.nyuv2.root": "/data"})
    assert job["captions"] == {"variants": "5"}
    assert job["dataset"]["nyuv2"] == {"root": "/data"}
    with pytest.raises(UsageError, match="unknown option 'varants'"):
        jobs.load(path, {"captions.varants": "5"})
