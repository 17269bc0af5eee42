"""Schemas: every column as declared, nothing let through."""

import hashlib

import numpy as np
import pyarrow as pa
import pytest

from rsa_data.common.errors import RsaDataError
from rsa_data.store import encoding, schemas

ROW = {
    "sample_id": ["nyuv2/test/a"],
    "variant": [0],
    "text": ["An image."],
    "text_id": [b"0" * 16],
    "n_objects": [0],
    "n_kept": [0],
    "n_tokens": [5],
}


def captions() -> pa.Table:
    schema = schemas.schema("captions")
    known = {name: ROW.get(name) for name in schema.names}
    for field in schema:
        if known[field.name] is None:
            known[field.name] = [0.0] if pa.types.is_floating(field.type) else [0]
    return schemas.from_columns("captions", known)


def test_a_good_table_passes():
    schemas.check("captions", captions())


def test_missing_column_is_named():
    with pytest.raises(RsaDataError, match="expected the columns sample_id"):
        schemas.check("captions", captions().drop_columns(["text"]))


def test_null_where_none_may_be():
    table = captions()
    at = table.schema.get_field_index("text")
    broken = table.set_column(at, "text", pa.array([None], pa.string()))
    with pytest.raises(RsaDataError, match=r"captions.text: expected no null; found one in row 0"):
        schemas.check("captions", broken)


def test_other_type_is_refused():
    table = captions()
    at = table.schema.get_field_index("variant")
    broken = table.set_column(at, "variant", pa.array([0], pa.int64()))
    with pytest.raises(RsaDataError, match=r"captions.variant: expected type int16; found int64"):
        schemas.check("captions", broken)


@pytest.mark.parametrize("name", ["samples", "segments", "captions", "embeddings", "depth"])
def test_every_column_is_documented(name):
    definition = schemas.definition(name)
    assert definition["version"] >= 1 and definition["doc"]
    assert definition["key"] in definition["columns"]
    for column, spec in definition["columns"].items():
        assert spec["doc"].endswith("."), column
        schemas.arrow_type(spec["type"])


VALUES = [
    pa.array(["a", None, "ccc", ""]),
    pa.array([1.5, None, 3.0, -0.0]),
    pa.array([True, None, False, True]),
    pa.array([[1, 2], None, [], [3]]),
    pa.array([["x"], ["y", "z"], None, []]),
    pa.array([b"0123", None, b"4567", b"89ab"], pa.binary(4)),
    pa.array(
        [[[1.0, 2.0]], None, [], [[3.0, 4.0], [5.0, 6.0]]], pa.list_(pa.list_(pa.float32(), 2))
    ),
]


@pytest.mark.parametrize("array", VALUES, ids=[str(a.type) for a in VALUES])
def test_digest_sees_content_not_layout(array):
    whole = pa.table({"c": array})
    sliced = pa.table({"c": pa.concat_arrays([array, array])}).slice(4)
    chunked = pa.table({"c": pa.chunked_array([array.slice(0, 1), array.slice(1)])})
    assert schemas.digest(whole) == schemas.digest(sliced) == schemas.digest(chunked)
    turned = whole.take([1, 0, 2, 3])
    assert schemas.digest(whole) != schemas.digest(turned)


def test_digest_tells_null_from_empty():
    empty = pa.table({"c": pa.array(["", "a"])})
    null = pa.table({"c": pa.array([None, "a"])})
    assert schemas.digest(empty) != schemas.digest(null)


def test_digest_does_not_see_what_lies_under_a_null():
    """Arrow's format leaves the bytes of a null open."""
    there = pa.py_buffer(bytes([0b101]))
    made = [
        pa.Array.from_buffers(
            kind, 3, [there, pa.py_buffer(b"a" * width + under * width + b"b" * width)]
        )
        for kind, width in ((pa.binary(4), 4), (pa.int32(), 4), (pa.float64(), 8))
        for under in (b"x", b"y")
    ]
    found = [schemas.digest(pa.table({"c": array})) for array in made]
    assert found[0::2] == found[1::2] and len(set(found)) == 3


def test_digests_are_those_that_receipts_hold():
    """Receipts of earlier versions name the digests of their parts."""
    table = pa.table({f"c{number}": array for number, array in enumerate(VALUES)})
    assert schemas.digest(table) == (
        "73dfb358ff73434ac1fb48437c715018a9b3063b32427c2ee158e4fce532725c"
    )


def test_what_is_not_said_to_be_nullable_is_not():
    """Readers of Parquet are told: `required` in the file's own schema."""
    nullable = {field.name for field in schemas.schema("samples") if field.nullable}
    assert {"image", "depth", "fx", "width"} <= nullable
    assert not {"sample_id", "dataset", "split", "scene"} & nullable


def test_json_is_readable_and_the_same_for_the_same_value():
    """What fingerprints are of: sorted keys, one space, UTF-8 as it is, one newline."""
    text = b'{\n "a": "\xc3\xa4\xe6\xa4\x85",\n "b": [\n  1,\n  null\n ]\n}\n'
    value = {"b": [1, None], "a": "ä椅"}
    assert encoding.to_json(value) == text
    assert encoding.fingerprint(value) == hashlib.sha256(text).hexdigest()


@pytest.mark.parametrize(
    ("array", "values"),
    [
        (pa.array([5, None, 7]), np.array([5, 0, 7], "<i8")),
        (pa.array([0.5, None, -1.5], pa.float32()), np.array([0.5, 0, -1.5], "<f4")),
        (pa.array([True, None, False]), np.array([1, 0, 0], "u1")),
        (pa.array(["ab", None, "c"]), np.array([2, 0, 1], "<i8")),
        (pa.array([b"ab", None, b"cd"], pa.binary(2)), np.frombuffer(b"ab\0\0cd", "u1")),
    ],
    ids=lambda value: str(getattr(value, "type", "")),
)
def test_the_digest_takes_a_null_for_an_invalid_zero(array, values):
    sha = hashlib.sha256(f"('c', '{array.type}', [], 3)".encode())
    sha.update(np.packbits([True, False, True]).tobytes())
    sha.update(values.tobytes() + (b"abc" if array.type == pa.string() else b""))
    assert schemas.digest(pa.table({"c": array})) == sha.hexdigest()


def test_embedding_column_keeps_dtype_and_bits():
    features = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    field, array = schemas.embedding_column(features)
    # Hundreds of MB in a part: they are not copied.
    assert array.buffers()[1].address == features.ctypes.data
    table = pa.Table.from_arrays([array], schema=pa.schema([field]))
    back = schemas.embedding_array(table.slice(2))
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, features[2:])
