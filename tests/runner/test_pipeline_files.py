"""Pipeline files: checked whole before anything is loaded or written."""

import pytest

from rsa_data.common.errors import UsageError
from rsa_data.common.files import shipped
from rsa_data.runner import pipeline_docs, pipeline_files

SHIPPED = sorted(path.stem for path in shipped("pipelines").glob("*.toml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_jobs_load_and_say_what_they_are_for(name):
    pipeline = pipeline_files.load(pipeline_files.Path(name))
    assert pipeline.doc and pipeline.datasets
    assert (name, dict(pipeline_docs.described())[name]) in pipeline_docs.described()


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
        (
            "[dataset.nyuv2]\n[captions]\nvariants = 'x'\n",
            "variants: expected a whole number, .*found 'x'",
        ),
        ("[dataset.nyuv2.embedd]\nx = 1\n", "unknown stage in .dataset.nyuv2. 'embedd'"),
        ("[dataset.nyuv2]\n[[train-head]]\nname = 'a'\n[[train-head]]\nlrr = 1\n", "'lr'"),
        ("[dataset", "not a TOML file"),
    ],
    ids=lambda value: None if value.startswith("[") else value[:20],
)
def test_mistakes_are_named_before_anything_runs(tmp_path, text, message):
    with pytest.raises(UsageError, match=message):
        pipeline_files.load(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "changes", "reason"),
    [
        ("[[dataset.a]]", {}, "dataset.a: expected an object, found "),
        ("dataset = 1", {}, "dataset: expected an object, found 1"),
        ("[dataset.a]\nbuilder = 1", {}, "dataset.a.builder: expected text, found 1"),
        ("[dataset.folder]\n[[embed]]\nencoder = 1", {}, "encoder: expected str, found 1"),
        (
            "[dataset.folder]\n[[captions]]\n[[captions]]\ndigits = 0",
            {},
            "dataset.folder.captions: expected tables of different names, found 'occupancy' twice",
        ),
        (
            "[dataset.folder]\n[[captions]]\n[[captions]]\nstyle = 'counts'",
            {"captions.style": "x"},
            r"expected which of the 2 tables \[\[captions\]\].*such as captions.0.style",
        ),
        (
            "[dataset.folder]\n[[captions]]\n",
            {"captions.1.style": "x"},
            "expected a number from 0 to 0, found 1",
        ),
        ("[dataset.folder]\n[train-head]\nname.x = 1", {}, "train-head: name: expected str"),
        ("evaluate = [1]\n[dataset.folder]", {}, r"evaluate\[0\]: expected an object, found 1"),
        ("doc = 'x'\n[dataset.folder]", {"doc.x.y": 1}, "expected doc to be a table, found 'x'"),
    ],
)
def test_tables_of_another_kind_are_named(tmp_path, text, changes, reason):
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(UsageError, match=reason):
        pipeline_files.load(tmp_path / "job.toml", changes)


def test_an_unknown_job_gets_the_nearest():
    with pytest.raises(UsageError, match="Did you mean '7scenes'"):
        pipeline_files.load(pipeline_files.Path("7scene"))


def test_changes_are_put_over_the_file(tmp_path):
    path = written(tmp_path, "[dataset.nyuv2]\n[captions]\nvariants = 3\n")
    changes = {"captions.variants": "5", "dataset.nyuv2.root": "/data"}
    entry = pipeline_files.load(path, changes).datasets["nyuv2"]
    assert [one.options["variants"] for one in entry.stages] == [5]
    assert (entry.root, entry.options) == ("/data", {})
    with pytest.raises(UsageError, match="unknown option 'varants'"):
        pipeline_files.load(path, {"captions.varants": "5"})


def test_several_tables_of_one_stage(tmp_path):
    text = """
    [dataset.nyuv2]
    [[dataset.nyuv2.captions]]
    style = "classes"
    [dataset.kitti]
    [dataset.kitti.captions]
    variants = 2
    [[captions]]
    [[captions]]
    digits = 0
    label = "whole-percent"
    [embed]
    """
    found = pipeline_files.load(written(tmp_path, text), {"captions.1.digits": "1"}).datasets
    told = {
        name: [(s.stage.name, s.label, s.options.get("variants")) for s in entry.stages]
        for name, entry in found.items()
    }
    nyu = [("captions", None, 5), ("captions", "whole-percent", 5), ("captions", None, 5)]
    kitti = [("captions", None, 2), ("captions", "whole-percent", 2)]
    embed = ("embed", None, None)
    assert told == {"nyuv2": [*nyu, embed], "kitti": [*kitti, embed]}
    assert [s.options.get("digits") for s in found["kitti"].stages] == [2, 1, None]
