"""The heads that a comparison trains, and the methods that they become."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import UsageError
from ..parts import Work
from .inputs import TestPart
from .methods import Method, by_head, head_method
from .scenes import one_description
from .setting import tables_of

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead
    from ..heads.examples import Source


@dataclass(frozen=True)
class Entry:
    """A trained head of the comparison. trained : the datasets it learned from."""

    label: str
    seed: int
    trained: tuple[str, ...]
    head: "ScaleHead"
    sources: Mapping[str, "Source"]


def plans(
    names: Sequence[str], inputs: Sequence[str]
) -> list[tuple[str, tuple[str, ...], dict[str, Any]]]:
    """(label, datasets to train on, options of train_head) of each head; text comes first.

    Raises UsageError for an input of another form.
    """
    joint = tuple(names)
    planned: list[tuple[str, tuple[str, ...], dict[str, Any]]] = [("text", joint, {})]
    for given in inputs:
        match = re.fullmatch(r"([^=]+)=([^/]+)/([^/]+)(?:/([^/]+))?", given)
        if match is None:
            raise UsageError(
                "--inputs: expected LABEL=STYLE/ENCODER or LABEL=STYLE/ENCODER/HEAD, "
                f"found {given!r}"
            )
        label, style, encoder, head = match.groups()
        options = {"style": style, "encoder": encoder} | ({"head": head} if head else {})
        planned.append((label, joint, options))
    planned.append(("captions shuffled", joint, {"control": "shuffled"}))
    if len(names) > 1:
        planned.append(("dataset name only", joint, {"control": "dataset"}))
        planned += [(f"text, {d} alone", (d,), {}) for d in names]
    return planned


def train(
    work: Work,
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
    from ..heads.training import train_head

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
                methods[f"text, one description a scene #{entry.seed}"] = by_head(
                    entry.head, source.embeddings, source.captions, see=described
                )
    return methods
