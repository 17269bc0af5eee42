"""What the commands do: each stage over one dataset, with what it needs made first."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .. import registry
from ..captions.write import needs_segments
from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..datasets.roots import is_remote
from ..segments.rsa_release import index_release
from ..store.tables import WorkDir
from . import plan as planning
from . import runs, stages
from .engines import pool
from .runs import Bar, Summary
from .status import outdated


@dataclass(frozen=True)
class How:
    """How a command runs: nothing here changes what comes out.

    tell : called with a stage's name, its dataset and its summary as soon as it has ended.
    plan : called with a stage's name, its dataset and an estimate, instead of running it.
    """

    bar: Callable[[str, int], Bar]
    tell: Callable[[str, str, Summary], None]
    split: str | None = None
    part_range: tuple[int, int] | None = None
    engine: pool.How = field(default_factory=pool.How)
    start_over: bool = False
    redo_failed: bool = False
    max_failures: float | int | None = None
    plan: Callable[[str, str, planning.Estimate], None] | None = None


def samples(
    work: WorkDir,
    choice: str,
    given: Mapping[str, Any],
    *,
    root: Path | None = None,
    source: str = "",
    start_over: bool = False,
) -> str:
    """Makes sure that a dataset is indexed and returns its name in the work dir.

    New files under the root are appended. Without a root the samples that are there stay; where
    there are none, an import that carries texts only (`rsa-release:DIR`) gives the index.

    Parameters
    ----------
    choice : a dataset of the registry, or `BUILDER:NAME`; or a name that the work dir knows.
    given : options of the dataset; none keeps those that it was indexed with.
    source : the segments that will be read.
    """
    table = work.table(choice.rpartition(":")[2], "samples")
    if start_over:
        table.start_over()
    if not given and table.exists():
        dataset = index.load_dataset(work, table.dataset)
        kept = dict(table.description()["options"])
    else:
        dataset, kept = index.open_dataset(choice, given)
    sizes = {k: kept.pop(k) for k in ("part_size", "test_part_size") if k in kept}
    found = index.find_root(work, dataset.name, root)
    if root and not is_remote(root) and not root.is_dir() and dataset.prepare is None:
        raise RsaDataError(f"--root {root}: expected a folder; there is none. See data/README.md")
    if dataset.prepare is not None:
        found = found or Path("data") / dataset.name
        if is_remote(found):
            raise UsageError(
                f"--root {found}: dataset {dataset.name} writes its files: expected a folder"
            )
        dataset.prepare(found)
    text_only = source.startswith("rsa-release:")
    if found is None and text_only and not table.complete():
        rows = index_release(Path(source.partition(":")[2]), dataset)
        index.index(work, dataset, kept, root=None, samples=rows, **sizes)
    elif found is not None or not table.complete():
        index.index(work, dataset, kept, root=found, **sizes)
    return dataset.name


def check_names(*, source: str | None = None, style: str | None = None, own: bool = False) -> None:
    """Refuses unknown segmenters and styles before anything is written.

    own : the segmenter is a model with a card of the user's own, so any name will do.
    """
    for kind, table, choice in (
        ("segmenter", registry.SEGMENTERS, None if own else source),
        ("style", registry.STYLES, style),
    ):
        if choice is not None and (name := choice.partition(":")[0]) not in table:
            raise unknown(kind, name, table)


def stage(
    work: WorkDir,
    name: str,
    dataset: str,
    options: Mapping[str, Any],
    how: How,
    *,
    root: Path | None = None,
    upstream: str | None = None,
) -> Summary:
    """Runs one row stage over one dataset and tells its summary; or plans it, see How."""
    job = stages.job(work, name, dataset, dict(options), root=root, upstream=upstream)
    if how.plan is not None:
        estimate = planning.plan(job, split=how.split, part_range=how.part_range)
        how.plan(name, dataset, estimate)
        return Summary.nothing(estimate.output)
    summary = runs.run(
        job,
        split=how.split,
        part_range=how.part_range,
        engine=how.engine,
        start_over=how.start_over,
        redo_failed=how.redo_failed,
        max_failures=how.max_failures,
        bar=how.bar,
    )
    how.tell(name, dataset, summary)
    _all_done(summary)
    return summary


def _all_done(summary: Summary) -> None:
    if summary.undone:
        number, why = next(iter(summary.undone.items()))
        raise RsaDataError(
            f"{summary.output}: {len(summary.undone)} parts are not done; part {number}: {why}. "
            "What is done is kept: run the same command again"
        )


def captions(
    work: WorkDir,
    dataset: str,
    options: Mapping[str, Any],
    how: How,
    *,
    segments: str | None,
    detect: Mapping[str, Any],
    root: Path | None = None,
) -> Summary:
    """Captions of a dataset, its segments first where they are not there yet.

    Parameters
    ----------
    segments : SOURCE as `detect` takes it; None takes the segments that are there, or the default
        model when there are none. An import brings its argument only the first time.
    detect : options of the detect stage.

    Texts to import need no segments, so none are made for them.
    """
    if not needs_segments(stages.bind("captions", dict(options))["style"]):
        return stage(work, "captions", dataset, options, how, root=root)
    there = [t for t in work.tables(dataset) if t.startswith("segments/")]
    wanted = f"segments/{stages.name_of(segments)}" if segments else None
    if wanted is None and len(there) == 1 and not detect:
        wanted = there[0]
    covered = wanted in there and set(runs.select(work, dataset, how.split, how.part_range)) <= set(
        work.table(dataset, wanted).parts()
    )
    if wanted is None or not covered or (segments and ":" in segments) or detect:
        given = {**detect, **({"source": segments} if segments else {})}
        before = replace(how, start_over=False)
        stage(work, "detect", dataset, given, before, root=root)
        wanted = f"segments/{stages.name_of(stages.bind('detect', given)['source'])}"
    return stage(work, "captions", dataset, options, how, root=root, upstream=wanted)


def embed(
    work: WorkDir, dataset: str, options: Mapping[str, Any], how: How, *, style: str | None = None
) -> Summary:
    """Embeddings of a dataset's captions: of the style asked for, or the only one there is."""
    upstream = stages.choose(work, dataset, "captions", style, "--style")
    return stage(work, "embed", dataset, options, how, upstream=upstream)


def proposals(
    work: WorkDir, dataset: str, options: Mapping[str, Any], how: How, *, source: str | None = None
) -> Summary:
    """Detector features of a dataset's segments: of the source asked for, or the only one."""
    upstream = stages.choose(work, dataset, "segments", source, "--source")
    return stage(work, "embed-proposals", dataset, options, how, upstream=upstream)


def known_datasets(work: WorkDir, wanted: tuple[str, ...]) -> list[str]:
    """The datasets asked for, or every dataset in the work dir; RsaDataError when there is none."""
    there = work.datasets()
    for name in wanted:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    if not there:
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    return list(wanted) or there


def retry_failed(work: WorkDir, datasets: list[str], how: How) -> None:
    """Does the parts with failed rows again, in the order data flows, and what came from them.

    Parts that were never done are left to their own command. Raises RsaDataError when a table was
    made by options that cannot be found again, or a part stays undone.
    """
    order = list(stages.STAGES)
    for dataset in datasets:
        made = {
            name: work.table(dataset, name).description()["stage"] for name in work.tables(dataset)
        }
        names = [name for name in made if made[name] in order]
        for name in sorted(names, key=lambda name: (order.index(made[name]), name)):
            table = work.table(dataset, name)
            failed = any(r["failed"] for r in table.receipts(table.parts()))
            if failed or outdated(work, table):
                job = stages.job_of(work, dataset, name)
                summary = runs.run(job, engine=how.engine, bar=how.bar, redo_failed=True)
                how.tell(made[name], dataset, summary)
                _all_done(summary)
