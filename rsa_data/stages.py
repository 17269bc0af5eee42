"""The row stages, in the order data flows, and what it takes to run one on one part.

A row stage maps a part to the same-numbered part of the next table. Its builder loads what is
heavy once a worker and returns the step, a pure function from the input parts to the output part
that knows no engine, no store and no receipt: those stand here.
"""

import hashlib
import inspect
import json
import platform
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from . import index, options, tables
from .errors import RsaDataError, TransientError, UsageError
from .parts import Parts, Work, fingerprint, to_json

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
        "rsa_data.segmenters.detect",
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
        "rsa_data.encoders.embed",
        "embeddings",
        "text_id",
        "encoder",
        ("weights", "audit_head"),
    ),
    "embed-images": Stage(
        1,
        "rsa_data.encoders.embed_images",
        "image_embeddings",
        "sample_id",
        "encoder",
        ("weights",),
    ),
    "embed-proposals": Stage(
        1, "rsa_data.encoders.proposals", "image_embeddings", "sample_id", "order"
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

    def table(self, name: str) -> Parts:
        """One of the job's tables."""
        return Work(self.work).table(self.dataset, name)


def name_of(choice: str) -> str:
    """`rsa-release` of `rsa-release:DIR`: the part of a choice that says what, not where.

    The argument of `hf:NAME` and `files:DIR` (depth of some model) is what was chosen, so its last
    component stays, as `hf-NAME`.
    """
    name, _, argument = choice.partition(":")
    return f"{name}-{Path(argument).name}" if argument and name in ("hf", "files") else name


def choose(work: Work, dataset: str, kind: str, wanted: str | None, option: str) -> str:
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
    work: Work,
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


def job_of(work: Work, dataset: str, table: str) -> Job:
    """The job that makes a table that is there, from what its last run has left beside it."""
    there = work.table(dataset, table)
    description = there.description()
    last = json.loads(there.store.read(f"{there.path}/local.json") or b"{}")
    inputs = description["inputs"]
    upstream = inputs[0] if inputs[0] != "samples" else None
    given = {**description["options"], **last}
    return job(work, description["stage"], dataset, given, upstream=upstream)


def remember(job: Job) -> None:
    """Keeps where the job found its files, for `job_of`; no part depends on it."""
    stage = STAGES[job.stage]
    names = (*stage.local, stage.selector)
    kept = {name: _plain(value) for name, value in job.options.items() if name in names}
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


def describe(job: Job) -> dict[str, Any]:
    """table.json of the job's output: what made it, as far as it can change the content.

    Model files are looked for (and fetched, where the registry knows how) and hashed here, before
    any worker starts.
    """
    stage = STAGES[job.stage]
    module = import_module(stage.module)
    files = module.files(**job.options) if hasattr(module, "files") else {}
    identity = {k: _plain(v) for k, v in job.options.items() if k not in stage.local}
    identity[stage.selector] = name_of(str(identity[stage.selector]))
    # What else the content follows from, where a module has such: versions, vocabularies.
    known = {"identity": module.identity(**job.options)} if hasattr(module, "identity") else {}
    return {
        **known,
        "stage": job.stage,
        "stage_version": stage.version,
        "schema": stage.schema,
        "schema_version": tables.definition(stage.schema)["version"],
        "options": identity,
        "files": {name: file_sha256(str(path)) for name, path in files.items()},
        "inputs": list(job.inputs),
        "made_with": made_with(),
    }


# Parts that notes look at, evenly over the table: enough for shares, cheap for any number.
_NOTED = 20


def notes(job: Job, numbers: list[int]) -> list[str]:
    """What the stage's module has to say of the parts `numbers`: sentences for the summary."""
    module = import_module(STAGES[job.stage].module)
    if not numbers or not hasattr(module, "notes"):
        return []
    step = -(-len(numbers) // _NOTED)
    made = (job.table(job.output).read(n, columns=module.NOTED) for n in numbers[::step])
    inputs = [job.table(name).read(numbers[len(numbers) // 2]) for name in job.inputs]
    return module.notes(made, *inputs, **job.options)


def _plain(value: Any) -> Any:
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


@cache
def file_sha256(path: str) -> str:
    """sha256 of a file, read once a process."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
    return {name: job.table(name).receipt(number)["digest"] for name in job.inputs}


def part_fingerprint(description: dict[str, Any], inputs: dict[str, str]) -> str:
    """What a part's content follows from: the table's description and its input parts' content."""
    what = {key: value for key, value in description.items() if key != "made_with"}
    return fingerprint({"table": what, "inputs": inputs})


def build_step(job: Job) -> Step:
    """Loads what the stage needs; called once a worker."""
    build = STAGES[job.stage].build
    known = options.parameters(build)
    given: dict[str, Any] = {}
    if "dataset" in known:
        given["dataset"] = index.load_dataset(Work(job.work), job.dataset)
    if "root" in known:
        given["root"] = Path(job.root) if job.root else None
    return build(**given, **job.options)


def run_part(
    job: Job, step: Step, description: dict[str, Any], number: int, *, redo: bool = False
) -> dict[str, Any]:
    """Reads the input parts, runs the step, accounts for every row, commits; gives the receipt.

    redo : replace the part although it is there, made from the same input.

    Raises TransientError when another run has changed an input part meanwhile.
    """
    stage, output = STAGES[job.stage], job.table(job.output)
    receipts = {name: job.table(name).receipt(number) for name in job.inputs}
    inputs = [
        job.table(name).read(number, receipt=receipt, check=True)
        for name, receipt in receipts.items()
    ]
    made = step(*inputs)
    counts = account(inputs[0], made, stage.unit, f"{job.dataset}/{job.output} part {number}")
    digests = {name: receipt["digest"] for name, receipt in receipts.items()}
    if part_inputs(job, number) != digests or not same(output.description(), description):
        raise TransientError(
            f"{output}: another run changed the input or the options of part {number} meanwhile. "
            "Let it end, then run the same command again"
        )
    return output.commit(
        number,
        made,
        {
            **counts,
            **_measured(made),
            "split": job.table("samples").receipt(number)["split"],
            "inputs": digests,
            "fingerprint": part_fingerprint(description, digests),
        },
        redo=redo,
    )


def _measured(made: pa.Table) -> dict[str, Any]:
    """What a step measured of its own work: JSON under `audit` in its table's metadata."""
    audit = (made.schema.metadata or {}).get(b"audit")
    return {"audit": json.loads(audit)} if audit else {}


def same(old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Whether two descriptions of a table promise the same content."""
    return fingerprint({**old, "made_with": None}) == fingerprint({**new, "made_with": None})


def account(before: pa.Table, after: pa.Table, unit: str, where: str) -> dict[str, int]:
    """ok, failed and skipped units of a part; they are all that came in, or RsaDataError.

    A unit of `before` that did not end well there is skipped when `after` has no row for it.
    """
    came, went = pc.unique(before[unit]), pc.unique(after[unit])
    if "status" in after.column_names:
        status = after["status"]
        failed = pc.sum(pc.equal(status, "failed"), min_count=0).as_py()
        skipped = pc.sum(pc.equal(status, "skipped"), min_count=0).as_py()
        ok = len(after) - failed - skipped
    else:
        ok, failed, skipped = len(went), 0, 0
    if "status" in before.column_names:
        gone = before.filter(pc.not_equal(before["status"], "ok"))[unit]
        skipped += pc.sum(pc.invert(pc.is_in(gone, went)), min_count=0).as_py()
    strangers = pc.sum(pc.invert(pc.is_in(went, came)), min_count=0).as_py()
    if ok + failed + skipped != len(came) or strangers:
        raise RsaDataError(
            f"{where}: {len(came)} rows came in, but {ok} ok + {failed} failed + {skipped} skipped "
            f"came out, {strangers} of them unknown: rows were lost or made up. Nothing was written"
        )
    return {"ok": ok, "failed": failed, "skipped": skipped}


def pending(job: Job, description: dict[str, Any], numbers: Iterable[int]) -> tuple[list, list]:
    """(parts to do, those of them that were done before from an input that has changed since)."""
    output = job.table(job.output)
    done = set(output.parts())
    todo, stale = [], []
    for number in numbers:
        if number not in done:
            todo.append(number)
        elif output.receipt(number)["fingerprint"] != part_fingerprint(
            description, part_inputs(job, number)
        ):
            todo.append(number)
            stale.append(number)
    return todo, stale
