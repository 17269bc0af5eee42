"""docs/paper.md: its runs, on small made data, give every line that its table promises.

The models whose weights are not at hand are stood in for: CLIP's text tower by a tiny one, image
encoders by thumbnails, depth models and MaskDINO by graphs of a few operations.
"""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import numpy as np
import paper_data
import pytest
from click.testing import CliRunner

from rsa_data import ScaleHead, registry
from rsa_data.cli.main import cli
from rsa_data.store.tables import WorkDir

PAGE = (Path(__file__).parents[1] / "docs" / "paper.md").read_text("utf-8")
PAPER = tomllib.loads(
    (Path(registry.__file__).parent / "evaluation" / "paper.toml").read_text("utf-8")
)
RUNS = dict(re.findall(r"<!-- run: (\S+) -->\n```bash\nrsa-data (.*?)\n```", PAGE, re.DOTALL))
TABLE = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.partition("| row of the paper or its rebuttal |")[2].splitlines()[2:]
    if line.startswith("|")
]
ROWS = TABLE[: next((n for n, row in enumerate(TABLE) if len(row) != 3), len(TABLE))]
# One epoch of each training is enough to see that a line comes out.
_TRAIN = "--set train-head.epochs=1 --set train-head.threads=1 --set embed.runtime=torch"
_COMPARE = "--set compare.epochs=1 --set compare.threads=1"
FEWER = {
    "run paper-tables": f"{_TRAIN} {_COMPARE}",
    "run paper-detector": f"{_TRAIN} {_COMPARE}",
    # The made scene of DDAD has a camera of another name.
    "run paper-zero-shot": f"{_TRAIN} --set dataset.ddad.cameras=CAM",
    "run paper-human": "--set embed.runtime=torch",
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder as the page wants it, in which its runs are typed."""
    folder = tmp_path_factory.mktemp("paper")
    paper_data.write_paper(folder / "data")
    for name in ("RSA", "human.json", "sun3d_test.txt"):
        shutil.move(folder / "data" / name, folder / name)
    models = {"depth-anything-small": 0.3, "midas": 0.2, "dpt_nyu": 0.4, "dpt_kitti": 0.1}
    for name, gain in models.items():
        paper_data.write_depth_model(folder / f"{name}.onnx", gain)
    paper_data.write_maskdino(folder / "maskdino.onnx")
    for model in ("zerodepth", "zoedepth"):
        patterns = {"nyuv2": "official_splits/**/rgb*.jpg", "kitti": "2011*/**/*.png"}
        for dataset, pattern in patterns.items():
            root = folder / "data" / dataset
            for image in root.glob(pattern):
                path = (folder / model / dataset / image.relative_to(root)).with_suffix(".npy")
                path.parent.mkdir(parents=True, exist_ok=True)
                np.save(path, np.full((375, 1242) if dataset == "kitti" else (48, 64), 3.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        patch.setitem(registry.ENCODERS, "clip-rn50", "paper_data:TEXTS")
        for name in ("clip-rn50", "hf"):
            patch.setitem(registry.IMAGE_ENCODERS, name, registry.IMAGE_ENCODERS["thumbnail"])
        yield folder


def run(name: str) -> str:
    """What a run of the page says."""
    words = shlex.split(RUNS[name].replace("\\\n", " "))
    return typed(words + shlex.split(FEWER.get(" ".join(words[:2]), "")))


def typed(words: list[str]) -> str:
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def lines(said: str, dataset: str) -> set[str]:
    """The methods of a dataset in the summaries."""
    found = re.findall(rf"^{dataset}  +(.*?)  +\d+  ", said, re.MULTILINE)
    return {method.strip() for method in found}


def promised(name: str) -> list[tuple[str, str]]:
    """(row of the paper, line) of the table's rows that a run makes."""
    return [
        (row, line.strip())
        for row, runs, made in ROWS
        if name in runs.split(", ")
        for line in made.split(";")
    ]


def check(name: str, said: str, *datasets: str) -> None:
    assert promised(name)
    for dataset in datasets:
        missing = {line for _, line in promised(name)} - lines(said, dataset)
        assert not missing, f"{dataset}: {missing} not among {lines(said, dataset)}"


def test_the_table_has_every_row_of_the_paper_and_every_run():
    told = " ".join(row for row, _, _ in ROWS)
    assert {row["method"] for row in PAPER["row"]} - {"RSA, zero-shot"} <= {r for r, _, _ in ROWS}
    for word in ("SUN3D", "SUN RGB-D", "DDAD", "VOID", "table 4", "table 5", "table 7"):
        assert word in told
    assert {run for _, runs, _ in ROWS for run in runs.split(", ")} == set(RUNS)
    assert len(ROWS) == 36


@pytest.mark.slow
def test_tables(place):
    said = run("tables")
    ours = [line for row, line in promised("tables") if row != "RSA, zero-shot: VOID"]
    for dataset in ("nyuv2", "kitti"):
        here = lines(said, dataset)
        # Trained on one of the two is zero-shot on the other.
        own = {line for line in ours if "alone" not in line and "described as" not in line}
        own |= {
            f"text, {dataset} alone",
            "indoor described as outdoor" if dataset == "nyuv2" else "outdoor described as indoor",
        }
        assert own <= here, own - here
    assert "text (zero-shot)" in lines(said, "void")
    assert "number of test images is 3 here, 654 there" in said


@pytest.mark.slow
def test_what_is_added_to_the_tables(place):
    if not (place / "work").is_dir():
        run("tables")
    check("llava", run("llava"), "nyuv2", "kitti")
    check("human", run("human"), "nyuv2")
    check("others", run("others"), "nyuv2", "kitti")
    assert re.search(r"^scale \S+  shift \S+", run("single"), re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recipe", "more"), [("rsa-paper", "--set train-head.redraw=true"), ("rsa-release", "")]
)
def test_recipes(place, recipe, more):
    words = f"run {recipe} --work work-{recipe} --set depth.depth_weights=depth-anything-small.onnx"
    said = typed(shlex.split(f"{words} {_TRAIN} {more}"))
    assert "head" in lines(said, "kitti") and "head" in lines(said, "void")
    about = ScaleHead.load(f"work-{recipe}/heads/{recipe}").description["options"]
    told = about.get("redraw"), about.get("batches"), about["balance"], about["pixels"]
    expected = {
        "rsa-paper": (True, None, "images", 256),
        "rsa-release": (None, "each", "pixels", 0),
    }
    assert told == expected[recipe]


@pytest.mark.slow
def test_detector(place):
    check("detector", run("detector"), "nyuv2", "kitti")


@pytest.mark.slow
def test_zero_shot(place):
    said = run("zero-shot")
    check("zero-shot", said, "nyuv2", "kitti", "void", "sun3d", "sunrgbd", "ddad")
    assert "Zero-shot (the head was not trained on it): sunrgbd, sun3d, ddad." in said


@pytest.mark.slow
@pytest.mark.parametrize(("name", "files"), [("midas", 1), ("dpt", 2)])
def test_other_depth_models(place, name, files):
    said = run(name)
    ours = {line for _, line in promised(name) if "alone" not in line}
    for dataset in ("nyuv2", "kitti"):
        assert ours | {f"text, {dataset} alone"} <= lines(said, dataset)
    work = WorkDir(f"work-{name}")
    tables = [work.table(d, t) for d in ("nyuv2", "kitti") for t in work.tables(d) if "depth/" in t]
    assert len({table.description().files["model"] for table in tables}) == files
