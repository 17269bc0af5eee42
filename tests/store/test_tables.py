"""Parts and receipts: whole or not at all, bound to what made them."""

import contextlib
import hashlib
import json
import logging
import re
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from msgspec.structs import replace

from rsa_data.common.errors import RsaDataError
from rsa_data.store import schemas
from rsa_data.store.logs import RunLog, last_run
from rsa_data.store.tables import Description, Made, WorkDir


def embeddings(n: int = 3) -> pa.Table:
    features = np.arange(n * 4, dtype=np.float16).reshape(n, 4)
    return schemas.from_columns(
        "embeddings",
        {
            "text_id": [bytes([i]) * 16 for i in range(n)],
            "embedding": schemas.embedding_column(features),
            "n_tokens": [5] * n,
            "truncated": [False] * n,
        },
    )


DESCRIPTION = Description(schema="embeddings", stage="embed", options={"encoder": "a"})
COUNTS = Made(ok=3, failed=0, skipped=0, split="train", fingerprint="f")


@pytest.fixture
def table(tmp_path):
    table = WorkDir(tmp_path).table("rooms", "embeddings/occupancy/a")
    table.bind(DESCRIPTION)
    return table


def test_a_committed_part_is_read_back_whole(table):
    receipt = table.commit(7, embeddings(), COUNTS)
    assert table.parts() == [7]
    assert table.read(7).equals(embeddings())
    assert table.read(7).schema.field("embedding").metadata[b"dtype"] == b"float16"
    np.testing.assert_array_equal(
        schemas.embedding_array(table.read(7)), np.arange(12, dtype=np.float16).reshape(3, 4)
    )
    assert table.receipt(7) == receipt
    assert receipt.rows == 3 and receipt.digest == schemas.digest(embeddings())


def test_the_same_part_gives_the_same_bytes(table, tmp_path):
    first = table.commit(0, embeddings(), COUNTS)
    again = table.commit(
        0, pa.concat_tables([embeddings().slice(0, 1), embeddings().slice(1)]), COUNTS
    )
    assert first.digest == again.digest
    assert table.commit(0, embeddings(), COUNTS).sha256 == first.sha256


def test_a_description_is_read_once_however_many_parts_are(table):
    """In a bucket each read is a request."""
    for number in range(3):
        table.commit(number, embeddings(), COUNTS)
    read, seen = table.store.read, []
    table.store.read = lambda path: [seen.append(path), read(path)][1]
    for number in range(3):
        table.read(number)
    assert sum(path.endswith("_table.json") for path in seen) == 1


def test_without_a_receipt_a_part_is_not_done(table):
    table.commit(0, embeddings(), COUNTS)
    table.store.delete(f"{table.path}/_part-00000.json")
    assert table.parts() == []
    with pytest.raises(RsaDataError, match="part 0 is not done"):
        table.read(0)


def test_a_part_of_another_size_is_refused(table):
    table.commit(0, embeddings(), COUNTS)
    file = f"{table.path}/{table.receipt(0).file}"
    data = table.store.read(file)
    table.store.write(file, data[:-1])
    with pytest.raises(RsaDataError, match=rf"expected {len(data)} bytes.*found {len(data) - 1}"):
        table.read(0)


def test_a_part_of_other_bytes_is_refused_when_they_are_looked_at(table):
    receipt = table.commit(0, embeddings(), COUNTS)
    file = f"{table.path}/{receipt.file}"
    data = bytearray(table.store.read(file))
    data[len(data) // 2] ^= 1
    table.store.write(file, bytes(data))
    other = hashlib.sha256(data).hexdigest()
    said = f"expected sha256 {receipt.sha256[:12]}..., found {other[:12]}...."
    with pytest.raises(RsaDataError, match=f"{re.escape(said)}.*delete its receipt to make it"):
        table.read(0, check=True)


RECEIPT = """{{
 "bytes": {bytes},
 "digest": "{digest}",
 "failed": 0,
 "file": "{file}",
 "fingerprint": "f",
 "ok": 3,
 "part": 0,
 "rows": 3,
 "sha256": "{sha256}",
 "skipped": 0,
 "split": "train"
}}
"""


def test_a_receipt_has_the_same_bytes_in_every_version(table):
    """What is not known stands in no receipt; and none of them changes by itself."""
    made = table.commit(0, embeddings(), COUNTS)
    text = RECEIPT.format(**{n: getattr(made, n) for n in ("bytes", "digest", "file", "sha256")})
    assert table.store.read(f"{table.path}/_part-00000.json") == text.encode()
    # A description that says nothing of versions is of the first.
    table.store.write(f"{table.path}/_table.json", b'{"stage": "embed", "schema": "embeddings"}')
    about = table.description()
    assert (about.stage_version, about.schema_version) == (1, 1)


class Swept:
    """A store in which another run takes a file for a leftover before its receipt is there."""

    def __init__(self, store):
        self.store, self.written = store, []

    def __getattr__(self, name):
        return getattr(self.store, name)

    def write(self, path, data):
        self.written.append(path)
        self.store.write(path, data)

    def create(self, path, data):
        done = self.store.create(path, data)
        if len(self.written) == 1:
            self.store.delete(self.written[0])
        return done


def test_data_that_another_run_swept_away_is_written_again(table):
    table.store = store = Swept(table.store)
    receipt = table.commit(0, embeddings(), COUNTS)
    assert store.written == [f"{table.path}/{receipt.file}"] * 2
    assert table.read(0, check=True).equals(embeddings())
    table.commit(1, embeddings(2), COUNTS)
    assert len(store.written) == 3  # nobody swept: written once


@pytest.mark.parametrize("ends", ["well", "badly"])
def test_the_log_of_a_run_says_how_it_ended(tmp_path, ends):
    work = WorkDir(tmp_path)
    with contextlib.suppress(RuntimeError), RunLog(work, "rooms", "captions/a") as log:
        log.write("begun", parts=2)
        logging.getLogger("other").warning("look at %s", "this")
        if ends == "badly":
            raise RuntimeError("no more")
    logging.getLogger("other").warning("of nobody's run")
    events = last_run(work, "rooms", "captions/a")
    told = [{k: v for k, v in event.items() if k != "time"} for event in events]
    expected = [{"event": "begun", "parts": 2}]
    expected += [{"event": "warning", "logger": "other", "message": "look at this"}]
    expected += [{"event": "stopped", "error": "RuntimeError: no more"}] * (ends == "badly")
    assert told == expected


def test_other_options_are_refused_by_name(table):
    table.commit(0, embeddings(), COUNTS)
    table.bind(replace(DESCRIPTION, made_with={"numpy": "another"}))
    with pytest.raises(RsaDataError, match=r'options.encoder: the table has "a", this run has "b"'):
        table.bind(replace(DESCRIPTION, options={"encoder": "b"}))


def test_start_over_leaves_nothing(table):
    table.commit(0, embeddings(), COUNTS)
    table.start_over()
    assert not table.exists() and table.parts() == []
    table.bind(replace(DESCRIPTION, options={"encoder": "b"}))


def test_manifest_only_when_all_parts_are_there(table):
    table.commit(0, embeddings(), COUNTS)
    assert table.manifest([0, 1]) is None
    table.commit(1, embeddings(), COUNTS)
    assert table.manifest([0, 1])["ok"] == 6
    stored = json.loads(table.store.read(f"{table.path}/_manifest.json"))
    assert [receipt["part"] for receipt in stored["parts"]] == [0, 1]


@pytest.mark.parametrize("moment", ["write", "flush", "flushed", "rename", "renamed", "receipt"])
def test_killed_at_any_moment_a_part_is_whole_or_not_there(tmp_path, moment):
    table = WorkDir(tmp_path).table("rooms", "embeddings/occupancy/a")
    table.bind(DESCRIPTION)
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]);"
        "from test_tables import *; from rsa_data.store.tables import Description, Made, WorkDir;"
        "table = WorkDir(sys.argv[2]).table('rooms', 'embeddings/occupancy/a');"
        "table.commit(0, embeddings(), COUNTS)"
    )
    folder = __file__.rpartition("/")[0]
    ended = subprocess.run(
        [sys.executable, "-c", script, folder, str(tmp_path)],
        env={"RSA_DATA_FAILPOINT": moment, "PYTHONPATH": folder + "/../..", "PATH": ""},
        check=False,
    )
    assert ended.returncode == -9
    assert table.parts() == []
    table.bind(DESCRIPTION)
    table.commit(0, embeddings(), COUNTS)
    assert table.read(0).equals(embeddings())
    left = [p.name for p in (tmp_path / table.path).iterdir()]
    assert sorted(left) == ["_part-00000.json", "_table.json", table.receipt(0).file]


def test_a_full_disk_is_a_clear_error_and_keeps_what_was_there(table, monkeypatch):
    table.commit(0, embeddings(), COUNTS)

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RsaDataError, match=r"cannot write .*part-00001-.*parquet: No space left"):
        table.commit(1, embeddings(), COUNTS)
    monkeypatch.undo()
    assert table.parts() == [0]


def test_tables_are_found_below_their_dataset(table, tmp_path):
    assert WorkDir(tmp_path).tables("rooms") == ["embeddings/occupancy/a"]
    with pytest.raises(RsaDataError, match=r"no such table. Tables there: embeddings/occupancy/a"):
        WorkDir(tmp_path).table("rooms", "captions/counts").description()
