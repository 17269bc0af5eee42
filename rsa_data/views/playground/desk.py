"""What the page does, without the page: picture, caption, scale and shift, points, distances."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...common.errors import RowError, RsaDataError, TransientError
from ...datasets.images import MAX_PIXELS, read_image
from ...heads.checkpoint import ScaleHead
from ...heads.metric import to_metric
from ...heads.predict import choices, correction, known_depth
from ...heads.predict.asking import Asking
from ...heads.predict.camera import Camera, camera_of
from ...heads.predict.find import DEFAULT, find
from ...heads.predict.images import describer, relative_map, relative_source
from ...heads.predict.nouns import text_of
from ...heads.predict.objects import Seen, seen, things
from ...heads.predict.prediction import Prediction
from ...segments.segments import Segments
from ...store.tables import WorkDir
from ..depth_files import maps, space
from ..pictures.drawing import resized
from ..report.samples import one

_LONGEST = 800


@dataclass(frozen=True)
class Models:
    """What answers: loaded once, shared by all who look at the page.

    ask : the head with its encoders in memory.
    files : models for photos of the user's own. view : their camera.
    """

    work: WorkDir
    head: ScaleHead
    name: str
    ask: Asking
    files: choices.Models = choices.Models()
    view: choices.View = choices.View()


def load(
    work: WorkDir,
    name: str | None,
    files: choices.Models = choices.Models(),
    view: choices.View = choices.View(),
) -> Models:
    """The head with its encoder; raises RsaDataError when one is missing. name : see `find`."""
    head = find(work, name)
    ask = Asking(head, files.encoder_weights, files.style)
    blank = np.zeros((8, 8, 3), np.uint8)
    ask("An image.", image=blank)  # the first answer should not wait for this
    return Models(work, head, name or DEFAULT, ask, files, view)


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
    camera : of the image.
    """

    name: str
    image: np.ndarray
    segments: Segments | None
    caption: str
    y: np.ndarray | None
    why: str
    truth: np.ndarray | None
    camera: Camera

    def view(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy in px of y."""
        assert self.y is not None
        return self.camera.at(self.y.shape[1], self.y.shape[0])


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
    height, width = image.shape[:2]
    if None in given:
        camera = camera_of(None, width, height, models.view)
    else:
        fx, fy, cx, cy = (float(v) for v in given)
        camera = Camera(fx, fy, cx, cy, width, height, "the dataset")
    style = f"{models.head.description['features'].get('style')}: "
    texts = [c.removeprefix(style) for c in sample.captions if c.startswith(style)]
    caption = texts[0] if texts else _listed(sample.segments)
    return Picture(sample_id, image, sample.segments, caption, y, why, truth, camera)


def _listed(segments: Segments | None) -> str:
    """The objects as a list, for heads that read no sentence."""
    return (text_of(things(segments)) if segments is not None else "") or "An image."


def _thin(values: np.ndarray | None) -> np.ndarray | None:
    """A map of at most 800 px, every so many pixels of it: what follows a caption at once."""
    if values is None:
        return None
    step = -(-max(values.shape) // _LONGEST)
    return values[::step, ::step]


def of_file(models: Models, path: Path) -> Picture:
    """A picture from outside: segments by the detector, y by the head's depth model.

    Raises RsaDataError, in words for a person, when it is no picture. Where no detector or depth
    model is at hand, the picture stands without segments or depth, and `why` says so.
    """
    try:
        image = read_image(path, min(MAX_PIXELS, 40_000_000))
    except (RowError, TransientError) as error:
        raise RsaDataError(f"This file cannot be shown: {error}") from error
    about, caption, segments, y = models.head.description, "An image.", None, None
    why = []
    try:
        segments, told = describer(about, path.parent, models.files)(path.name)
        caption = told or _listed(segments)
    except RsaDataError as error:
        why.append(f"No caption was written: {error}")
    try:
        source = relative_source(about, path.parent, models.files)
        y = _thin(relative_map(source, path.name, image.shape[:2]))
    except RsaDataError as error:
        why.append(f"No depth: {str(error).removeprefix('predict: ')}")
    camera = camera_of(path, image.shape[1], image.shape[0], models.view)
    return Picture(path.name, image, segments, caption, y, " ".join(why), None, camera)


def answer(
    models: Models, caption: str, picture: Picture | None = None, spread: bool = True
) -> Prediction:
    """Scale and shift of a caption, and whether it is unlike those that the head was trained on.

    picture : in view. A head of objects reads its segments until the caption is changed.
    spread : over the caption's paraphrases too, which takes nine times as long.
    Raises UsageError where the head reads the photo itself and there is none.
    """
    own = picture is not None and caption == picture.caption
    segments = picture.segments if picture is not None and own else None
    image = None if picture is None else picture.image
    return models.ask(caption.strip() or "An image.", segments, image, spread)


def corrected(
    models: Models, found: Prediction, picture: Picture, known: tuple[float, float, float]
) -> tuple[float, float]:
    """Scale and shift that go between the words and one known depth; known : u, v (px), m."""
    assert picture.y is not None
    at, metres = known_depth.points(picture.y, [",".join(str(v) for v in known)])
    prior = models.head.description.get("prior")
    return correction.refine(found.scale, found.shift, at, metres, prior)


def depth_of(picture: Picture, scale: float, shift: float) -> np.ndarray:
    """Metric depth of the picture, float32 (h, w), m."""
    assert picture.y is not None
    depth: np.ndarray = to_metric(picture.y, scale, shift)
    return depth


def objects(picture: Picture, depth: np.ndarray) -> list[Seen]:
    """The objects of the picture with their distances."""
    return [] if picture.segments is None else seen(picture.segments, depth)


def file_of(picture: Picture, depth: np.ndarray, kind: str) -> bytes:
    """The depth as .npy, .png (16 bits, mm), .ply or .glb, or a coloured picture.

    Raises ValueError for no surface.
    """
    if kind == ".npy":
        return bytes(maps.npy(depth))
    if kind == ".png":
        return maps.png(depth)
    if kind == "-colours.png":
        return maps.picture(maps.coloured(depth))
    colours = resized(picture.image, depth.shape[1], depth.shape[0])
    make = space.ply if kind == ".ply" else space.glb
    return make(depth, picture.view(), colours).data


def place(picture: Picture, depth: np.ndarray, u: float, v: float) -> np.ndarray:
    """The point seen at column u and row v: x right, y down, z forward, m."""
    fx, fy, cx, cy = picture.view()
    z = float(depth[int(v), int(u)])
    return np.array([(u - cx) / fx * z, (v - cy) / fy * z, z])


def distance(
    picture: Picture, depth: np.ndarray, a: tuple[float, float], b: tuple[float, float]
) -> float:
    """m between the points seen at two pixels (column, row)."""
    return float(np.linalg.norm(place(picture, depth, *a) - place(picture, depth, *b)))
