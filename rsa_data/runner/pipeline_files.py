"""Job files: stages and their non-default options, one TOML file for a whole chain.

doc = "What it is for."

[dataset.nyuv2]                      # one table a dataset, its options inside
[dataset.nyuv2.detect]               # what this dataset alone has otherwise
source = "rsa-release:../RSA"

[captions]                           # for every dataset
style = "occupancy"
[embed]
encoder = "clip-rn50"
[depth]
depth_model = "depth-anything-v2-small"
[train-head]
name = "nyu"
[evaluate]                           # several as [[train-head]] and [[evaluate]]
"""

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .. import registry
from ..common import forms, options
from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..datasets.roots import open_root
from ..store import schemas
from ..store.tables import WorkDir
from . import chains, stages
from .chains import How

_ROW_STAGES = ("detect", "captions", "embed", "embed-images", "embed-proposals", "depth")
_WHOLE = {
    "train-head": "rsa_data.heads.train.train_head:train_head",
    "evaluate": "rsa_data.evaluation.evaluate:evaluate",
    "compare": "rsa_data.evaluation.compare:compare",
    "robustness": "rsa_data.evaluation.robustness:robustness",
}
_TOP = ("doc", "dataset", *_ROW_STAGES, *_WHOLE)


_FORM = {f"{stage}?": "an object" for stage in _ROW_STAGES} | {
    "doc?": "text",
    "dataset?": {"*": {"builder?": "text", "root?": "text"}},
}


def load(path: Path, changes: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A job as a dict, every option checked against the signature that it is for.

    Parameters
    ----------
    path : a TOML file, or the name of one that is shipped (`rsa-data list jobs`).
    changes : {"embed.weights": value, "dataset.nyuv2.root": value}, put over the file.

    Raises UsageError, with file, place and nearest name, before anything is loaded or written.
    """
    shipped = schemas.shipped("pipelines") / f"{path}.toml"
    file = path if path.is_file() else shipped
    if not file.is_file():
        raise unknown("job file", str(path), [p.stem for p in shipped.parent.glob("*.toml")])
    try:
        job = tomllib.loads(file.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a TOML file: {error}") from error
    for where, value in (changes or {}).items():
        *places, last = where.split(".")
        place = job
        for name in places:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise UsageError(f"{path}: {where}: expected {name} to be a table, found {place!r}")
        place[last] = value
    for name in job:
        if name not in _TOP:
            raise UsageError(f"{path}: {unknown('table', name, _TOP)}")
    try:
        forms.check(job, _FORM, str(path))
        for name in _WHOLE:
            forms.check(_each(job, name), [{}], f"{path}.{name}")
    except RsaDataError as error:
        raise UsageError(str(error)) from error
    if not job.get("dataset"):
        raise UsageError(f"{path}: expected at least one [dataset.NAME]; found none")
    for name, entry in job["dataset"].items():
        builder, dataset_options, own = _split(entry, name)
        index.open_dataset(f"{builder}:{name}", dataset_options)
        for stage in _ROW_STAGES:
            merged = {**job.get(stage, {}), **own.get(stage, {})}
            if stage in job or stage in own:
                stages.bind(stage, merged)
    for name, target in _WHOLE.items():
        for given in _each(job, name):
            options.bind(_function(target), given, f"{path}: {name}")
    return job


def _each(job: Mapping[str, Any], step: str) -> list[dict[str, Any]]:
    """The tables of a step that may stand several times: [evaluate] or [[evaluate]]."""
    found = job.get(step, [])
    return found if isinstance(found, list) else [found]


def _function(target: str) -> Callable[..., Any]:
    return registry.resolve("step", {target: target}, target)


def _split(entry: Mapping[str, Any], name: str) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """(builder, options of the dataset, its own stage options) of a [dataset.NAME] table."""
    own = {k: v for k, v in entry.items() if isinstance(v, dict)}
    for stage in own:
        if stage not in _ROW_STAGES:
            raise unknown(f"stage in [dataset.{name}]", stage, _ROW_STAGES)
    rest = {k: v for k, v in entry.items() if k not in own and k not in ("builder", "root")}
    return entry.get("builder", name), rest, own


def run(
    work: WorkDir, job: Mapping[str, Any], how: How, tell_whole: Callable[[str, Any], None]
) -> None:
    """Runs a loaded job: the row stages over each dataset, then what works on whole tables.

    tell_whole : called with the name of such a step and what it returned.
    """
    names = []
    for name, entry in job["dataset"].items():
        builder, given, own = _split(entry, name)
        choice = name if builder == name else f"{builder}:{name}"
        merged = {s: {**job.get(s, {}), **own.get(s, {})} for s in _ROW_STAGES}
        wanted = {s for s in _ROW_STAGES if s in job or s in own}
        root = open_root(entry["root"]) if "root" in entry else None
        source = merged["detect"].get("source", "")
        chains.samples(work, choice, given, root=root, source=source)
        if "captions" in wanted:
            chains.captions(
                work,
                name,
                merged["captions"],
                how,
                segments=None,
                detect=merged["detect"],
                root=root,
            )
        elif "detect" in wanted:
            chains.stage(work, "detect", name, merged["detect"], how, root=root)
        if "embed" in wanted:
            style = stages.name_of(stages.bind("captions", merged["captions"])["style"])
            chains.embed(work, name, merged["embed"], how, style=style)
        if "embed-images" in wanted:
            chains.stage(work, "embed-images", name, merged["embed-images"], how, root=root)
        if "embed-proposals" in wanted:
            chains.proposals(work, name, merged["embed-proposals"], how)
        if "depth" in wanted:
            chains.stage(work, "depth", name, merged["depth"], how, root=root)
        names.append(name)
    if how.plan is not None:
        return
    for step, target in _WHOLE.items():
        for table in _each(job, step):
            given = {"datasets": names, **table}
            if step in ("evaluate", "robustness"):
                heads = _each(job, "train-head")
                given.setdefault("head", heads[0].get("name", "head") if heads else "head")
            bound = options.bind(_function(target), given, step)
            tell_whole(step, _function(target)(work, bar=how.bar, **bound))


def described() -> list[tuple[str, str]]:
    """(name, first sentence of doc) of every job file that is shipped."""
    files = sorted(schemas.shipped("pipelines").glob("*.toml"))
    docs = [tomllib.loads(file.read_text("utf-8")).get("doc", "") for file in files]
    return [
        (f.stem, " ".join(d.split()).partition(". ")[0]) for f, d in zip(files, docs, strict=True)
    ]
