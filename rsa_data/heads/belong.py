"""Which tables belong together: what a head's features and relative depth are made of."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..common import cards
from ..common.errors import RsaDataError
from ..store.table_names import plain_name
from ..store.tables import Table, WorkDir, fingerprint
from .description import Features
from .inputs import kinds
from .inputs.kinds import Block, Feed

# Options of the depth stage that change how fast something is computed or kept, or which pixels
# are drawn, but not what it means.
_INDIFFERENT = ("threads", "store", "runtime", "device", "pixels", "seed")
# Options of the depth stage that may differ from dataset to dataset within one head: the paper's
# own models see NYU and KITTI images at different sizes.
_PER_DATASET = ("geometry", "crop")


@dataclass(frozen=True)
class Tables:
    """Which tables of the work dir to learn from or to measure on.

    datasets : datasets of the work dir; none means all.
    style : caption style, needed when there are several.
    encoder : encoder, needed when there are several; for a head that reads several inputs one for
        each, as TEXT+IMAGE.
    depth_model : relative-depth model, needed when there are several.
    """

    datasets: tuple[str, ...] = ()
    style: str | None = None
    encoder: str | None = None
    depth_model: str | None = None

    def __post_init__(self) -> None:
        for name in ("style", "encoder", "depth_model"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, plain_name(given))


@dataclass(frozen=True)
class Source:
    """The tables of one dataset that a head learns from or is measured on.

    inputs : in the order in which their rows stand side by side.
    """

    dataset: str
    depth: str
    inputs: tuple[Feed, ...]

    @property
    def captions(self) -> str:
        """The captions table of the first input that has one, or nothing."""
        return next((feed.captions for feed in self.inputs if feed.captions), "")

    @property
    def tables(self) -> list[str]:
        """Names of all tables, samples first and depth last."""
        names = ["samples", *(table for feed in self.inputs for table in feed.tables), self.depth]
        return list(dict.fromkeys(names))

    def read(self, work: WorkDir, number: int, variant: int | None = None) -> list[Block]:
        """Each input of every row of samples of a part; see `Feed.read`."""
        return [feed.read(work, self.dataset, number, variant) for feed in self.inputs]


def features_of(work: WorkDir, source: Source) -> Features:
    """What the features of a source are: of its first input, and of those beside it."""
    first, *others = [feed.identity(work, source.dataset) for feed in source.inputs]
    encoder = "+".join(str(one["encoder"]) for one in (first, *others))
    values = {**first, "encoder": encoder} | ({"beside": others} if others else {})
    return Features.of(values)


def kinds_of(features: Features) -> tuple[str, ...]:
    """Which kinds of input features are, in their order."""
    beside = features.beside or []
    return tuple(kinds.of_style(one.style) for one in (features, *beside))


def depth_identity(table: Table) -> tuple[dict[str, Any], dict[str, Any]]:
    """What y is: (model, its options and files; the geometry this dataset's images had).

    The file stands with the geometry where the model's card says that it may be another one for
    each dataset.
    """
    description = table.description()
    options = {k: v for k, v in description.options.items() if k not in _INDIFFERENT}
    geometry = {key: options.pop(key, None) for key in _PER_DATASET}
    files = description.files
    if files and _file_by_dataset(str(options.get("depth_model"))):
        geometry["files"], files = files, {}
    model = {
        "model": table.name.partition("/")[2],
        "options": options,
        "files": files,
        "stage_version": description.stage_version,
    }
    return model, geometry


def _file_by_dataset(model: str) -> bool:
    shipped = (cards.CARDS / f"{model}.toml").is_file()
    return shipped and bool(cards.card_of("relative-depth", model).settings.get("file_by_dataset"))


def same(kind: str, found: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any]:
    """The identity that all have; found: where -> identity. Raises RsaDataError otherwise.

    What is None in the first is not known there (an imported head) and goes with anything.
    """
    (first, identity), *others = found.items()
    for where, other in others:
        for key in identity.keys() | other.keys():
            mine, theirs = identity.get(key), other.get(key)
            if key == "options" and mine and theirs:
                # An option that a head does not know of came after it, or was not recorded.
                theirs = {name: theirs.get(name) for name in mine}
            if mine is not None and mine != theirs:
                raise RsaDataError(
                    f"{kind} that do not belong together: {key} is {mine!r} in "
                    f"{first} and {theirs!r} in {where}. Make them again with the same "
                    "options, or train on one dataset at a time with --datasets"
                )
    return identity


def current(work: WorkDir, source: Source, number: int) -> dict[str, str]:
    """Digests of the part in each table of a source, by table.

    Raises RsaDataError when a table has no such part yet, or made it from another part than the
    one that lies there now.
    """
    receipts = {name: work.table(source.dataset, name).receipt(number) for name in source.tables}
    for name, receipt in receipts.items():
        for input_name, digest in receipt.inputs.items():
            if input_name in receipts and receipts[input_name].digest != digest:
                raise RsaDataError(
                    f"{source.dataset}/{name} part {number} was made from another {input_name} "
                    "part than the one that lies there now: run its stage again"
                )
    return {name: receipt.digest for name, receipt in receipts.items()}


def together(digests: list[dict[str, str]]) -> dict[str, str]:
    """One digest a table of the digests of its parts, in the order given."""
    return {name: fingerprint([part[name] for part in digests]) for name in digests[0]}
