"""Labels: several tables of one stage side by side, chosen by name."""

import pytest
import rooms
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.store.tables import WorkDir


def call(work: object, *words: str, status: int = 0) -> str:
    result = CliRunner().invoke(cli, [*words, "--work", str(work)])
    if status:
        assert isinstance(result.exception, Exception), result.output
        return str(result.exception)
    assert result.exit_code == 0, result.output + str(result.exception)
    return result.output


def test_two_wordings_of_one_style_side_by_side(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    captions = ("captions", "--dataset", "rooms", "--segments", "labels", "--variants", "1")
    call(tmp_path, *captions)
    call(tmp_path, *captions, "--digits", "0", "--label", "whole-percent")
    texts = [
        work.table("rooms", f"captions/{label}").read(0)["text"][1].as_py()
        for label in ("occupancy", "whole-percent")
    ]
    assert "10.00%" in texts[0] and "10%" in texts[1]
    # Without the label the options of the first table hold, and are refused if they differ.
    assert "options.digits" in call(tmp_path, *captions, "--digits", "0", status=1)
    out = call(tmp_path, "verify", "--recompute", "1")
    assert "no problems" in out and out.count(": the same") == 2
    assert "captions/whole-percent" in call(tmp_path, "status")
    assert call(tmp_path, "retry-failed") == ""
    # The label names the table; it is not what the content follows from.
    about = work.table("rooms", "captions/whole-percent").description()
    assert "whole-percent" not in str(about)


def test_segments_are_chosen_by_their_label(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    store = work.store
    other = work.table("rooms", "segments/background")
    for name in store.list("rooms/segments/labels"):
        store.write(f"{other.path}/{name}", store.read(f"rooms/segments/labels/{name}") or b"")
    captions = ("captions", "--dataset", "rooms", "--variants", "1")
    call(tmp_path, *captions, "--segments", "background", "--label", "of-background")
    about = work.table("rooms", "captions/of-background").description()
    inputs = about["inputs"] if isinstance(about, dict) else about.inputs
    assert list(inputs) == ["segments/background", "samples"]
    assert "unknown segmenter 'foreground'" in call(
        tmp_path, *captions, "--segments", "foreground", status=2
    )


@pytest.mark.parametrize(
    ("label", "reason"),
    [
        ("../out", "expected a plain name"),
        ("", "expected a plain name"),
        (".hidden", "expected a plain name"),
        ("a/b", "expected a plain name"),
        ("images", "embeddings/images holds the tables of embed-images"),
        ("proposals", "embeddings/proposals holds the tables of embed-proposals"),
    ],
)
def test_labels_that_would_mix_tables_are_refused(tmp_path, label, reason):
    rooms.made(tmp_path, parts=1)
    words = ("captions", "--dataset", "rooms", "--segments", "labels", "--label", label)
    assert reason in call(tmp_path, *words, status=2)
    assert [t for t in WorkDir(tmp_path).tables("rooms") if "captions" in t] == []


def test_plan_knows_every_stage(tmp_path):
    rooms.made(tmp_path, parts=1)
    # There is no feature beside these segments: the stage itself says so, not `plan`.
    reason = call(tmp_path, "plan", "embed-proposals", status=1)
    assert "expected the detector's features" in reason
