"""Files of class names as datasets and programs write them."""

import pytest

from rsa_data.common import names_files
from rsa_data.common.errors import RsaDataError

NAMES = {
    "an empty line is a class without a name": (b"wall\n\nfloor\n", {0: "wall", 2: "floor"}),
    "byte-order mark": (b"\xef\xbb\xbfwall\nfloor\n", {0: "wall", 1: "floor"}),
    "carriage returns": (b"wall\r\nfloor\r\n", {0: "wall", 1: "floor"}),
    "line separators stay": ("a\u2028b\nc\x0cd\n".encode(), {0: "a b", 1: "c d"}),
    "N: name": (b"0: wall\n5: floor\n", {0: "wall", 5: "floor"}),
    "N,name": (b"1,wall\n2,floor\n", {1: "wall", 2: "floor"}),
    "N,name,name": (b"1,Person,Person\n2,Other Shoes,x\n", {1: "Person", 2: "Other Shoes"}),
    "N name": (b"0 wall\n1 floor lamp\n", {0: "wall", 1: "floor lamp"}),
    "a table with tabs": (b"Idx\tR\tName\n1\t.5\twall\n3\t.1\tsky, air\n", {1: "wall", 3: "sky"}),
    "a table with commas": (b"id,name\n1,wall\n2,\"a, b\"\n", {1: "wall", 2: "a"}),
    "names that end with numbers": (b"stage 1\nstage 2\n", {0: "stage 1", 1: "stage 2"}),
    "names that begin with numbers": (b"2-wheeler\ncar\n", {0: "2-wheeler", 1: "car"}),
}  # fmt: skip


@pytest.mark.parametrize(("data", "wanted"), NAMES.values(), ids=NAMES)
def test_names_files(tmp_path, data, wanted):
    (tmp_path / "names.txt").write_bytes(data)
    assert names_files.read(tmp_path / "names.txt").names == wanted


def test_names_in_json(tmp_path):
    numbered = '{"0": "wall", "1": "floor"}'
    for text in ('["wall", "floor"]', numbered, f'{{"id2label": {numbered}}}'):
        (tmp_path / "n.json").write_text(text)
        assert names_files.read(tmp_path / "n.json").names == {0: "wall", 1: "floor"}


BAD_NAMES = {
    "one line": (b"wall,floor,bed", "one line with commas"),
    "a list": (b"['wall', 'floor']", "line 1"),
    "some numbered": (b"0: wall\n1: floor\nbed\n", "not in line 3"),
    "a short row": (b"id,name,n\n1,wall\n", "row 2 of the table"),
    "a number twice": (b"1,wall\n1,floor\n", "two names of number 1"),
    "UTF-16": ("wall\n".encode("utf-16"), "save the file as UTF-8"),
    "old line ends": (b"wall\rfloor\r", "line 1"),
    "a label map of TensorFlow": (b"item {\n  id: 1\n  name: 'dog'\n}\n", "blocks in braces"),
    "Darknet's obj.data": (b"classes = 2\ntrain = t.txt\nnames = obj.names\n", "obj.data"),
    "Open Images' descriptions": (b"/m/011k07,Tortoise\n/m/0120dh,Sea turtle\n", "identifiers"),
    "ImageNet's synset_words": (b"n01440764 tench\nn01443537 goldfish\n", "WordNet"),
    "labelme's labels": (b"__ignore__\n_background_\ndog\n", "labelme counts as -1"),
    "numbers behind": (b"dog 0\nball 1\n", "a number behind each name: 'dog 0'"),
}


@pytest.mark.parametrize(("data", "says"), BAD_NAMES.values(), ids=BAD_NAMES)
def test_names_files_of_no_known_form(tmp_path, data, says):
    (tmp_path / "names.txt").write_bytes(data)
    with pytest.raises(RsaDataError, match=says):
        names_files.read(tmp_path / "names.txt")
