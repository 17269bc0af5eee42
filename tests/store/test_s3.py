"""Work dirs in S3, against a server that speaks its protocol, in good and in bad weather."""

import pytest
import rooms
from msgspec.structs import replace

from rsa_data.common.errors import RsaDataError, TransientError
from rsa_data.runner import runs, status, verify
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.objects import ObjectStore
from rsa_data.store.stores import open_store
from rsa_data.store.tables import Description, WorkDir

boto3 = pytest.importorskip("boto3")


@pytest.fixture
def place(weather, request) -> str:
    """A prefix of the test's own."""
    weather.troubles, weather.seen = [], []
    return f"s3://bucket/{request.node.name}"


def test_a_store_in_a_bucket(place):
    store = open_store(place)
    assert store.read("a/b.json") is None and store.size("a/b.json") is None
    assert store.list("") == [] and store.list("a") == []
    store.write("a/b.json", b"one")
    store.write("a/c/d.json", b"two")
    assert store.create("a/e.json", b"three")
    assert store.create("a/e.json", b"three") and not store.create("a/e.json", b"four")
    assert store.read("a/e.json") == b"three"
    assert store.list("") == ["a/"] and store.list("a") == ["b.json", "c/", "e.json"]
    assert store.open("a/b.json").read() == b"one" and store.size("a/b.json") == 3
    store.delete("a/b.json")
    store.delete("a/b.json")
    with pytest.raises(FileNotFoundError):
        store.open("a/b.json")


def test_a_stage_gives_the_same_bytes_as_in_a_folder(place, tmp_path):
    kept = {}
    for location in (place, tmp_path):
        work = rooms.made(location, parts=3)
        summary = runs.run(rooms.captions_job(work), bar=rooms.NoBar)
        assert (summary.done, summary.rows) == (3, 3 * 50 * 5)
        table = work.table("rooms", "captions/occupancy")
        files = [name for name in work.store.list(table.path) if name != "_local.json"]
        kept[str(location)] = {name: work.store.read(f"{table.path}/{name}") for name in files}
        assert runs.run(rooms.captions_job(work), bar=rooms.NoBar).done == 0
        said: list[str] = []
        assert verify.verify(work, said.append) == 0, said
    assert kept[place] == kept[str(tmp_path)]
    assert len(kept[place]) == 3 * 2 + 2
    assert [name for name in open_store(place).list("logs") if name.startswith("rooms.captions")]


def test_worker_processes_commit_to_a_bucket(place):
    work = rooms.made(place, parts=3)
    summary = runs.run(rooms.captions_job(work), engine=EngineOptions(workers=2), bar=rooms.NoBar)
    assert (summary.done, summary.ok) == (3, 150)
    assert "captions/occupancy" in "\n".join(status.status(work).lines)


@pytest.mark.parametrize("trouble", ["503", "cut", "lost", "half"])
def test_a_bad_moment_passes(place, weather, trouble):
    store = open_store(place)
    weather.troubles = [trouble] * 2
    store.write("a", b"data")
    weather.troubles = [trouble] * 2
    assert store.create("b", b"data")
    weather.troubles = [trouble] * 2
    assert store.read("a") == b"data"
    weather.troubles = [trouble]
    assert store.list("") == ["a", "b"]
    assert any(trouble in seen for seen in weather.seen)


def test_a_stage_in_bad_weather_loses_nothing(place, weather, tmp_path):
    work = rooms.made(place, parts=3)
    weather.troubles = ["", "503", "", "cut", "lost", "", "", "503", "half", "lost"] * 4
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    weather.troubles = []
    local = rooms.made(tmp_path, parts=3)
    runs.run(rooms.captions_job(local), bar=rooms.NoBar)
    there, here = (w.table("rooms", "captions/occupancy") for w in (work, local))
    assert [there.receipt(n) for n in there.parts()] == [here.receipt(n) for n in here.parts()]


class Slow:
    """A store in which another run commits the same part while this one puts its data."""

    def __init__(self, store, other):
        self.store, self.other = store, other

    def __getattr__(self, name):
        return getattr(self.store, name)

    def write(self, path, data):
        self.store.write(path, data)
        if path.endswith(".parquet") and self.other:
            commit, self.other = self.other, None
            commit()


@pytest.mark.parametrize("where", ["s3", "folder"])
def test_of_two_runs_at_once_the_first_receipt_stays(place, where, tmp_path):
    work = rooms.made(place if where == "s3" else tmp_path, parts=1)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    fast, slow = (work.table("rooms", "captions/occupancy") for _ in range(2))
    receipt, part = fast.receipt(0), fast.read(0)
    fast.store.delete(f"{fast.path}/_part-00000.json")
    slow.store = Slow(slow.store, lambda: fast.commit(0, part, receipt))
    # Another CPU type may give other bits from the same input: what is there first stays.
    assert slow.commit(0, part.slice(5), receipt) == receipt == fast.receipt(0)
    names = fast.store.list(fast.path)
    assert [name for name in names if name.endswith(".parquet")] == [receipt.file]

    fast.store.delete(f"{fast.path}/_part-00000.json")
    slow.store.other = lambda: fast.commit(0, part, receipt)
    with pytest.raises(TransientError, match="another run has just written part 0"):
        slow.commit(0, part.slice(5), replace(receipt, fingerprint="of another input"))
    assert fast.receipt(0) == receipt and fast.read(0, check=True).equals(part)


def test_a_server_that_stays_away_is_a_transient_error(place, weather, monkeypatch):
    monkeypatch.setattr("rsa_data.store.objects.TRIES", 2)
    store = ObjectStore(place)
    weather.troubles = ["503"] * 20
    with pytest.raises(TransientError, match=f"cannot write {place}/a: .*503.*same command again"):
        store.write("a", b"data")


def test_a_bucket_that_is_not_there_is_an_error(place):
    with pytest.raises(RsaDataError, match="NoSuchBucket") as caught:
        WorkDir("s3://nowhere/x").table("a", "b").bind(Description(stage="x", schema="captions"))
    assert not isinstance(caught.value, TransientError)
