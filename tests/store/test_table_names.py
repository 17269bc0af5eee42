"""Names that become folders: none leads out of the work dir, or to what it keeps for itself."""

import pytest
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.store.table_names import check_dataset_name, is_name
from rsa_data.store.tables import WorkDir

BAD = [
    "",
    ".",
    "..",
    "../esc",
    "a/b",
    "a\\b",
    "_x",
    ".x",
    "-x",
    "~",
    " x",
    "x ",
    "x.",
    "a:b",
    "a\n",
    "*",
]
BAD += ["\x1b[31m", "\u202e", "x" * 201, "\u00e9" * 101, "\ud800"]
GOOD = [
    "nyuv2",
    "7scenes",
    "nyuv2-labeled",
    "my photos",
    "hf-all-MiniLM-L6-v2",
    "café",
    "写真",
    "a.b",
]


@pytest.mark.parametrize("name", BAD)
def test_bad_names(tmp_path, name):
    assert not is_name(name)
    with pytest.raises(UsageError, match="dataset: expected a plain name"):
        WorkDir(tmp_path).table(name, "samples")


@pytest.mark.parametrize("name", GOOD)
def test_good_names(name):
    assert check_dataset_name(name) == name


@pytest.mark.parametrize("name", ["heads", "comparisons", "logs"])
def test_what_a_work_dir_keeps_for_itself_is_no_dataset(name):
    with pytest.raises(UsageError, match="which a work dir keeps for itself"):
        check_dataset_name(name)


@pytest.mark.parametrize("name", ["../esc", "heads", "_x", "a/b", ".."])
def test_datasets_stay_inside(tmp_path, name):
    (tmp_path / "images").mkdir()
    (tmp_path / "images/a.png").write_bytes(b"never read")
    work = tmp_path / "work"
    words = ["captions", "--dataset", f"folder:{name}", "--root", str(tmp_path / "images")]
    result = CliRunner().invoke(cli, [*words, "--work", str(work)])
    assert isinstance(result.exception, UsageError), result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["images"]


@pytest.mark.parametrize("name", ["../esc", "a/b", "..", "", "_x"])
@pytest.mark.parametrize(
    "words",
    [
        ["train-head", "--name"],
        ["evaluate", "--head"],
        ["robustness", "--head"],
        ["compare", "--name"],
        ["import-head", "nowhere.pt", "--name"],
    ],
)
def test_heads_and_comparisons_stay_inside(tmp_path, words, name):
    (tmp_path / "work").mkdir()
    result = CliRunner().invoke(cli, [*words, name, "--work", str(tmp_path / "work")])
    assert isinstance(result.exception, RsaDataError), result.output
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["work"]
