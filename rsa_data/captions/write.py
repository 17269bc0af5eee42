"""The captions stage: segments -> captions, whole columns at a time."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from .. import registry
from ..common.errors import UsageError
from ..common.options import call, grouped, parameters
from ..runner.stage import Notes, Reads, Stage
from . import imports, members, natural, summary, vlm
from .blocks import composer
from .caption_table import caption_table
from .compose import Recipe
from .imports import Catalogue, unused
from .options import Augmentation, Contents, WrongObjects
from .vlm import Asked
from .wordings.wording import Wording

# Styles that make their own step, as they look at the dataset's files.
_LOOKING = (vlm.Style, members.Style)


def build(
    *,
    style: str = "occupancy",
    augmentation: Augmentation = Augmentation(),
    contents: Contents = Contents(),
    wrong: WrongObjects = WrongObjects(),
    server: Asked = Asked(),
    root: Path | None = None,
    catalogue: Callable[[], Catalogue] | None = None,
) -> Callable[..., pa.Table]:
    """Captions of each image: one plain, the others augmented by swap and delete.

    Parameters
    ----------
    style : how an object is worded, or texts to import as NAME:PATH; see `rsa-data list styles`.
    root : where the images lie, for the styles vlm and member; the runner knows it.
    catalogue : gives sample_id and image of every sample of the dataset, so that no imported text
        belongs to two; the runner knows it.
    """
    target, argument = _resolve(style)
    counter = registry.build("tokenizer", registry.TOKENIZERS, contents.tokenizer)
    if isinstance(target, _LOOKING):
        return target.step(argument, server, counter, root)
    if not isinstance(target, Wording):
        found = target(argument)
        return natural.step(style, found, counter, catalogue and catalogue())
    if contents.group and target.group is False:
        raise UsageError(
            f"captions: the style {style!r} describes each object by itself. Leave out --group, or "
            "use --style occupancy"
        )
    most = contents.max_tokens
    metadata = {"style": style, "style_version": str(target.version), "tokenizer": counter.name}
    recipe = Recipe(
        wording=target,
        tokenizer=counter,
        limit=counter.max_tokens if most is None else most or 2**30,
        augmentation=augmentation,
        contents=replace(contents, group=target.group or contents.group),
        wrong=wrong,
    )
    write = composer(recipe)

    def step(segments: pa.Table, samples: pa.Table) -> pa.Table:
        return caption_table(write(segments, samples), metadata)

    return step


def files(*, style: str = "occupancy", **_: object) -> dict[str, Path]:
    """The file of texts that an import reads, so that its bytes stand in the fingerprint."""
    target, argument = _resolve(style)
    imports = argument and not isinstance(target, (Wording, *_LOOKING))
    path = Path(argument) if imports else None
    return {"texts": path} if path is not None and path.is_file() else {}


def identity(*, style: str = "occupancy", tokenizer: str = "clip", **others: Any) -> dict[str, str]:
    """What the texts follow from beside options and files: version of the wording, vocabulary."""
    target, argument = _resolve(style)
    counter = registry.build("tokenizer", registry.TOKENIZERS, tokenizer)
    version = imports.VERSION if target is imports.import_texts else natural.VERSION
    version = target.version if isinstance(target, Wording) else version
    found = {"style_version": str(version), "tokenizer": counter.fingerprint}
    if isinstance(target, _LOOKING):
        found["style_version"] = str(target.version)
        found |= target.identity(argument, grouped(build, others).get("server", Asked()))
    return found


def notes(
    captions: Iterable[pa.Table],
    *inputs: pa.Table,
    catalogue: Callable[[], Catalogue] | None = None,
    **options: Any,
) -> list[str]:
    """What a person should know after a run, in sentences.

    captions : parts of the table, at least with the columns of `summary.COLUMNS`. inputs : one part
    of the stage's inputs, on which is tried which options would keep more. options : those of
    `build`.
    """
    bound = {n: p.default for n, p in parameters(build).items()} | options
    counter = registry.build("tokenizer", registry.TOKENIZERS, bound["tokenizer"])
    style = _resolve(bound["style"])[0]
    if isinstance(style, _LOOKING):
        parts = list(captions)
        lines = summary.failed_lines(parts) + summary.import_lines(parts, counter)
        return (vlm.cost_lines(parts, bound["prices"]) if style is vlm.vlm else []) + lines
    if not needs_segments(bound["style"]):
        importer, argument = _resolve(bound["style"])
        assert not isinstance(importer, (Wording, *_LOOKING))
        lines = unused(importer(argument), catalogue and catalogue())
        return lines + summary.import_lines(captions, counter)
    asked = bound["max_tokens"]
    found = summary.kept(captions)
    lines = summary.budget_lines(found, counter.max_tokens if asked is None else asked)
    if not found["losing"]:
        return lines if asked != 0 else []
    now = summary.kept([call(build, **bound | {"variants": 1})(*inputs)])
    would = {}
    for change in summary.ALTERNATIVES:
        other = bound | change | {"variants": 1}
        if all(bound[name] == value for name, value in change.items()):
            continue
        try:
            sums = summary.kept([call(build, **other)(*inputs)])
        except UsageError:
            continue  # a style that knows no groups
        flags = (f"--{n}" if value is True else f"--{n} {value}" for n, value in change.items())
        would[" ".join(flags)] = sums
    return lines + summary.alternatives(now, would)


def needs_segments(style: str) -> bool:
    """False for texts to import: they need samples alone."""
    return isinstance(_resolve(style)[0], Wording)


def _resolve(style: str) -> tuple[Wording | vlm.Style | members.Style | natural.Importer, str]:
    name, argument = registry.STYLES.split(style)
    colon = ":" if len(style) > len(name) else ""
    target = registry.resolve("style", registry.STYLES, name)
    if isinstance(target, _LOOKING):
        return target, argument
    if isinstance(target, Wording) == bool(colon):
        expected = "no argument" if colon else f"{name}:PATH"
        raise UsageError(f"captions: style: expected {expected}, found {style!r}")
    return target, argument


def check(*, style: str = "occupancy", **_: Any) -> None:
    """Refuses a style that is not in the registry."""
    registry.check("style", registry.STYLES, registry.STYLES.split(style)[0])


STAGE = Stage(
    name="captions",
    version=2,
    build=build,
    help="""Write captions of what each image shows.

    The dataset is indexed and its segments are made first where that has not been done.

    \b
      rsa-data captions --dataset nyuv2
      rsa-data captions --dataset nyuv2 --segments rsa-release:RSA/text
    """,
    next="embed --dataset {dataset}",
    schema="captions",
    folder="captions",
    selector="style",
    choices=registry.STYLES,
    reads=Reads(
        "segments",
        "segments",
        made_first=True,
        needed=lambda options: needs_segments(options["style"]),
    ),
    local=("endpoint", "prompt", "concurrency", "rate", "prices"),
    files=files,
    identity=identity,
    notes=Notes(tuple(summary.COLUMNS), notes),
    check=check,
)
