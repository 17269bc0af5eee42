"""What a command writes does not take the place of what a work dir holds."""

import json

import pytest
from made_tables import write
from numpy import ones

from rsa_data.common.errors import UsageError
from rsa_data.heads.travel import export_head
from rsa_data.store.outputs import check_output
from rsa_data.store.tables import WorkDir
from rsa_data.views.report.build import report


@pytest.fixture
def work(tmp_path) -> WorkDir:
    work = WorkDir(tmp_path / "work")
    some = {"scenes": ["a"], "texts": [["a bed"]], "features": {"a bed": ones(16, "float16")}}
    write(work, "nyuv2", **some, relative=ones((1, 4)), metric=ones((1, 4)))
    return work


@pytest.mark.parametrize(
    "place",
    ["work/nyuv2/samples", "work/nyuv2/samples/x.html", "work/nyuv2/captions/occupancy/a/b.png"],
)
def test_tables_take_no_file_of_another_command(work, tmp_path, place):
    with pytest.raises(UsageError, match="outside of the tables and heads of a work dir; found _t"):
        check_output(tmp_path / place)
    with pytest.raises(UsageError, match=r"outside of the tables|expected a name that ends in"):
        report(work, out=tmp_path / place)
    check_output(tmp_path / "work" / "report.html")


def test_a_report_has_the_ending_of_a_page(work, tmp_path):
    (tmp_path / "photo.jpg").write_bytes(b"a photo")
    with pytest.raises(UsageError, match=r"photo.jpg: expected a name that ends in .html"):
        report(work, out=tmp_path / "photo.jpg")
    assert (tmp_path / "photo.jpg").read_bytes() == b"a photo"


@pytest.mark.parametrize("name", ["README.md", "head.json"])
def test_a_head_is_not_exported_over_the_files_of_something_else(work, tmp_path, name):
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / name).write_text(json.dumps("mine"))
    with pytest.raises(UsageError, match=r"expected a new folder, or a name that ends in .safe"):
        export_head(work, "any", tmp_path / "project")
    assert [path.name for path in (tmp_path / "project").iterdir()] == [name]
