"""The command to type next, whole: what a work dir holds decides which, and with which options."""

import shlex
from itertools import combinations
from typing import TYPE_CHECKING, Any

from .. import registry
from ..common import own_code
from ..common.entries import Entries
from ..common.errors import RsaDataError
from ..heads.description import Description, read
from ..runner import stages
from ..runner.stage import Stage
from ..store.tables import WorkDir
from ..store.unchanging import unchanging

if TYPE_CHECKING:
    from ..heads.belong import Tables


def after(work: WorkDir, stage: Stage, dataset: str, output: str) -> str:
    """The command that follows a stage, whose table `output` of a dataset has just been made."""
    work = unchanging(work)
    command = stage.next.format(dataset=shlex.quote(dataset))
    following = stages.known(command.partition(" ")[0])
    if following is None:
        return _training(work, command, dataset, output)
    if following.reads is not None and following.reads.kind == stage.kind:
        several = sum(name.startswith(f"{stage.kind}/") for name in work.tables(dataset)) > 1
        label = shlex.quote(output.rpartition("/")[2])
        return command + (f" --{following.reads.option} {label}" if several else "")
    # A table that does not come from this one may be there already.
    done = [n for n in work.tables(dataset) if n.startswith(f"{following.kind}/")]
    done = [name for name in done if _is_whole(work, dataset, name)]
    return after(work, following, dataset, done[0]) if done else command


def after_training(work: WorkDir, head: str) -> str:
    """The command that follows train-head: evaluate where there are tables to measure it on."""
    from ..evaluation.setting import parts_of, tables_of, with_split
    from ..heads.belong import Tables

    try:
        names = with_split(work, (), "test")
    except RsaDataError:
        return use(work, head)
    good = []
    for name in names:
        try:
            source = tables_of(work, _about(work, head), Tables((name,)))[name]
            parts_of(work, name, source.depth, "test")
            good.append(name)
        except RsaDataError:
            continue
    if not good:
        return use(work, head)
    some = good if len(good) < len(names) else []
    return f"evaluate --head {shlex.quote(head)}" + "".join(
        f" --datasets {shlex.quote(name)}" for name in some
    )


def use(work: WorkDir, head: str) -> str:
    """The command that shows what a head says: of a caption, or in the report where it needs a
    photo."""
    from ..heads.reading import reads

    if not {"text", "objects"}.issuperset(reads(_about(work, head).plain())):
        return "report"
    return f"predict --head {shlex.quote(head)} --caption {example_caption(work, head)}"


# A caption of the release's structured texts, for heads of which no captions are known.
_CAPTION = "An image with a bed, a wall, and two pillows."


def example_caption(work: WorkDir, head: str) -> str:
    """A caption that the head knows, quoted for a shell: the first one of its training set."""
    for dataset, used in _about(work, head).trained_on.items():
        for name in used.tables:
            table = work.table(dataset, name)
            if name.startswith("captions/") and (parts := table.parts()):
                texts = table.read(parts[0], ["text"])["text"].to_pylist()
                # "An image." is what is said where nothing was found.
                return shlex.quote(next((t for t in texts if t != "An image."), _CAPTION))
    return shlex.quote(_CAPTION)


def code_of_head(work: WorkDir, head: str) -> list[str]:
    """The code that is not this package's which a head and its tables name, `module:attribute`."""
    from ..heads.train.plan import Described

    about, found = _about(work, head), list[str]()
    table = work.table("heads", head)
    if about.training and table.exists():
        found += table.described(Described).code or {}
    for dataset, used in about.trained_on.items():
        if dataset in work.datasets():
            found += code_of_dataset(work, dataset)
            for name in used.tables:
                if (made := work.table(dataset, name)).exists():
                    found += [(made.description().identity or {}).get("code", "")]
    tables = (entries for entries in vars(registry).values() if isinstance(entries, Entries))
    installed = {entry.target for table in tables for entry in table.installed().values()}
    return [word for word in dict.fromkeys(found) if ":" in word and word not in installed]


def code_of_dataset(work: WorkDir, dataset: str) -> list[str]:
    """The same of a dataset's own definition."""
    builder = str(work.table(dataset, "samples").description().options.get("dataset"))
    return [] if builder in registry.DATASETS.installed() else [builder] * (":" in builder)


def with_code(command: str, code: list[str]) -> str:
    """A command line, after an assignment of RSA_DATA_CODE where the environment lacks some."""
    named = own_code.named()
    missing = [word for word in dict.fromkeys(code) if word not in named]
    words = ",".join([*named, *missing])
    return f"{own_code.CODE}={shlex.quote(words)} {command}" if missing else command


def _training(work: WorkDir, command: str, dataset: str, output: str) -> str:
    """`train-head` with the options that choose among the tables there are."""
    from ..heads.belong import Tables
    from ..heads.inputs import kinds

    names = work.tables(dataset)
    embeddings = [name for name in names if name.startswith("embeddings/")]
    captions = [name for name in names if name.startswith("captions/")]
    if not embeddings:
        style = f" --style {shlex.quote(captions[0][9:])}" if len(captions) > 1 else ""
        first = f"embed --dataset {shlex.quote(dataset)}{style}"
        return first if captions else f"captions --dataset {shlex.quote(dataset)}"
    texts = [name for name in embeddings if kinds.feed(name).kind == "text"]
    own = output if output in embeddings else (texts or embeddings)[0]
    _, style, encoder = own.split("/")
    reads = (kinds.feed(own).kind,) if "--head" in command else ()
    depths = [name for name in (output, *names) if name.startswith("depth/")]
    if not depths:
        return command
    fixed = {"style": style} if "--style" in command else {}
    free = {"style": style, "encoder": encoder, "depth_model": depths[0].partition("/")[2]}
    free = {key: value for key, value in free.items() if key not in fixed}
    alone = [d for d in work.datasets() if _fits(work, Tables((d,), **fixed, **free), reads)]
    for datasets in ((), tuple(alone)):
        for count in range(len(free) + 1):
            for chosen in combinations(free.items(), count):
                given: dict[str, Any] = dict(chosen)
                if _fits(work, Tables(datasets, **fixed, **given), reads):
                    words = [f"--datasets {shlex.quote(name)}" for name in datasets]
                    words += [
                        f"--{key.replace('_', '-')} {shlex.quote(value)}"
                        for key, value in given.items()
                    ]
                    return " ".join([command, *words])
    return command


def _fits(work: WorkDir, tables: "Tables", reads: tuple[str, ...]) -> bool:
    """Whether a training on these tables would find each of them, and whole."""
    from ..heads.sources import sources

    try:
        found = sources(work, tables, "", reads)
    except RsaDataError:
        return False
    return all(_is_whole(work, s.dataset, name) for s in found for name in s.tables)


def _is_whole(work: WorkDir, dataset: str, name: str) -> bool:
    samples = work.table(dataset, "samples").parts()
    return bool(samples) and set(samples) <= set(work.table(dataset, name).parts())


def _about(work: WorkDir, head: str) -> Description:
    where = f"heads/{head}/head.json"
    return read(work.store.read(where) or b"{}", where)
