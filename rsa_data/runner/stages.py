"""The row stages, in the order data flows, and the jobs that run one over one dataset.

A row stage maps a part to the same-numbered part of the next table. Its builder loads what is
heavy once a worker and returns the step, a pure function from the input parts to the output part
that knows no engine, no store and no receipt: identity.py says what it follows from, steps.py
runs it.
"""

import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..common import options
from ..common.errors import RsaDataError, UsageError
from ..datasets import index
from ..store.tables import Table, WorkDir, to_json
from .fingerprints import plain

Step = Callable[..., pa.Table]


@dataclass(frozen=True)
class Stage:
    """What the frame must know of a row stage.

    version : bumped by hand whenever the same input and options would give other content.
    module : where `build(**options) -> Step` stands, and `files(**options)` if models are used.
    schema : of the output table.
    unit : the column whose distinct values a receipt counts.
    selector : the option that names the table, `name` or `name:argument`.
    local : options that say where something lies or how fast it goes, never what comes out.
    """

    version: int
    module: str
    schema: str
    unit: str
    selector: str
    local: tuple[str, ...] = ()

    @property
    def build(self) -> Callable[..., Step]:
        """The builder; importing its module is light."""
        return import_module(self.module).build


STAGES = {
    "detect": Stage(
        1,
        "rsa_data.segments.detect",
        "segments",
        "sample_id",
        "source",
        ("model", "model_card", "threads"),
    ),
    "captions": Stage(
        1,
        "rsa_data.captions.write",
        "captions",
        "sample_id",
        "style",
        ("endpoint", "prompt", "concurrency", "rate", "prices"),
    ),
    "embed": Stage(
        1,
        "rsa_data.embeddings.embed",
        "embeddings",
        "text_id",
        "encoder",
        ("weights", "audit_head"),
    ),
    "embed-images": Stage(
        1,
        "rsa_data.embeddings.embed_images",
        "image_embeddings",
        "sample_id",
        "encoder",
        ("weights",),
    ),
    "embed-proposals": Stage(
        1, "rsa_data.embeddings.proposals", "image_embeddings", "sample_id", "order"
    ),
    "depth": Stage(1, "rsa_data.depth.measure", "depth", "sample_id", "depth_model", ("weights",)),
}

# What the frame gives to a builder that asks for it; never an option of the user's.
GIVEN = ("dataset", "root")


@dataclass(frozen=True)
class Job:
    """One row stage over one dataset: everything a worker needs, in plain values.

    options : bound options of the user; inputs : tables read, the first decides what is counted;
    root : where the dataset's files lie, or None.
    """

    work: str
    dataset: str
    stage: str
    options: dict[str, Any]
    inputs: tuple[str, ...]
    output: str
    root: str | None

    def table(self, name: str) -> Table:
        """One of the job's tables."""
        return WorkDir(self.work).table(self.dataset, name)


def name_of(choice: str) -> str:
    """`rsa-release` of `rsa-release:DIR`: the part of a choice that says what, not where.

    The argument of `hf:NAME` and `files:DIR` (depth of some model) is what was chosen, so its last
    component stays, as `hf-NAME`.
    """
    name, _, argument = choice.partition(":")
    return f"{name}-{Path(argument).name}" if argument and name in ("hf", "files") else name


def choose(work: WorkDir, dataset: str, kind: str, wanted: str | None, option: str) -> str:
    """The table `KIND/...` of a dataset: the wanted one, or the only one there is."""
    there = [name for name in work.tables(dataset) if name.startswith(kind + "/")]
    if wanted is not None:
        name = f"{kind}/{wanted}"
        if name in there:
            return name
    elif len(there) == 1:
        return there[0]
    found = ", ".join(name.removeprefix(kind + "/") for name in there) or "none"
    if wanted is None and there:
        raise UsageError(f"{dataset}: several {kind} tables: say which by {option}: {found}")
    raise RsaDataError(
        f"{work.store.location}/{dataset}: expected {kind}/{wanted or '...'}; found {found}. "
        f"Make it first: rsa-data {_MAKES[kind]} --dataset {dataset}"
    )


_MAKES = {"segments": "detect", "captions": "captions", "embeddings": "embed", "depth": "depth"}


def job(
    work: WorkDir,
    stage: str,
    dataset: str,
    given: dict[str, Any],
    *,
    root: Path | None = None,
    upstream: str | None = None,
) -> Job:
    """The job of a stage over a dataset; options are bound and names checked, nothing is loaded.

    upstream : the table that the stage reads besides samples, for captions and embed.
    """
    what = STAGES[stage]
    bound = bind(stage, given)
    name = name_of(str(bound[what.selector]))
    output = f"{what.schema}/{name}"
    inputs = ("samples",) if upstream is None else (upstream, "samples")
    if stage == "embed":
        assert upstream is not None
        output = f"embeddings/{upstream.removeprefix('captions/')}/{name}"
        inputs = (upstream,)
    elif stage == "embed-images":
        output = f"embeddings/images/{name}"
    elif stage == "embed-proposals":
        assert upstream is not None
        output = f"embeddings/proposals/{upstream.removeprefix('segments/')}"
    root = index.find_root(work, dataset, root)
    return Job(
        work.store.location, dataset, stage, bound, inputs, output, str(root) if root else None
    )


def job_of(work: WorkDir, dataset: str, table: str) -> Job:
    """The job that makes a table that is there, from what its last run has left beside it.

    Raises RsaDataError when table.json names other inputs than its stage reads.
    """
    from ..captions.write import needs_segments

    there = work.table(dataset, table)
    description = there.description()
    last = json_object(there.store.read(f"{there.path}/local.json"))
    inputs = description.get("inputs", [])
    upstream = inputs[0] if inputs and inputs[0] != "samples" else None
    given = {**description.get("options", {}), **last}
    stage = description["stage"]
    reads = stage in ("embed", "embed-proposals")
    if stage == "captions":
        reads = needs_segments(bind(stage, given)["style"])
    if reads != (upstream is not None):
        raise RsaDataError(
            f"{there}: table.json: expected the inputs of the stage {stage}, found {inputs}. "
            "--start-over makes it anew"
        )
    return job(work, stage, dataset, given, upstream=upstream)


def json_object(data: bytes | None) -> dict[str, Any]:
    """The JSON object of a file that no content depends on; {} when it is missing or damaged."""
    try:
        found = json.loads(data or b"{}")
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def remember(job: Job) -> None:
    """Keeps where the job found its files, for `job_of`; no part depends on it."""
    stage = STAGES[job.stage]
    names = (*stage.local, stage.selector)
    kept = {name: plain(value) for name, value in job.options.items() if name in names}
    output = job.table(job.output)
    output.store.write(f"{output.path}/local.json", to_json(kept))


def bind(stage: str, given: dict[str, Any]) -> dict[str, Any]:
    """The options of a stage, defaults filled in; raises UsageError, see options.bind."""
    build = STAGES[stage].build

    names = {n: p for n, p in options.parameters(build).items() if n not in GIVEN}
    for name in given:
        if name.replace("-", "_") in GIVEN:
            raise UsageError(f"{stage}: {name} is not an option of this stage")
    stub = _with_parameters(build, tuple(names))
    return options.bind(stub, given, stage)


def _with_parameters(function: Callable[..., Any], names: tuple[str, ...]) -> Callable[..., Any]:
    """A stand-in with the same docstring and only these keyword-only parameters."""
    known = options.parameters(function)

    def stub(**_: Any) -> None: ...

    stub.__doc__ = function.__doc__
    stub.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [known[name] for name in names]
    )
    return stub
