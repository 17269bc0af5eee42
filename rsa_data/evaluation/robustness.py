"""How a head's error moves when the description is wrong or poor."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ..common.errors import UsageError
from ..common.options import accepts_old_names
from ..common.ranges import Count
from ..datasets import labels
from ..heads import belong, redescribed
from ..heads.belong import Source, Tables
from ..heads.inputs.kinds import Block, Feed
from ..heads.inputs.objects import Objects
from ..store.table_names import head_folder
from ..store.tables import WorkDir
from . import output
from .evaluate import Evaluation
from .inputs import TestPart, rows_of
from .methods import Method, by_head
from .options import Measuring
from .rows import measure
from .setting import parts_of, rules_of, tables_of, with_split
from .summary import summarise

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead

# Options of the captions stage, and which variant to take: 0 is the plain caption of these
# options, 1 an augmented one, whose objects always stand in another order.
_NONE = {"delete": 0.0, "delete_by_area": None, "replace": 0.0, "insert": 0}
CHANGES: dict[str, tuple[dict[str, Any], int]] = {
    "plain": ({}, 0),
    "order swapped": (_NONE, 1),
    "a fifth deleted": (_NONE | {"delete": 0.2}, 1),
    "half deleted": (_NONE | {"delete": 0.5}, 1),
    "a fifth replaced": (_NONE | {"replace": 0.2}, 1),
    "half replaced": (_NONE | {"replace": 0.5}, 1),
    # Row 8 of the paper's table 5: indoor described as outdoor, and the reverse for streets.
    "{here} described as {there}": (_NONE | {"replace": 1.0}, 1),
    # By objects of the same domain.
    "all replaced": (_NONE | {"replace": 1.0, "domain": "own"}, 1),
    "1 wrong added": (_NONE | {"insert": 1}, 1),
    "3 wrong added": (_NONE | {"insert": 3}, 1),
    "things only": ({"objects": "things"}, 0),
    "background only": ({"objects": "background"}, 0),
    "nothing found": ({}, 0),
}
# What a head that reads objects is told less of: a bare list of names, as people write one, counts
# nothing and says neither how large an object looks nor where it is.
OBJECT_CHANGES: dict[str, Callable[[Objects], Objects]] = {
    "places hidden": lambda objects: objects.hidden(places=True),
    "shares and places hidden": lambda objects: objects.hidden(shares=True, places=True),
    "list of names": lambda objects: objects.once().hidden(shares=True, places=True),
}
# Datasets that reach farther than this (the largest halls do not) are streets: what is wrong in
# them comes from rooms.
_INDOOR_METRES = 60.0


@accepts_old_names("robustness")
def robustness(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    head: str = "head",
    datasets: tuple[str, ...] = (),
    encoder_weights: Path | None = None,
    seed: Count = 0,
    measuring: Measuring = Measuring(),
) -> Evaluation:
    """Measures a head on the same images with descriptions that are wrong or poor.

    Objects are deleted, swapped, replaced or added, only things or only background is described,
    nothing is found; captions are written and encoded again, as the head's own were, and objects
    listed again for heads that read them, which are measured on bare lists of names too. Other
    captions of the dataset that are embedded by the same encoder (such as natural ones) are
    measured too.

    Parameters
    ----------
    head : name of a head in the work dir.
    datasets : datasets of the work dir; none means all that have the split.
    encoder_weights : file of the text encoder's weights, where it is not found by itself.
    seed : of what is deleted, replaced and added.

    Writes metrics.parquet and the summary to WORK/heads/NAME/robustness/PROTOCOL. Raises as
    `evaluate` does, and RsaDataError where descriptions do not come from segments.
    """
    from ..heads.checkpoint import ScaleHead

    protocol, split = measuring.protocol, measuring.split
    now = output.heads_now(work, (head,))
    loaded = ScaleHead.load(f"{work.store.location}/{head_folder(head)}")
    reads = belong.kinds_of(loaded.about.features)
    if loaded.about.control != "none":
        raise UsageError(f"--head {head}: a control does not read the description")
    if not {"text", "objects"} & set(reads):
        raise UsageError(
            f"--head {head}: expected a head that reads captions or objects; it reads "
            f"{' and '.join(reads)}"
        )
    names = with_split(work, datasets, split)
    found = []
    for name, source in tables_of(work, loaded.about, Tables(tuple(names))).items():
        rule = rules_of(work, name, protocol, measuring.beyond)
        methods = robustness_methods(
            work, loaded, source, max_depth=rule.max_depth, weights=encoder_weights, seed=seed
        )
        found.append(measure(parts_of(work, name, source.depth, split), methods, rule, bar))
    table = pa.concat_tables(found)
    rows = summarise(table, measuring.draws, synthetic=labels.synthetic_of(work, names))
    plain = {row.dataset: row.mean["abs_rel"] for row in rows if row.method == "plain" and row.mean}
    said = ["AbsRel against that of the plain captions:"] + [
        f"{row.dataset}: {row.method}: {row.mean['abs_rel'] / plain[row.dataset] - 1:+.1%}"
        for row in rows
        if row.mean and row.method != "plain" and row.dataset in plain
    ]
    said += labels.note({row.dataset for row in rows if row.synthetic})
    folder = f"heads/{head}/robustness/{output.folder_name(measuring, datasets)}"
    title = f"head {head}, descriptions changed: protocol {protocol}, {split} split"
    files = output.Summary(title, rows, said).files()
    files["metrics.parquet"] = output.to_parquet(table)
    output.write(work, folder, files, output.record_of(now, names, measuring))
    text = f"{files['summary.txt'].decode()}\nin {work.store.location}/{folder}"
    return Evaluation(table, rows, text, folder)


def robustness_methods(
    work: WorkDir,
    head: "ScaleHead",
    source: Source,
    *,
    max_depth: float,
    weights: Path | None,
    seed: int = 0,
) -> dict[str, Method]:
    """A method for each change to the descriptions of a dataset's test images.

    Captions are written and encoded as the head's own tables say, objects listed from the same
    segments; those that replace others or are added come from the other domain: streets in rooms,
    rooms in streets. A head that reads both gets the same changes in both. Also each other captions
    table of the dataset that was embedded by the same encoder, such as natural captions. Raises
    RsaDataError when the descriptions do not come from segments.
    """
    inputs = redescribed.inputs(work, source, weights)
    indoors = max_depth <= _INDOOR_METRES
    own, wrong = ("indoor", "street") if indoors else ("street", "indoor")
    here, there = ("indoor", "outdoor") if indoors else ("outdoor", "indoor")
    methods = {}
    for name, (change, variant) in CHANGES.items():
        options = {"domain": wrong, "seed": seed, **change}
        if options["domain"] == "own":
            options["domain"] = own
        changed = partial(
            inputs.read, options=options, variant=variant, nothing=name == "nothing found"
        )
        read = partial(_seen, changed)
        methods[name.format(here=here, there=there)] = by_head(head.outputs, source, read=read)
    if inputs.list_objects:
        for name, less in OBJECT_CHANGES.items():
            read = partial(_seen, partial(inputs.listed, less=less))
            methods[name] = by_head(head.outputs, source, read=read)
    return methods | (other_captions(work, head, source) if inputs.encode else {})


def _seen(
    blocks: Callable[[WorkDir, int], Sequence[Block]], part: TestPart
) -> tuple[np.ndarray, np.ndarray]:
    return rows_of(blocks(part.work, part.number))


def other_captions(work: WorkDir, head: "ScaleHead", source: Source) -> dict[str, Method]:
    """The head on the dataset's other captions that its encoder has embedded, by style."""
    own = _text(source)
    found = {}
    for name in work.tables(source.dataset):
        kind, _, style = name.partition("/")
        other = Feed("text", f"embeddings/{style}/{own.encoder}", name)
        if kind == "captions" and other != own and _has(work, source, other):
            feeds = tuple(other if feed == own else feed for feed in source.inputs)
            found[f"captions {style}"] = by_head(head.outputs, replace(source, inputs=feeds))
    return found


def _has(work: WorkDir, source: Source, other: Feed) -> bool:
    """Whether a table is there and made as the head's own embeddings are."""
    table = work.table(source.dataset, other.table)
    if not table.exists():
        return False
    there, own = (
        table.description(),
        work.table(source.dataset, _text(source).table).description(),
    )
    same = ("options", "files", "stage_version")
    return all(getattr(there, key) == getattr(own, key) for key in same)


def _text(source: Source) -> Feed:
    return next(feed for feed in source.inputs if feed.kind == "text")
