"""The heads that a comparison trains, and the methods that they become."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

from .. import registry
from ..common import options
from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..heads.belong import Source, Tables
from ..heads.inputs import kinds
from ..store.tables import WorkDir
from .inputs import TestPart
from .methods import Method, by_head, head_method
from .scenes import one_description
from .setting import tables_of

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead


@dataclass(frozen=True)
class Entry:
    """A trained head of the comparison, by its name in the work dir and the label of its row.

    trained : the datasets it learned from. sources : its tables, by dataset.
    """

    name: str
    label: str
    seed: int
    trained: tuple[str, ...]
    head: "ScaleHead"
    sources: Mapping[str, Source]


@dataclass(frozen=True)
class Contender:
    """A row that every comparison has where all datasets have its inputs.

    label : of the row, with the names of the encoders by kind of input. reads : kinds of input.
    head : architecture; None for the usual one.
    """

    label: str
    reads: tuple[str, ...]
    head: str | None = None


# What is compared beside text, in the order of rows.
CONTENDERS = (
    Contender("image ({image})", ("image",)),
    Contender("text and image ({image})", ("text", "image"), "fusion"),
    Contender("objects", ("objects",), "objects"),
    Contender("objects without places", ("objects",), "objects-without-places"),
    Contender("objects, names only", ("objects",), "object-names"),
    Contender("text and objects", ("text", "objects"), "text-objects"),
    Contender("image ({image}) and objects", ("image", "objects"), "image-objects"),
    Contender(
        "text, image ({image}) and objects", ("text", "image", "objects"), "text-image-objects"
    ),
    Contender("detector features ({proposals})", ("proposals",), "proposals"),
)


@dataclass(frozen=True)
class Plan:
    """One head to train: its row's label, the datasets, and the options of train-head."""

    label: str
    datasets: tuple[str, ...]
    options: Mapping[str, Any]


# By kind of input, the encoders whose tables every dataset has; texts as (style, encoder).
Shared = Mapping[str, Sequence[tuple[str, str]]]


def inputs_of(
    work: WorkDir, names: Sequence[str], style: str | None, encoder: str | None
) -> Shared:
    """(style, encoder) of the embeddings that every dataset has, by kind; one for `text`.

    Raises UsageError where what is not named is not the only one, RsaDataError where there is none.
    """
    shared = set.intersection(*(set(work.tables(name)) for name in names))
    found: dict[str, list[tuple[str, str]]] = {kind: [] for kind in registry.INPUTS}
    for table in sorted(name for name in shared if name.startswith("embeddings/")):
        feed = kinds.feed(table)
        found[feed.kind].append((feed.style, feed.encoder))
    texts = [
        (own_style, own_encoder)
        for own_style, own_encoder in found["text"]
        if style in (None, own_style) and encoder in (None, own_encoder)
    ]
    if len(texts) > 1:
        there = ", ".join("/".join(text) for text in texts)
        raise UsageError(f"several embeddings of text: say which by --style and --encoder: {there}")
    if not texts:
        raise RsaDataError(
            f"{', '.join(names)}: expected embeddings of captions by one encoder in all of them; "
            f"found none. Make them first: rsa-data embed{work.option}"
        )
    return {**found, "text": texts}


def training_images(work: WorkDir, datasets: Sequence[str]) -> int:
    """How many images of these datasets may be trained on."""
    count = 0
    for dataset in datasets:
        role = index.load_dataset(work, dataset).role
        samples = work.table(dataset, "samples")
        receipts = [samples.receipt(number) for number in samples.parts()]
        count += sum(receipt.rows for receipt in receipts if role(receipt.split) == "train")
    return count


def plans(
    names: Sequence[str], shared: Shared, inputs: Sequence[str], subsets: Sequence[str] = ()
) -> list[Plan]:
    """The heads to train; text comes first.

    names : the datasets that may be trained on. shared : from `inputs_of`.
    inputs, subsets : what else was asked for, as `compare` says.
    Raises UsageError for an input of another form, a subset of others, and no dataset at all.
    """
    if not names:
        raise UsageError("compare: expected a dataset with a training split; found none")
    style, encoder = shared["text"][0]
    joint, text = tuple(names), {"style": style, "encoder": encoder}
    planned = [Plan("text", joint, text)]
    for contender in CONTENDERS:
        for chosen in product(*(shared.get(kind, ()) for kind in contender.reads)):
            planned.append(
                _contending(contender, joint, dict(zip(contender.reads, chosen, strict=True)))
            )
    planned += [_asked(given, joint) for given in inputs]
    planned.append(Plan("captions shuffled", joint, {**text, "control": "shuffled"}))
    if len(names) > 1:
        planned.append(Plan("dataset name only", joint, {**text, "control": "dataset"}))
        planned += [Plan(f"text, {d} alone", (d,), text) for d in names]
    for subset in subsets:
        chosen_sets = tuple(subset.split("+"))
        for name in chosen_sets:
            if name not in names:
                raise unknown("dataset in --subsets", name, names)
        planned.append(Plan(f"text, {' and '.join(chosen_sets)}", chosen_sets, text))
    return planned


def _contending(
    contender: Contender, joint: tuple[str, ...], chosen: Mapping[str, tuple[str, str]]
) -> Plan:
    encoders = {kind: encoder for kind, (_, encoder) in chosen.items()}
    style = chosen.get("text", next(iter(chosen.values())))[0]
    given = {"style": style, "encoder": "+".join(encoders.values())}
    if contender.head:
        given["head"] = contender.head
    return Plan(contender.label.format(**encoders), joint, given)


def _asked(given: str, joint: tuple[str, ...]) -> Plan:
    match = re.fullmatch(r"([^=]+)=([^/]+)/([^/]+)(?:/([^/]+))?", given)
    if match is None:
        raise UsageError(
            f"--inputs: expected LABEL=STYLE/ENCODER or LABEL=STYLE/ENCODER/HEAD, found {given!r}"
        )
    label, style, encoder, head = match.groups()
    own = {"style": style, "encoder": encoder} | ({"head": head} if head else {})
    return Plan(label, joint, own)


def train(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None,
    name: str,
    plan: Plan,
    common: Mapping[str, Any],
    names: Sequence[str],
) -> Entry:
    """The head of one plan, trained now or before, under the name NAME-LABEL-SEED.

    common : options that all heads of the comparison share, seed among them. names : the datasets
    to measure on.
    """
    from ..heads.checkpoint import ScaleHead
    from ..heads.train.train_head import train_head

    seed = common["seed"]
    own = f"{name}-{re.sub(r'[^a-z0-9]+', '-', plan.label.lower())}-{seed}"
    given = {**common, **plan.options, "datasets": plan.datasets, "name": own}
    trained = options.call(train_head, work, bar, **given)
    head = ScaleHead.load(trained.path)
    sources = tables_of(work, head.about, Tables(tuple(names)))
    return Entry(own, plan.label, seed, plan.datasets, head, sources)


def methods_of(
    entries: Sequence[Entry], dataset: str, parts: Sequence[TestPart]
) -> dict[str, Method]:
    """The heads on one dataset, and the text head with one description for each scene."""
    methods: dict[str, Method] = {}
    for entry in entries:
        zero = "" if dataset in entry.trained else " (zero-shot)"
        source = entry.sources[dataset]
        methods[f"{entry.label}{zero} #{entry.seed}"] = head_method(entry.head, source)
        if entry.label == "text" and source.captions:
            described = one_description(parts, source)
            if described is not None:
                methods[f"text, one description a scene{zero} #{entry.seed}"] = by_head(
                    entry.head.outputs, source, see=described
                )
    return methods
