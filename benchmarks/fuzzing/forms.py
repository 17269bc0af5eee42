"""What a fuzzed importer is, and what the importers share."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from rsa_data.store import schemas

SHARED = Path(__file__).parents[3] / "shared" / "data"
One = Callable[[bytes], object]


@dataclass(frozen=True)
class Importer:
    """seeds : inputs to begin with. make : (empty folder) -> what reads one input.

    kind : text or json, which says how inputs are changed.
    """

    seeds: Callable[[], list[bytes]]
    make: Callable[[Path], One]
    kind: str = "json"


def put(here: Path, data: bytes, names: tuple[str, ...]) -> None:
    """Writes an input as files; what is no such JSON object becomes the first of them."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        content = {names[0]: data.decode("utf-8", "surrogateescape")}
    for name in names:
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        if name in content:
            value = content[name]
            text = value if isinstance(value, str) else json.dumps(value)
            (here / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        else:
            (here / name).unlink(missing_ok=True)


def js(value: Any) -> bytes:
    return json.dumps(value).encode()


def shared(*globs: str, most: int = 12_000) -> list[bytes]:
    """Real files that are small enough."""
    found = [path for glob in globs for path in sorted(SHARED.glob(glob))]
    return [path.read_bytes() for path in found if path.stat().st_size < most]


def cut(value: Any, most: int = 3) -> Any:
    """A JSON value with the first entries of each list."""
    if isinstance(value, list):
        return [cut(v, most) for v in value[:most]]
    return {k: cut(v, most) for k, v in value.items()} if isinstance(value, dict) else value


def samples(sample_id: str = "folder/train/a") -> pa.Table:
    values = dict.fromkeys(schemas.schema("samples").names)
    values |= {"sample_id": sample_id, "dataset": "folder", "split": "train", "scene": "."}
    return pa.Table.from_pylist([values | {"image": "a.jpg"}], schemas.schema("samples"))


def accounted(table: pa.Table, here: Path) -> None:
    """One sample in, one row out: ok, or failed with a reason that names no folder of here."""
    (row,) = table.to_pylist()
    assert (row["status"] == "ok") != bool(row["error"]), row
    assert str(here) not in (row["error"] or ""), row


def list_seeds(*lines: str) -> Callable[[], list[bytes]]:
    return lambda: [line.encode() for line in lines] + ["\n".join(lines).encode()]


def is_text(data: bytes) -> bool:
    try:
        return bool(data.decode().strip())
    except UnicodeDecodeError:
        return False
