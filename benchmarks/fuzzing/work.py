"""Pipeline files, and a work dir's own files after somebody edited them."""

import json
from pathlib import Path
from typing import Any

from rsa_data.common.errors import RsaDataError
from rsa_data.runner import pipeline_files, recompute, status, verify
from rsa_data.store.tables import WorkDir

from .forms import (
    Importer,
    One,
    js,
    put,
)


def job(here: Path) -> One:
    def one(data: bytes) -> None:
        (here / "job.toml").write_bytes(data)
        pipeline_files.load(here / "job.toml")

    return one


def job_seeds() -> list[bytes]:
    shipped = sorted((Path(__file__).parents[2] / "pipelines").glob("*.toml"))
    mine = b'[dataset.a]\nbuilder = "folder"\nroot = "x"\n[dataset.a.detect]\nsource = "labels"\n'
    return [mine, *(path.read_bytes() for path in shipped)]


def made_work(here: Path) -> tuple[WorkDir, dict[str, Any]]:
    import sys

    sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "helpers"))
    import rooms

    from rsa_data.runner import runs

    work = rooms.made(here / "work", parts=1, rows=3)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    base = here / "work"
    texts = [*base.rglob("*.json"), *base.glob("logs/*")]
    return work, {
        path.relative_to(base).as_posix(): json.loads(path.read_bytes())
        if path.suffix == ".json"
        else path.read_text()
        for path in sorted(texts)
    }


def work_seeds() -> list[bytes]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        files = made_work(Path(place))[1]
    stable = {name: value for name, value in files.items() if not name.startswith("logs/")}
    log = next(value for name, value in files.items() if name.startswith("logs/"))
    stable["logs/rooms.captions.occupancy.1.jsonl"] = log
    one_table = {k: v for k, v in stable.items() if "samples" in k}
    return [js(stable), js(one_table)]


def work_dir(here: Path) -> One:
    work, files = made_work(here)
    base = Path(work.store.location)
    for name in files:
        if name.startswith("logs/"):
            (base / name).unlink()
    names = tuple(json.loads(work_seeds()[0]))
    usual = js(json.loads(work_seeds()[0]))

    def one(data: bytes) -> None:
        put(base, usual, names)
        put(base, data, names)
        for act in (
            lambda: status.status(work),
            lambda: verify.verify(work, str),
            lambda: recompute.recompute(work, 1, str, seed=0),
            lambda: [work.table("rooms", n).read(0) for n in ("samples", "captions/occupancy")],
        ):
            try:
                act()
            except RsaDataError:
                continue

    return one


IMPORTERS = {
    "job": Importer(job_seeds, job, "text"),
    "work-dir": Importer(work_seeds, work_dir),
}
