"""The heads that a comparison trains, and the methods that they become."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..store.tables import WorkDir
from .inputs import TestPart
from .methods import Method, by_head, head_method
from .scenes import one_description
from .setting import tables_of

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead
    from ..heads.train.examples import Source


# What stands in the place of a caption style where embeddings are of images, or of the objects
# that a detector found.
IMAGES, PROPOSALS = "images", "proposals"


@dataclass(frozen=True)
class Entry:
    """A trained head of the comparison. trained : the datasets it learned from."""

    label: str
    seed: int
    trained: tuple[str, ...]
    head: "ScaleHead"
    sources: Mapping[str, "Source"]


def inputs_of(
    work: WorkDir, names: Sequence[str], style: str | None, encoder: str | None
) -> tuple[str, str, list[tuple[str, str]]]:
    """The captions' style, the text encoder, and (kind, encoder) of what else every dataset has.

    kind : images or proposals.
    Raises UsageError where what is not named is not the only one, RsaDataError where there is none.
    """
    shared = set.intersection(*(set(work.tables(name)) for name in names))
    found = sorted(name.split("/")[1:] for name in shared if name.startswith("embeddings/"))
    texts = [
        (own_style, own_encoder)
        for own_style, own_encoder in found
        if own_style not in (IMAGES, PROPOSALS)
        and style in (None, own_style)
        and encoder in (None, own_encoder)
    ]
    if len(texts) > 1:
        there = ", ".join("/".join(text) for text in texts)
        raise UsageError(f"several embeddings of text: say which by --style and --encoder: {there}")
    if not texts:
        raise RsaDataError(
            f"{', '.join(names)}: expected embeddings of captions by one encoder in all of them; "
            "found none. Make them first: rsa-data embed"
        )
    others = [(kind, name) for kind, name in found if kind in (IMAGES, PROPOSALS)]
    return *texts[0], others


def has_training(work: WorkDir, dataset: str) -> bool:
    """Whether a dataset has images that may be trained on."""
    tests = index.load_dataset(work, dataset).test_splits
    samples = work.table(dataset, "samples")
    return any(samples.receipt(n).split not in tests for n in samples.parts())


def plans(
    names: Sequence[str],
    style: str,
    encoder: str,
    others: Sequence[tuple[str, str]],
    inputs: Sequence[str],
    subsets: Sequence[str] = (),
) -> list[tuple[str, tuple[str, ...], dict[str, Any]]]:
    """(label, datasets to train on, options of train_head) of each head; text comes first.

    names : the datasets that may be trained on. style, encoder, others : from `inputs_of`.
    inputs, subsets : what else was asked for, as `compare` says.
    Raises UsageError for an input of another form, a subset of others, and no dataset at all.
    """
    if not names:
        raise UsageError("compare: expected a dataset with a training split; found none")
    joint, text = tuple(names), {"style": style, "encoder": encoder}
    planned: list[tuple[str, tuple[str, ...], dict[str, Any]]] = [("text", joint, text)]
    for kind, name in others:
        if kind == PROPOSALS:
            options = {"style": PROPOSALS, "encoder": name, "head": "proposals"}
            planned.append((f"detector features ({name})", joint, options))
            continue
        both = {"style": style, "encoder": f"{encoder}+{name}", "head": "fusion"}
        planned.append((f"image ({name})", joint, {"style": IMAGES, "encoder": name}))
        planned.append((f"text and image ({name})", joint, both))
    for given in inputs:
        match = re.fullmatch(r"([^=]+)=([^/]+)/([^/]+)(?:/([^/]+))?", given)
        if match is None:
            raise UsageError(
                "--inputs: expected LABEL=STYLE/ENCODER or LABEL=STYLE/ENCODER/HEAD, "
                f"found {given!r}"
            )
        label, own_style, own_encoder, head = match.groups()
        options = {"style": own_style, "encoder": own_encoder} | ({"head": head} if head else {})
        planned.append((label, joint, options))
    planned.append(("captions shuffled", joint, {**text, "control": "shuffled"}))
    if len(names) > 1:
        planned.append(("dataset name only", joint, {**text, "control": "dataset"}))
        planned += [(f"text, {d} alone", (d,), text) for d in names]
    for subset in subsets:
        chosen = tuple(subset.split("+"))
        for name in chosen:
            if name not in names:
                raise unknown("dataset in --subsets", name, names)
        planned.append((f"text, {' and '.join(chosen)}", chosen, text))
    return planned


def train(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None,
    name: str,
    label: str,
    seed: int,
    chosen: tuple[str, ...],
    options: Mapping[str, Any],
    names: Sequence[str],
) -> Entry:
    """The head of one plan, trained now or before, under the name NAME-LABEL-SEED."""
    from ..heads.checkpoint import ScaleHead
    from ..heads.train.train_head import train_head

    own = f"{name}-{re.sub(r'[^a-z0-9]+', '-', label.lower())}-{seed}"
    trained = train_head(work, bar, datasets=chosen, name=own, seed=seed, **options)
    head = ScaleHead.load(trained.path)
    return Entry(label, seed, chosen, head, tables_of(work, head.description, names))


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
            described = one_description(parts, source.embeddings, source.captions)
            if described is not None:
                methods[f"text, one description a scene{zero} #{entry.seed}"] = by_head(
                    entry.head, source.embeddings, source.captions, see=described
                )
    return methods
