"""Files that a user names to be written never lie over what must stay."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import rooms
from click.testing import CliRunner
from PIL import Image

from rsa_data.cli.main import cli

KNOWN = ["--known", "2,2,2", "--known", "9,9,3"]


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A photo, its relative depth, and a work dir with a head's folder."""
    monkeypatch.chdir(tmp_path)
    colours = np.random.default_rng(0).integers(0, 255, (12, 16, 3), np.uint8)
    for folder in ("photos", "relative"):
        (tmp_path / folder).mkdir()
    Image.fromarray(colours).save("photos/my.png")
    relative = np.linspace(9, 1, 12 * 16, dtype=np.float32).reshape(12, 16)
    np.save("relative/my.npy", relative)
    rooms.made(tmp_path / "work", parts=1, rows=2)
    (tmp_path / "work" / "heads" / "own").mkdir(parents=True)
    (tmp_path / "work" / "heads" / "own" / "head.json").write_text("{}")
    (tmp_path / "link.png").symlink_to("photos/my.png")
    return tmp_path


def content(place: Path) -> dict[str, bytes]:
    files = (path for path in place.rglob("*") if path.is_file())
    return {str(path.relative_to(place)): path.read_bytes() for path in files}


def predict(*words: str):
    told = ["predict", "photos/my.png", "--relative", "relative/my.npy", *KNOWN, *words]
    return CliRunner().invoke(cli, told)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "photos/my.png"], "expected a file that is not read in the same call"),
        (["--out", "photos/../photos/my.png"], "expected a file that is not read"),
        (["--out", "link.png"], "expected a file that is not read"),
        (["--out", "relative/my.npy"], "expected a file that is not read"),
        (["--out", "relative"], "output file relative/my.npy: expected a file that is not read"),
        (
            ["--out", "photos", "--kind", "png"],
            "output file photos/my.png: expected a file that is not read",
        ),
        (["--out", "work/heads/own/x.npy"], "work/heads, which a work dir keeps"),
        (["--out", "work/rooms"], "found the folder of a dataset, "),
        (["--out", "work/logs/x"], "work/logs, which a work dir keeps"),
        (["--out", "a.xyz"], "expected a file .npy, .png, .ply, .glb, or a folder; .xyz"),
        (["--out", "/dev/null"], "found a pipe, socket or device"),
        (["--out", ""], "expected a path; found nothing"),
        (["--work", "", "--head", "own"], "--work: expected the name of a folder in UTF-8"),
        (["--range", "1_0,2_0"], "--range: expected near,far in metres; found '1_0,2_0'"),
        (["--range", "1e-320,2"], "expected near below far, both 0.001 m (1 mm) to 100,000 m"),
        (["--known", "3,3,1e-320"], "expected a distance of 0.001 m"),
        (["--known", "3,3,\u0662"], "--known: expected u,v,metres"),
        (["--intrinsics", "1e-320,1e-320,0,0"], "focal lengths of at least 1 px"),
        (["--fov", "6_0"], "expected a number, 1 to 179; found '6_0'"),
        (["--smooth", "1_0"], "expected a whole number"),
    ],
)
def test_predict_refuses_before_it_writes(place, words, said):
    before = content(place)
    done = predict(*words)
    told = done.output + str(done.exception)
    assert done.exit_code != 0 and said in told, told
    assert content(place) == before


def test_a_folder_of_photos_takes_other_files_again_and_again(place):
    before = content(place)
    for _ in range(2):
        done = predict("--out", "photos", "--ply", "--colours")
        assert done.exit_code == 0, done.output
    new = {"photos/my.npy", "photos/my.ply", "photos/my-colours.png"}
    assert content(place).keys() - before.keys() == new
    assert {name: content(place)[name] for name in before} == before


@pytest.mark.parametrize(
    "words",
    [
        ["report", "--out", "work/heads/own/head.html"],
        ["report", "--out", "work/rooms/samples/x.html"],
        ["show", "rooms/train/000/00000", "--out", "work/rooms/x.png"],
        ["export", "--out", "work/rooms/exported"],
        ["export-head", "own", "work/heads/other"],
        ["export-head", "own", "work/heads/other.safetensors"],
        ["models", "check", "--out", "work/heads/own/head.json"],
    ],
)
def test_no_command_writes_into_what_a_work_dir_keeps(place, words):
    before = content(place)
    # Another one than that of --work is safe too.
    shutil.copytree("work", "other")
    work = [] if words[0] == "models" else ["--work", "other"]
    done = CliRunner().invoke(cli, [*words, *work])
    assert done.exit_code != 0 and "outside of the tables and heads of a work dir" in str(
        done.exception
    ), done.output
    shutil.rmtree("other")
    assert content(place) == before
