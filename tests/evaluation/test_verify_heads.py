"""Damage to heads and evaluations: verify names it, and what was damaged is not used."""

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from rsa_data import ScaleHead
from rsa_data.common.errors import RsaDataError
from rsa_data.runner import verify
from rsa_data.store.tables import WorkDir

HEAD = "heads/head"


def problems(work: WorkDir) -> list[str]:
    """Of heads and results: the tables of this work dir are made in memory."""
    said: list[str] = []
    verify.verify(work, said.append)
    return [line for line in said[:-1] if HEAD in line]


def flip(name: str) -> Callable[[Path], None]:
    def damage(place: Path) -> None:
        data = bytearray((place / name).read_bytes())
        data[len(data) // 2] ^= 1
        (place / name).write_bytes(data)

    return damage


def delete(name: str) -> Callable[[Path], None]:
    return lambda place: (place / name).unlink()


def edit(name: str, key: str, value: object) -> Callable[[Path], None]:
    def damage(place: Path) -> None:
        whole = json.loads((place / name).read_text())
        assert whole[key] != value
        (place / name).write_text(json.dumps({**whole, key: value}))

    return damage


def cut(name: str) -> Callable[[Path], None]:
    def damage(place: Path) -> None:
        data = (place / name).read_bytes()
        (place / name).write_bytes(data[: len(data) // 2])

    return damage


DAMAGE = {
    "a bit of the weights": flip(f"{HEAD}/head.safetensors"),
    "no weights": delete(f"{HEAD}/head.safetensors"),
    "no description": delete(f"{HEAD}/head.json"),
    "an edited description": edit(f"{HEAD}/head.json", "epochs_run", 3),
    "a cut description": cut(f"{HEAD}/head.json"),
    "a cut history": cut(f"{HEAD}/history.parquet"),
    "no history": delete(f"{HEAD}/history.parquet"),
    "no training": delete(f"{HEAD}/_table.json"),
    "a bit of the metrics": flip(f"{HEAD}/evaluation/rsa/metrics.parquet"),
    "no summary": delete(f"{HEAD}/evaluation/rsa/summary.csv"),
    "no record": delete(f"{HEAD}/evaluation/rsa/_evaluation.json"),
    "a cut record": cut(f"{HEAD}/evaluation/rsa/_evaluation.json"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_to_heads_is_noticed(measured, kind):
    DAMAGE[kind](Path(measured.store.location))
    assert problems(measured)


def test_whole_heads_have_no_problem(measured):
    assert problems(measured) == []


def test_an_evaluation_of_version_0_1_has_no_record(measured):
    place = Path(measured.store.location) / HEAD / "evaluation" / "rsa"
    (place / "_evaluation.json").unlink()
    # As version 0.1 wrote it: without the note that a record belongs beside it.
    metrics = pq.read_table(place / "metrics.parquet").replace_schema_metadata(None)
    pq.write_table(metrics, place / "metrics.parquet")
    assert problems(measured) == []


def test_an_edited_head_is_not_loaded(work):
    place = Path(work.store.location)
    ScaleHead.load(place / HEAD)
    edit(f"{HEAD}/head.json", "epochs_run", 3)(place)
    with pytest.raises(RsaDataError, match="changed since it was written"):
        ScaleHead.load(place / HEAD)
