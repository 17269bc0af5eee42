"""What a table follows from (options, model files, input parts), hence what is done and stale."""

import platform
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import Any

from ..common.digests import file_sha256
from ..common.errors import RsaDataError
from ..common.options import stored
from ..store import schemas
from ..store.tables import Description, fingerprint
from .jobs import Job, plain
from .stages import label_of


def describe(job: Job) -> Description:
    """_table.json of the job's output: what made it, as far as it can change the content.

    Model files are looked for (and fetched, where the registry knows how) and hashed here, before
    any worker starts.
    """
    stage = job.declared
    files = stage.files(**job.options)
    kept = {k: plain(v) for k, v in job.options.items() if k not in stage.local}
    if stage.selector is not None:
        kept[stage.selector] = label_of(str(kept[stage.selector]), stage.choices)
    options = stored(stage.build, kept)
    identity = _identity(job)
    known = {"identity": identity} if identity else {}
    return Description(
        **known,
        stage=job.stage,
        stage_version=stage.version,
        schema=stage.schema,
        schema_version=schemas.definition(stage.schema)["version"],
        options=options,
        files={name: file_sha256(str(path)) for name, path in files.items()},
        inputs=list(job.inputs),
        made_with=made_with(),
    )


def _identity(job: Job) -> dict[str, Any]:
    """What the content follows from beside options and files, code of the user's own included."""
    stage = job.declared
    identity = stage.identity(**job.options)
    if stage.selector is not None and stage.choices is not None:
        name = stage.choices.split(str(job.options[stage.selector]))[0]
        # Names that are in no table have a card of the user's, which is among the files.
        if name in stage.choices and (source := stage.choices.source(name)) is not None:
            identity = {**identity, **source}
    return identity


def check_read(job: Job, description: Description) -> None:
    """Raises RsaDataError where what a worker has just read is not what the description says.

    Files are replaced while a run goes on, and another machine may have other ones in their place.
    """
    paths = job.declared.files(**job.options)
    files = {name: file_sha256(str(path)) for name, path in paths.items()}
    identity = description.identity or {}
    for kind, before, now in (
        ("sha256 ", description.files, files),
        ("", identity, _identity(job)),
    ):
        for name in {**before, **now}:
            one, other = before.get(name, "none"), now.get(name, "none")
            if one != other:
                what = paths.get(name, name) if kind else f"{job.stage}: {name}"
                raise RsaDataError(
                    f"{what}: expected {kind}{one}, with which the run began; a worker found "
                    f"{other}: replaced meanwhile, or another one on the worker's machine. Nothing "
                    "was made from it, finished parts are kept: put the same one in place on all "
                    "machines, then run the same command again"
                )


def same(old: Description, new: Description) -> bool:
    """Whether two descriptions of a table promise the same content."""
    return fingerprint(old.identifying()) == fingerprint(new.identifying())


@cache
def made_with() -> dict[str, str]:
    """Versions that can change bits, for information."""
    names = ("rsa-data", "numpy", "onnxruntime", "opencv-python-headless", "pyarrow", "torch")
    versions = {name: _version(name) for name in names}
    return {"python": platform.python_version(), "machine": platform.machine(), **versions}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


def part_inputs(job: Job, number: int) -> dict[str, str]:
    """Digests of the content of a part's input parts."""
    return {name: job.table(name).receipt(number).digest for name in job.inputs}


def part_fingerprint(description: Description, inputs: dict[str, str]) -> str:
    """What a part's content follows from: the table's description and its input parts' content."""
    return fingerprint({"table": description.identifying(), "inputs": inputs})


@dataclass(frozen=True)
class Pending:
    """What is left to do of some parts.

    todo : all of these. stale : those that were made from an input that has changed since.
    gone : those whose receipt is there, but whose data is not.
    """

    todo: list[int]
    stale: list[int]
    gone: list[int]


def pending(job: Job, description: Description, numbers: list[int]) -> Pending:
    """What is left to do of the parts `numbers`."""
    output = job.table(job.output)
    done, files = set(output.parts()), set(output.store.list(output.path))
    known = [number for number in numbers if number in done]
    inputs = [job.table(name).receipts(known) for name in job.inputs]
    stale, gone = [], []
    for receipt, *sources in zip(output.receipts(known), *inputs, strict=True):
        digests = {n: of.digest for n, of in zip(job.inputs, sources, strict=True)}
        if receipt.fingerprint != part_fingerprint(description, digests):
            stale.append(receipt.part)
        elif receipt.file not in files:
            gone.append(receipt.part)
    again = {*stale, *gone}
    return Pending([n for n in numbers if n not in done or n in again], stale, gone)
