"""What an index finds, kept in a temporary file until all of it is known to be there once."""

import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RsaDataError
from ..store import schemas
from ..store.tables import Table

# Bytes of an id's digest: what stays in memory of each sample.
_DIGEST = 16

# Rows of a batch.
_ROWS = 4096


def id_digests(ids: pa.ChunkedArray) -> np.ndarray:
    """16 bytes of each sample_id's BLAKE2b, S16 (n,): equal where the ids are."""
    made = (hashlib.blake2b(i.encode(), digest_size=_DIGEST).digest() for i in ids.to_pylist())
    return np.frombuffer(b"".join(made), f"S{_DIGEST}")


def check_once(samples: Table, numbers: Sequence[int]) -> None:
    """Raises RsaDataError when a sample stands twice in these parts of samples.

    Index never writes that; damage, and indexes that versions before 0.2 wrote at once, may.
    """
    parts = [id_digests(samples.read(n, ["sample_id"])["sample_id"]) for n in numbers]
    if not parts:
        return
    order = np.argsort(whole := np.concatenate(parts), kind="stable")
    again = np.flatnonzero(whole[order[1:]] == whole[order[:-1]])
    if len(again):
        ends = np.cumsum([len(part) for part in parts])
        pair = order[(place := again[np.argmin(order[again])]) : place + 2]
        first, second = np.searchsorted(ends, pair, side="right")
        row = int(pair[0] - (ends[first] - len(parts[first])))
        found = samples.read(numbers[first], ["sample_id"])["sample_id"][row].as_py()
        raise RsaDataError(
            f"{samples}: expected each sample once; found {found} in part {numbers[first]} and in "
            f"part {numbers[second]}, and {len(again) - 1} more such pairs. Index the dataset into "
            "another work dir"
        )


class FoundSamples:
    """The samples of a dataset, table by table, in the order in which they were found.

    Nothing but a digest of each id stays in memory, so that an index of any number of shards needs
    as much of it as one shard does: they go to the file and come back in batches.
    """

    def __init__(self, name: str):
        self.name = name
        self.splits: list[str] = []
        self.images = 0  # samples that have one
        self._file = tempfile.TemporaryFile(prefix="rsa-data-index-")  # noqa: SIM115  # __exit__
        schema = schemas.schema("samples")
        options = pa.ipc.IpcWriteOptions(compression="zstd")
        self._writer = pa.ipc.new_file(pa.PythonFile(self._file, "w"), schema, options=options)
        self._digests: list[np.ndarray] = []  # of each batch
        self._batches: list[int] = []  # of each table

    def __enter__(self) -> "FoundSamples":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, samples: pa.Table) -> None:
        """Keeps a table of samples, under the dataset's name in the work dir."""
        for start in range(0, len(samples), _ROWS):
            named = self._named(samples.slice(start, _ROWS))
            schemas.check("samples", named)
            self._digests.append(id_digests(named["sample_id"]))
            found = pc.unique(named["split"]).to_pylist()
            self.images += len(named) - named["image"].null_count
            self.splits += [split for split in found if split not in self.splits]
            (batch,) = named.combine_chunks().to_batches()
            self._writer.write_batch(batch)
        self._batches.append(-(-len(samples) // _ROWS))

    def finish(self) -> None:
        """Raises RsaDataError when two samples have the same id."""
        self._writer.close()
        digests = np.sort(np.concatenate([*self._digests, np.empty(0, f"S{_DIGEST}")]))
        twice = digests[1:][digests[1:] == digests[:-1]]
        if len(twice):
            there = [row for t in self._read() for row in _rows_of(t, twice[0])]
            raise RsaDataError(
                f"{self.name}: expected one image for each key, found {there[0]['image']} and "
                f"{there[1]['image']} with the same key "
                f"{there[0]['sample_id'].partition('/')[2]}; {_way_out(there[0]['image'])}"
            )

    def new(self, split: str, known: np.ndarray, most: int) -> Iterator[pa.Table]:
        """The rows of one split whose ids are not known, at most so many of one table at a time.

        known : digests of ids, sorted, S16 (n,).
        """
        batches = zip(self._read(), self._digests, strict=True)
        for count in self._batches:
            waiting: list[pa.Table] = []
            for batch, digests in islice(batches, count):
                mask = pc.and_(pc.equal(batch["split"], split), pa.array(~_among(digests, known)))
                waiting.append(batch.filter(mask))
                while sum(map(len, waiting)) >= most:
                    rows = pa.concat_tables(waiting)
                    yield rows.slice(0, most)
                    waiting = [rows.slice(most)]
            if any(map(len, waiting)):
                yield pa.concat_tables(waiting)

    def _read(self) -> Iterator[pa.Table]:
        reader = pa.ipc.open_file(pa.PythonFile(self._file, "r"))
        for number in range(reader.num_record_batches):
            yield pa.Table.from_batches([reader.get_batch(number)])

    def _named(self, samples: pa.Table) -> pa.Table:
        tails = pc.replace_substring_regex(samples["sample_id"], "^[^/]*/", "")
        columns = {c: samples[c] for c in samples.column_names}
        columns["sample_id"] = pc.binary_join_element_wise(pa.scalar(self.name), tails, "/")
        columns["dataset"] = pa.array([self.name] * len(samples), pa.string())
        return schemas.from_columns("samples", columns)


def known_ids(tables: Iterable[pa.Table]) -> np.ndarray:
    """Digests of the ids in tables of samples, sorted, S16 (n,)."""
    found = [id_digests(table["sample_id"]) for table in tables]
    return np.sort(np.concatenate([*found, np.empty(0, f"S{_DIGEST}")]))


def _among(digests: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Which digests are among those known, which are sorted: bool (n,)."""
    place = np.searchsorted(known, digests)
    there = np.zeros(len(digests), bool)
    inside = place < len(known)
    there[inside] = known[place[inside]] == digests[inside]
    return there


def _way_out(image: str | None) -> str:
    if ".parquet#" in str(image):
        return (
            "name a column that tells them apart by --dataset-option id=COLUMN, or number the rows "
            "by --dataset-option keys=row"
        )
    if ".tar#" in str(image) or ".zip#" in str(image):
        return "where keys repeat from shard to shard, give --dataset-option keys=shard/member"
    return "remove or rename one of them"


def _rows_of(table: pa.Table, digest: bytes) -> list[dict[str, str]]:
    chosen = table.filter(pa.array(id_digests(table["sample_id"]) == digest))
    rows: list[dict[str, str]] = chosen.select(["sample_id", "image"]).to_pylist()
    return rows
