"""What a row stage is: one `Stage` object declares everything that the rest of the project needs.

A row stage maps a part to the same-numbered part of the next table. Its builder loads what is
heavy, once a worker, and returns the step: a pure function from the input parts to the output part
that knows no engine, no store and no receipt. To add a stage, write such an object beside its
builder and name it in `registry.STAGES`; its command, `rsa-data run`, `plan`, `retry-failed`,
`status` and `verify` follow from it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..common.entries import Entries
from ..datasets.dataset import Dataset

Step = Callable[..., pa.Table]
Options = dict[str, Any]

# What the runner passes to a builder that has such a parameter; never an option of the user's.
GIVEN = ("dataset", "root", "images", "catalogue")


@dataclass(frozen=True)
class Reads:
    """The table that a stage reads besides samples.

    kind : one of the tables KIND/LABEL is read.
    option : the option of the command that chooses among them, such as "segments".
    made_first : whether the command also indexes the dataset, and runs the stage that makes this
        table, where that has not been done.
    with_samples : whether the step takes the samples as its second table.
    needed : bound options -> whether the table is read at all.
    """

    kind: str
    option: str
    made_first: bool = False
    with_samples: bool = True
    needed: Callable[[Options], bool] = lambda options: True


@dataclass(frozen=True)
class Notes:
    """What a stage has to say of its output after a run.

    columns : of the output table that `write` looks at.
    write : (tables with these columns, one part of each input, **options) -> sentences. It is
        given the dataset and its root where it has keyword-only parameters of these names.
    """

    columns: tuple[str, ...]
    write: Callable[..., list[str]]


def _nothing(**options: Any) -> dict[str, Any]:
    return {}


def _by_selector(**options: Any) -> str | None:
    return None


def _accepted(**options: Any) -> None:
    """Nothing to refuse."""


def _as_bound(options: Options, there: Options | None) -> Options:
    return options


def _no_samples(choice: str, dataset: Dataset) -> pa.Table | None:
    return None


@dataclass(frozen=True)
class Stage:
    """A row stage. Hooks take the bound options as keyword arguments.

    name : of the stage, which is the name of its command.
    version : raised by hand whenever the same input and options would give other content.
    build : (**options) -> Step; its keyword-only parameters are the options of the stage, and its
        docstring describes them.
    help : help text of the command; its first line is shown in lists, its block is an example.
    next : what to run afterwards; {dataset} stands for the dataset's name. Options that choose
        among several tables are added.
    schema : of the output table.
    folder : where output tables lie, FOLDER/LABEL; {label} in it stands for the label of the table
        that is read.
    selector : the option whose value, `NAME` or `NAME:ARGUMENT`, is the default label. None: the
        label of the table that is read.
    label : the default label by other options, such as a card's name; None: by `selector`.
    choices : the names that the selector takes.
    reads : the table that is read besides samples, if there is one.
    unit : column whose distinct values a receipt counts; noun : what people call them.
    models : whether a model's arithmetic decides the content, so that it may differ in its last
        digits between types of CPU.
    local : options that say where something lies or how fast it goes, never what comes out.
    files : the files whose bytes decide the content, by name; may download them.
    identity : what else the content follows from, such as versions and vocabularies.
    notes : sentences for the summary of a run.
    check : raises UsageError for options that cannot be meant, before anything is written.
    settle : (bound options, those of the table where it is there already) -> the options with what
        this machine decides, such as a precision, decided once for a table.
    index : (the selector's value, dataset) -> samples of a dataset without files, or None.
    """

    name: str
    version: int
    build: Callable[..., Step]
    help: str
    next: str
    schema: str
    folder: str
    selector: str | None
    choices: Entries | None = None
    label: Callable[..., str | None] = _by_selector
    reads: Reads | None = None
    unit: str = "sample_id"
    noun: str = "samples"
    models: bool = False
    local: tuple[str, ...] = ()
    files: Callable[..., dict[str, Path]] = _nothing
    identity: Callable[..., dict[str, Any]] = _nothing
    notes: Notes | None = None
    check: Callable[..., None] = _accepted
    settle: Callable[[Options, Options | None], Options] = _as_bound
    index: Callable[[str, Dataset], pa.Table | None] = _no_samples

    @property
    def kind(self) -> str:
        """First folder of its tables, such as segments: what `Reads.kind` of other stages names."""
        return self.folder.partition("/")[0]

    @property
    def begins(self) -> bool:
        """Whether its command can be the first one on a dataset, and indexes it."""
        return self.reads is None or self.reads.made_first
