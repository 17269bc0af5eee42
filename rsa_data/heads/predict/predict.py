"""predict: from captions or images to scale and shift, and on to metric depth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...common import bounded, text_files
from ...common.errors import RsaDataError, UsageError
from ...common.options import accepts_old_names
from ...store.tables import WorkDir
from ..metric import to_metric
from . import known_depth
from .images import images_below, paraphrases, relative_of, tell
from .outputs import write_depth

if TYPE_CHECKING:
    from ..checkpoint import ScaleHead


@dataclass
class Prediction:
    """What a head says of one caption.

    scale, shift : 1/m per unit of y, and 1/m. name : of the image or map, empty without one.
    spread : lowest and highest scale and shift over the caption's paraphrases, or None.
    unlike : the caption is farther from the training captions than 99% of those held out.
    written : the depth file, if one was asked for.
    """

    caption: str
    scale: float
    shift: float
    name: str = ""
    spread: tuple[float, float, float, float] | None = None
    unlike: bool = False
    written: Path | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """What a person reads of it."""
        first = f"scale {self.scale:.6g}  shift {self.shift:.6g}  {self.name or self.caption!r}"
        lines = [first, *([f"  {self.caption!r}"] if self.name else [])]
        if self.spread:
            a, b, c, d = self.spread
            lines.append(
                f"  over its paraphrases: scale {a:.4g} to {b:.4g}, shift {c:.4g} to {d:.4g}"
            )
        if self.unlike:
            lines.append(
                "  warning: unlike anything the head was trained on; do not trust this without a "
                "known point (--known u,v,metres)"
            )
        lines += [f"  {note}" for note in self.notes]
        return lines + ([f"  wrote {self.written}"] if self.written else [])


@dataclass(frozen=True)
class Predicted:
    """All predictions of a call."""

    predictions: list[Prediction]

    @property
    def summary(self) -> str:
        """Scale, shift and what is to be said of each."""
        return "\n".join(line for p in self.predictions for line in p.lines)


@accepts_old_names("predict")
def predict(
    work: WorkDir,
    *,
    head: str = "head",
    caption: tuple[str, ...] = (),
    captions: Path | None = None,
    image: Path | None = None,
    segments: str | None = None,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    encoder_weights: Path | None = None,
    relative: Path | None = None,
    depth_weights: Path | None = None,
    known: tuple[str, ...] = (),
    range: str | None = None,
    smooth: int = 0,
    intrinsics: str | None = None,
    out: Path | None = None,
    kind: Literal["npy", "png", "ply"] = "npy",
) -> Predicted:
    """Scale and shift of captions, or of images through a detector; metric depth with --out.

    metric depth = 1 / (scale * relative depth + shift), one scale and one shift an image; where the
    denominator is not positive it is inf. A scale for each region or pixel is out of scope.

    Parameters
    ----------
    head : name of a head below WORK/heads, or its folder, or a released .pt file.
    caption : description of the scene; may be repeated. With --image, one describes all frames.
    captions : file with a caption a line.
    image : image, or folder of images, that a detector describes, unless --caption does.
    segments : what finds the objects; see `rsa-data list segmenters`.
    segmenter_weights : file of its weights, instead of the download.
    card : model card (TOML) of a segmenter of your own.
    encoder_weights : file with the text encoder's weights, where it is not found by itself.
    relative : relative depth, .npy or 16-bit PNG (value / 65535), or a folder of maps named like
        the images. By default the head's depth model runs on the images.
    depth_weights : file of the depth model's weights, instead of the download.
    known : a point of known depth as u,v,metres, pixel column and row; may be repeated. The
        prediction is corrected as far as the points are surer than the words.
    range : depth of the nearest and the farthest part as near,far in metres, used like two points.
    smooth : frames over which the predictions of a folder are averaged, in the order of names.
    intrinsics : fx,fy,cx,cy in px of the depth map, for point clouds.
    out : file to write metric depth to, .npy (m), .png (16 bits, mm) or .ply (coloured points); a
        folder when there are several.
    kind : of the files in that folder.
    """
    from ..checkpoint import ScaleHead

    loaded = ScaleHead.load(_place(work, head))
    names = images_below(image) if image else []
    texts = [*caption, *_lines(captions)]
    if names and not texts:
        assert image is not None
        texts = tell(loaded.description, image, names, segments, segmenter_weights, card)
    elif names and len(texts) == 1:
        texts *= len(names)
    if not texts:
        raise UsageError("predict: expected --caption TEXT, --captions FILE or --image PLACE")
    if names and len(texts) != len(names):
        raise UsageError(
            f"predict: expected one caption for all images or one each; found {len(texts)} for "
            f"{len(names)} images"
        )
    if not names and len(texts) > 1 and (relative or out):
        raise UsageError("predict: --relative and --out without --image take one --caption")
    found = from_captions(loaded, texts, encoder_weights)
    if smooth > 1:
        _smooth(found, smooth)
    if relative is None and not (names and (out or known or range)):
        if known or range or out:
            raise UsageError("predict: --known, --range and --out need --relative or --image")
        return Predicted(found)
    camera = known_depth.camera(intrinsics) if intrinsics else None
    labels: list[str | None] = [*names] if names else [None]
    for p, name in zip(found, labels, strict=True):
        p.name = name or ""
        y, colours = relative_of(loaded.description, image, name, relative, depth_weights)
        _correct(p, y, known, range, loaded.description.get("prior"))
        if out:
            several = len(found) > 1 or (image is not None and image.is_dir())
            p.written = out / Path(p.name).with_suffix(f".{kind}") if several else out
            write_depth(p.written, to_metric(y, p.scale, p.shift), camera, colours)
    return Predicted(found)


def from_captions(
    head: "ScaleHead",
    captions: Sequence[str],
    weights: Path | None = None,
    encoder: Callable[[Sequence[str]], np.ndarray] | None = None,
) -> list[Prediction]:
    """Predictions of captions, each with the spread over its paraphrases and its distance.

    encoder : the head's encoder, when the caller holds it in memory.
    """
    from ..belong import encode
    from .calibration import distance

    # Each text once: the place in a batch may change the last bit.
    distinct = list(dict.fromkeys(captions))
    others = [paraphrases(text) for text in distinct]
    flat = [text for pair in zip(distinct, others, strict=True) for text in (pair[0], *pair[1])]
    features = encoder(flat) if encoder else encode(head.description["features"], flat, weights)
    scale, shift = head(features)
    starts = np.cumsum([0] + [1 + len(o) for o in others])
    far = head.description.get("far")
    unlike = np.zeros(len(flat), bool)
    if far is not None and head.reference is not None:
        unlike = distance(features, head.reference, head.mean.numpy()) > far
    found = {}
    for text, start, end in zip(distinct, starts[:-1], starts[1:], strict=True):
        a, b = scale[start:end], shift[start:end]
        spread = tuple(float(v) for v in (a.min(), a.max(), b.min(), b.max()))
        found[text] = Prediction(
            text,
            float(a[0]),
            float(b[0]),
            spread=spread if len(a) > 1 else None,  # type: ignore[arg-type]
            unlike=bool(unlike[start]),
        )
    return [replace(found[text], notes=[]) for text in captions]


def _place(work: WorkDir, head: str) -> str:
    if head.endswith((".pt", ".pth")) or (Path(head) / "head.json").is_file():
        return head
    return f"{work.store.location}/heads/{head}"


def _lines(path: Path | None) -> list[str]:
    if path is None:
        return []
    try:
        lines = text_files.lines(bounded.read_text(path))
    except OSError as error:
        raise RsaDataError(
            f"--captions {path}: expected UTF-8 text, a caption a line: {error}"
        ) from error
    return [line.strip() for line in lines if line.strip()]


def _smooth(found: list[Prediction], frames: int) -> None:
    for name in ("scale", "shift"):
        values = known_depth.smooth(np.array([getattr(p, name) for p in found]), frames)
        for p, value in zip(found, values, strict=True):
            setattr(p, name, float(value))


def _correct(
    p: Prediction, y: np.ndarray, known: Sequence[str], near_far: str | None, prior: Any
) -> None:
    """Refines a prediction by known points and range, and notes it."""
    at, metres = known_depth.points(y, known)
    if near_far:
        ends = known_depth.ends(y, near_far)
        at, metres = np.concatenate([at, ends[0]]), np.concatenate([metres, ends[1]])
    if len(at):
        p.notes.append(f"from words alone: scale {p.scale:.6g}, shift {p.shift:.6g}")
        p.scale, p.shift = known_depth.refine(p.scale, p.shift, at, metres, prior)
