"""What the page does, without the page: picture, caption, scale and shift, points, distances."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import RowError, RsaDataError, TransientError
from ...datasets.images import MAX_PIXELS, read_image
from ...heads import belong
from ...heads.checkpoint import ScaleHead
from ...heads.metric import to_metric
from ...heads.predict import images, known_depth
from ...heads.predict.predict import Prediction, from_captions
from ...segments.segments import Segments, from_row
from ...store.tables import WorkDir
from ..report.samples import one

# A picture's horizontal field of view where nothing tells its camera: that of many phones.
_VIEW = np.deg2rad(65.0)
_POINTS, _LONGEST = 20_000, 800


@dataclass(frozen=True)
class Models:
    """What answers: loaded once, shared by all who look at the page.

    encode : captions -> features, with the encoder in memory.
    segments, segmenter_weights, card, depth_weights : for pictures of the user's own.
    """

    work: WorkDir
    head: ScaleHead
    name: str
    encode: Any
    segments: str | None = None
    segmenter_weights: Path | None = None
    card: Path | None = None
    depth_weights: Path | None = None


def load(work: WorkDir, name: str, weights: Path | None, **others: Any) -> Models:
    """The head of the work dir with its encoder; raises RsaDataError when one is missing."""
    head = ScaleHead.load(f"{work.store.location}/heads/{name}")
    if head.description["features"].get("style") is None:
        raise RsaDataError(f"head {name}: expected one that reads captions; found no style")
    encode = belong.encoder(head.description["features"], weights)
    encode(["An image."])  # the first answer should not wait for this
    return Models(work, head, name, encode, **others)


def sample_ids(models: Models, most: int = 40) -> list[str]:
    """Samples whose depth is stored whole, evenly over the test parts of each dataset."""
    found: list[str] = []
    for dataset in models.work.datasets():
        samples = models.work.table(dataset, "samples")
        depth = models.work.table(
            dataset, f"depth/{models.head.description['depth_model'].get('model')}"
        )
        if not depth.exists():
            continue
        tests = [n for n in depth.parts() if depth.receipt(n).split != "train"]
        for number in tests[:3]:
            ids = samples.read(number, ["sample_id"])["sample_id"].to_pylist()
            found += ids[:: max(1, len(ids) * len(tests[:3]) // most)]
    return found


@dataclass(frozen=True)
class Picture:
    """A picture with what is known of it.

    image : uint8 (height, width, 3), RGB. segments : in px of it, or None.
    y : float32 (h, w), relative depth, of any size, or None; why : the reason.
    truth : float32 (h, w), m, 0 where there is none, or None.
    camera : fx, fy, cx, cy in px of y; guessed : nobody told them.
    """

    name: str
    image: np.ndarray
    segments: Segments | None
    caption: str
    y: np.ndarray | None
    why: str
    truth: np.ndarray | None
    camera: tuple[float, float, float, float]
    guessed: bool


def of_sample(models: Models, sample_id: str) -> Picture:
    """A sample of the work dir. Raises RsaDataError where its image is not at hand."""
    sample = one(models.work, sample_id, models.name)
    if sample.where is None or sample.row["image"] is None:
        raise RsaDataError(f"{sample_id}: its image is not at hand: give the dataset's --root once")
    try:
        image = read_image(sample.where / sample.row["image"])
    except RowError as error:
        raise RsaDataError(f"{sample_id}: {error}") from error
    why = "" if sample.relative is not None else "this sample has no whole depth map"
    y, truth = _thin(sample.relative), _thin(sample.truth)
    given = [sample.row[k] for k in ("fx", "fy", "cx", "cy")]
    shape = image.shape[:2] if y is None else y.shape
    camera, guessed = _camera(shape, None if None in given else given, image.shape[1])
    style = f"{models.head.description['features']['style']}: "
    texts = [c.removeprefix(style) for c in sample.captions if c.startswith(style)]
    return Picture(sample_id, image, sample.segments, texts[0] if texts else "An image.",
                   y, why, truth, camera, guessed)  # fmt: skip


def _thin(values: np.ndarray | None) -> np.ndarray | None:
    """A map of at most 800 px, every so many pixels of it: what follows a caption at once."""
    if values is None:
        return None
    step = -(-max(values.shape) // _LONGEST)
    return values[::step, ::step]


def _camera(
    shape: tuple[int, ...], given: list[float] | None, width: float | None = None
) -> tuple[tuple[float, float, float, float], bool]:
    """fx, fy, cx, cy in px of a map of this shape, and whether they are guessed.

    given : in px of an image of this width; None where nobody knows.
    """
    if given is None:
        f = shape[1] / 2 / np.tan(_VIEW / 2)
        return (f, f, shape[1] / 2, shape[0] / 2), True
    zoom = shape[1] / (width or 2 * given[2])
    fx, fy, cx, cy = (float(v) * zoom for v in given)
    return (fx, fy, cx, cy), False


def of_file(models: Models, path: Path) -> Picture:
    """A picture from outside: segments by the detector, y by the head's depth model.

    Raises RsaDataError, in words for a person, when it is no picture. Where no detector or depth
    model is at hand, the picture stands without segments or depth, and `why` says so.
    """
    try:
        image = read_image(path, min(MAX_PIXELS, 40_000_000))
    except (RowError, TransientError) as error:
        raise RsaDataError(f"This file cannot be shown: {error}") from error
    about, caption, segments, why = models.head.description, "An image.", None, []
    try:
        found, captions = images.look(
            about, path, [path.name], models.segments, models.segmenter_weights, models.card
        )
        caption = captions["text"][0].as_py()
        row = from_row(found.to_pylist()[0])
        if isinstance(row, RowError):
            raise RsaDataError(str(row))
        segments = row
    except RsaDataError as error:
        why.append(f"No caption was written: {error}")
    y = None
    try:
        y, _ = images.relative_of(about, path, path.name, None, models.depth_weights)
    except RsaDataError as error:
        why.append(f"No depth: {error}")
    y = _thin(y)
    camera, guessed = _camera(image.shape if y is None else y.shape, None)
    return Picture(path.name, image, segments, caption, y, " ".join(why), None, camera, guessed)


def answer(models: Models, caption: str) -> Prediction:
    """Scale and shift of a caption, and whether it is unlike those that the head was trained on."""
    return from_captions(models.head, [caption.strip() or "An image."], None, models.encode)[0]


def corrected(
    models: Models, found: Prediction, picture: Picture, known: tuple[float, float, float]
) -> tuple[float, float]:
    """Scale and shift that go between the words and one known depth; known : u, v (px), m."""
    assert picture.y is not None
    at, metres = known_depth.points(picture.y, [",".join(str(v) for v in known)])
    prior = models.head.description.get("prior")
    return known_depth.refine(found.scale, found.shift, at, metres, prior)


def depth_of(picture: Picture, scale: float, shift: float) -> np.ndarray:
    """Metric depth of the picture, float32 (h, w), m."""
    assert picture.y is not None
    return to_metric(picture.y, scale, shift)


def place(picture: Picture, depth: np.ndarray, u: float, v: float) -> np.ndarray:
    """The point seen at column u and row v: x right, y down, z forward, m."""
    fx, fy, cx, cy = picture.camera
    z = float(depth[int(v), int(u)])
    return np.array([(u - cx) / fx * z, (v - cy) / fy * z, z])


def distance(
    picture: Picture, depth: np.ndarray, a: tuple[float, float], b: tuple[float, float]
) -> float:
    """m between the points seen at two pixels (column, row)."""
    return float(np.linalg.norm(place(picture, depth, *a) - place(picture, depth, *b)))


def cloud(picture: Picture, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3), m, y up and z towards the viewer, and colours (n, 3), 0 to 1; at most 20,000.

    What lies beyond the 98th percentile is left out: single pixels would make all else small.
    """
    height, width = depth.shape
    step = max(1, int(np.ceil(np.sqrt(height * width / _POINTS))))
    v, u = (g.ravel() for g in np.mgrid[0:height:step, 0:width:step])
    z = depth[v, u]
    good = np.isfinite(z) & (z > 0)
    good &= z <= np.quantile(z[good], 0.98) if good.any() else good
    u, v, z = u[good], v[good], z[good]
    fx, fy, cx, cy = picture.camera
    points = np.stack([(u - cx) / fx * z, (cy - v) / fy * z, -z], 1)
    down, across = (np.array(picture.image.shape[:2]) / depth.shape).tolist()
    colours = picture.image[(v * down).astype(int), (u * across).astype(int)]
    return points, colours / 255
