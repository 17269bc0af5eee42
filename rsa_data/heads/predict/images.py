"""What predict needs of photos: their captions through a detector, and their relative depth."""

import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...common.errors import RowError, RsaDataError, UsageError
from ...common.options import call
from ..reading import reads
from .choices import Models
from .depth_model import DEPTH_MODEL, depth_of

if TYPE_CHECKING:
    from ...depth.model import Relative, Source

# For heads that read captions and do not say which ones: the release's structured texts.
STYLE = "release"


def segmenter_of(about: dict[str, Any], models: Models) -> dict[str, Any]:
    """Options of the detect stage for new photos of a head.

    about : head.json, {} without a head.
    """
    from ... import registry
    from ...segments import detect

    used = {table.partition("/")[2] for table in (about.get("segments") or {}).values()}
    own = registry.SEGMENTERS[detect.DEFAULT]
    known = [
        name
        for name in used
        if registry.SEGMENTERS.get(name) == own
        or (name in registry.SEGMENTERS and not registry.SEGMENTERS.is_own(name))
    ]
    default = known[0] if len(known) == 1 else detect.DEFAULT
    options: dict[str, Any] = {"segments": models.segments or default}
    for name in ("segmenter_weights", "card"):
        if (value := getattr(models, name)) is not None:
            options[name] = value
    return options


def captions_of(about: dict[str, Any], models: Models) -> dict[str, Any]:
    """Options of the captions stage for new photos of a head: those of its training captions.

    Raises UsageError when these were not written from segments.
    """
    from ...captions import write

    options: dict[str, Any] = dict(next(iter((about.get("captions") or {}).values()), {}))
    if models.style is not None:
        options = {"style": models.style}
    options.setdefault("style", STYLE)
    if not write.needs_segments(options["style"]):
        raise UsageError(
            f"the head learned from texts of the style {options['style']!r}, which are not written "
            "from segments: give --caption TEXT, or choose a wording with --style"
        )
    # A head may come from anywhere: it chooses words, never servers or files.
    options = {k: v for k, v in options.items() if k not in write.STAGE.local}
    return {**options, "variants": 1}


def describer(
    about: dict[str, Any], root: Path, models: Models
) -> Callable[[str], tuple[Any, str]]:
    """name -> the Segments of the photo root / name, and its caption, for a head that reads one.

    Loads the detector. The function raises RsaDataError for a photo that cannot be read.
    """
    import pyarrow as pa

    from ... import registry
    from ...captions import write
    from ...datasets.folder import folder
    from ...segments import detect
    from ...segments.segments import Segments, from_row
    from ...store import schemas

    options = segmenter_of(about, models)
    onnx = registry.SEGMENTERS[detect.DEFAULT]
    name = registry.SEGMENTERS.split(options["segments"])[0]
    is_model = registry.SEGMENTERS.get(name, onnx) == onnx
    if is_model and importlib.util.find_spec("pycocotools"):
        options["masks"] = True
    find = detect.build(dataset=folder(), root=root, **options)
    tell = call(write.build, **captions_of(about, models)) if "text" in reads(about) else None
    blank = dict.fromkeys(schemas.schema("samples").names)

    def describe(name: str) -> tuple[Segments, str]:
        row = blank | {"sample_id": name, "dataset": "folder", "split": "test", "scene": "."}
        samples = pa.Table.from_pylist([row | {"image": name}], schemas.schema("samples"))
        found = find(samples)
        segments = from_row(found.to_pylist()[0])
        if isinstance(segments, RowError):
            raise RsaDataError(str(segments))
        return segments, "" if tell is None else str(tell(found, samples)["text"][0].as_py())

    return describe


def relative_source(about: dict[str, Any], root: Path, models: Models) -> "Source":
    """name -> relative depth of the photo root / name: of a model, or of the files given.

    Loads the model. Raises UsageError as `depth_of` does.
    """
    from ... import registry
    from ...datasets.folder import folder
    from ...depth.choice import entry
    from ...depth.files import of_image, read, read_file

    relative = models.relative
    if relative is not None and relative.is_dir():
        return lambda name: of_image(read(relative, str(Path(name).with_suffix(""))), root, name)
    if relative is not None and relative.suffix not in (".npy", ".png"):
        raise UsageError(
            f"--relative {relative}: expected a .npy or .png file, or a folder of them"
        )
    if relative is not None and not relative.is_file():
        raise UsageError(f"--relative {relative}: expected a file or folder; there is none")
    if relative is not None:
        return lambda name: of_image(read_file(relative), root, name)
    options = depth_of(about, models)
    runs = entry(options["name"], models.depth_card)
    source: Source = registry.resolve("depth model", registry.DEPTH_MODELS, runs)(
        **options,
        argument="",
        dataset=folder(),
        root=root,
        weights=models.depth_weights,
        card=models.depth_card,
        holds=((about.get("depth_model") or {}).get("options") or {}).get("files_hold", "relative"),
        threads=2,
    )
    chosen = models.depth_model is not None or models.depth_card is not None or about
    return source if models.depth_weights is None or chosen else _default(source, models)


def _default(source: "Source", models: Models) -> "Source":
    """A file that is taken for the default model's says how to name its own where it is not."""

    def named(name: str) -> "Relative":
        try:
            return source(name)
        except RowError:
            raise
        except RsaDataError as error:
            raise UsageError(
                f"--depth-weights {models.depth_weights}: expected a file of {DEPTH_MODEL}, which "
                "is taken where no model is named; this one does not run as such. Give "
                "--depth-model NAME (`rsa-data list depth-models`), or --depth-card FILE for a "
                "model of your own"
            ) from error

    return named


def relative_map(source: "Source", name: str, size: Sequence[int] | None) -> np.ndarray:
    """y, float32 (h, w), of a photo, at the photo's size (h, w) if that is given.

    Raises RsaDataError when there is none.
    """
    from ...depth.measure import at_size

    try:
        found = source(name)
    except RowError as error:
        raise RsaDataError(str(error)) from error
    return found.y if size is None else at_size(found, size[0], size[1])
