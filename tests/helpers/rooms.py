"""A work dir with samples and segments made in memory, for tests of how stages run."""

from rsa_data.datasets.index import sample_fingerprint
from rsa_data.runner import jobs, stages
from rsa_data.runner.fingerprints import part_fingerprint
from rsa_data.runner.jobs import Job
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

LABELS = ("bed", "chair", "lamp", "picture", "wall", "window")


def made(location: object, parts: int = 4, rows: int = 50, first: int = 0) -> WorkDir:
    """`parts` parts of `rows` samples of the dataset rooms, with segments/labels."""
    work = WorkDir(str(location))
    samples, segments = (work.table("rooms", name) for name in ("samples", "segments/labels"))
    about = {"stage_version": 1, "options": {"dataset": "folder"}, "files": {}}
    samples.bind(Description(stage="index", schema="samples", **about))
    made_by = Description(stage="made", schema="segments", inputs=["samples"], **about)
    segments.bind(made_by)
    counts = {"ok": rows, "failed": 0, "skipped": 0, "split": "train"}
    for number in range(first, first + parts):
        ids = [f"rooms/train/{number:03d}/{row:05d}" for row in range(rows)]
        rows_ = sample_rows(ids)
        follows = sample_fingerprint("rooms", schemas.digest(rows_))
        done = samples.commit(number, rows_, Made(**counts, fingerprint=follows))
        inputs = {"samples": done.digest}
        follows = part_fingerprint(made_by, inputs)
        segments.commit(
            number, segment_rows(ids), Made(**counts, inputs=inputs, fingerprint=follows)
        )
    samples.manifest(samples.parts())
    segments.manifest(samples.parts())
    return work


def sample_rows(ids: list[str]):
    values = {"sample_id": ids, "dataset": ["rooms"] * len(ids), "split": ["train"] * len(ids)}
    values["scene"] = [i.rpartition("/")[0] for i in ids]
    return _table("samples", values, len(ids))


def segment_rows(ids: list[str]):
    labels = [[LABELS[(row + k) % len(LABELS)] for k in range(row % 5)] for row in range(len(ids))]
    values = {
        "sample_id": ids,
        "status": ["ok"] * len(ids),
        "label": labels,
        "score": [[1.0] * len(found) for found in labels],
        "area": [[0.1 + 0.01 * k for k in range(len(found))] for found in labels],
        "is_thing": [[True] * len(found) for found in labels],
    }
    return _table("segments", values, len(ids))


def _table(schema: str, values: dict[str, list], rows: int):
    names = schemas.schema(schema).names
    return schemas.from_columns(schema, {n: values.get(n, [None] * rows) for n in names})


def captions_job(work: WorkDir, **options: object) -> Job:
    configured = stages.bind("captions", options)
    return jobs.job(work, configured, "rooms", upstream="segments/labels")


class NoBar:
    """Progress that nobody looks at."""

    def __init__(self, title: str = "", total: int = 0):
        self.rows = 0

    def update(self, rows: int) -> None:
        self.rows += rows

    def close(self) -> None:
        pass
