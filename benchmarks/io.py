"""How fast features go to disk and into torch: fixed-size binary against Parquet lists.

    python benchmarks/io.py [--rows 200000] [--dim 1024] [--rounds 8]

Both are float16 in Parquet, written to memory and read back into a torch tensor of shape
(rows, dim), with one thread; the list column gets the fastest settings known (no dictionary, no
statistics, no compression) and the fastest way to read it. Rates are GB of features a second of
this process's CPU time, so that other work on the machine does not count; the best of the rounds,
since the first ones mostly wait for the system to hand out fresh memory pages.

How to open such a column without rsa-data:

    column = pandas.read_parquet("part-00000.parquet", columns=["embedding"])["embedding"]
    features = np.frombuffer(b"".join(column), "<f2").reshape(len(column), -1)
"""

import argparse
import io
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import recording
import torch

from rsa_data.store import schemas
from rsa_data.store.tables import encoded


def write_binary(features: np.ndarray) -> memoryview:
    """As the embeddings tables are written."""
    field, column = schemas.embedding_column(features)
    return encoded(pa.Table.from_arrays([column], schema=pa.schema([field])))


def read_binary(data: memoryview) -> torch.Tensor:
    """As train-head reads them: no row is touched on its own."""
    table = pq.read_table(pa.BufferReader(data), use_threads=False)
    return torch.from_numpy(schemas.embedding_array(table))


def write_list(features: np.ndarray, fixed: bool) -> memoryview:
    """A list column, of fixed or of variable length."""
    n, dim = features.shape
    values = pa.array(features.reshape(-1))
    if fixed:
        column: Any = pa.FixedSizeListArray.from_arrays(values, dim)
    else:
        column = pa.ListArray.from_arrays(pa.array(np.arange(n + 1) * dim, pa.int32()), values)
    buffer = io.BytesIO()
    table = pa.table({"embedding": column})
    settings = {"compression": "none", "use_dictionary": False, "write_statistics": False}
    pq.write_table(table, buffer, row_group_size=20_000, **settings)
    return buffer.getbuffer()


def read_list(data: memoryview) -> torch.Tensor:
    """The values of all rows at once; nothing goes through Python objects."""
    column = pq.read_table(pa.BufferReader(data), use_threads=False)["embedding"]
    flat = [chunk.flatten().to_numpy() for chunk in column.chunks]
    return torch.from_numpy(np.concatenate(flat).reshape(len(column), -1))


def seconds(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """CPU seconds of the fastest of some rounds, and the result."""
    best = float("inf")
    for _ in range(rounds):
        begun = time.process_time()
        result = call()
        best = min(best, time.process_time() - begun)
    return best, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rows", type=int, default=200_000)
    parser.add_argument("--dim", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=8)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    features = rng.standard_normal((given.rows, given.dim), np.float32).astype(np.float16)
    size = features.nbytes / 1e9
    print(f"{given.rows} x {given.dim} float16, {size:.2f} GB, pyarrow {pa.__version__}")
    ways = {
        "fixed-size binary": (write_binary, read_binary),
        "list of fixed length": (lambda f: write_list(f, True), read_list),
        "list": (lambda f: write_list(f, False), read_list),
    }
    rates = {}
    for name, (write, read) in ways.items():
        wrote, data = seconds(lambda write=write: write(features), given.rounds)
        took, back = seconds(lambda read=read, data=data: read(data), given.rounds)
        assert np.array_equal(back.numpy(), features)
        rates[name] = size / wrote, size / took
        print(f"{name:22} write {size / wrote:6.2f} GB/s   read {size / took:6.2f} GB/s")
    recording.table(
        "io",
        "Features in Parquet",
        ("column", "write, GB/s", "read, GB/s"),
        [(name, round(write, 2), round(read, 2)) for name, (write, read) in rates.items()],
        note=f"{given.rows:,} x {given.dim} float16, CPU seconds of the fastest round.",
        rounds=given.rounds,
    )
    ours = rates["fixed-size binary"]
    best = [max(rates[name][i] for name in list(ways)[1:]) for i in (0, 1)]
    print(f"against the faster list: write {ours[0] / best[0]:.1f}x, read {ours[1] / best[1]:.1f}x")
    print("goal: at least 5x each")


if __name__ == "__main__":
    main()
