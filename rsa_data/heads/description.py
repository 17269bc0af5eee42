"""head.json: what a head is, what it reads and what it was trained on."""

from typing import Annotated, Any

import msgspec
from msgspec import UNSET, UnsetType

from ..common.errors import RsaDataError
from ..common.typed import Count, convert
from ..common.typed import parse as parse_json
from ..store.encoding import fingerprint

# Of head.safetensors: the largest head here has 6 MB.
MAX_BYTES = 2**28
FORMAT = 1

# A size of a row of features or in an architecture: more would be a slip or an attack.
Size = Annotated[int, msgspec.Meta(ge=0, le=2**20)]

# `calibrate` gives 0.01 or more; a head that has collapsed can be off by a large factor. Beyond
# these the covariance cannot be inverted.
Deviation = Annotated[float, msgspec.Meta(ge=1e-3, le=1e15)]


class Input(msgspec.Struct, kw_only=True, frozen=True):
    """What the features of one input are.

    style, encoder : of embeddings/STYLE/ENCODER. options, files, stage_version : of what made them,
    without what does not change their meaning; files are sha256 by name. None is not known, as of
    an imported head, and goes with anything.
    """

    style: str | None = None
    encoder: str | None = None
    options: dict[str, Any] | None = None
    files: dict[str, str] | None = None
    stage_version: int | None = None


class Features(Input, kw_only=True, frozen=True):
    """What a head reads: its first input, and the inputs whose rows stand behind those.

    dim : numbers in an image's row; of a set of any length, those of one object count.
    encoder : of all inputs, joined by +.
    """

    dim: Size = 0
    beside: list[Input] | UnsetType = UNSET

    @classmethod
    def of(cls, values: dict[str, Any]) -> "Features":
        """From plain values, those of the version before too."""
        return convert(_current(values), cls, "features")

    def identity(self) -> dict[str, Any]:
        """What must be the same in tables that the head is used on."""
        found: dict[str, Any] = msgspec.to_builtins(self)
        del found["dim"]
        return found


class DepthModel(msgspec.Struct, kw_only=True, frozen=True):
    """What made the relative depth; geometry : size and crop of its input, by dataset."""

    model: str | None = None
    options: dict[str, Any] | None = None
    files: dict[str, str] | None = None
    stage_version: int | None = None
    geometry: dict[str, dict[str, Any]] = {}


class Used(msgspec.Struct, kw_only=True, frozen=True, omit_defaults=True):
    """What a head was trained on of one dataset.

    left_out : images that were not ok in every table. validation : how the images that chose the
    best epoch were held out. synthetic : its images were rendered. min_depth,
    max_depth : m. tables : digest by table.
    """

    images: Count = 0
    validation_images: Count = 0
    validation: str = ""
    synthetic: bool = False
    left_out: Count = 0
    min_depth: float | UnsetType = UNSET
    max_depth: float | UnsetType = UNSET
    tables: dict[str, str] = {}


class Validation(msgspec.Struct, kw_only=True, frozen=True):
    """The best epoch, and its error on each dataset."""

    epoch: Count
    abs_rel: dict[str, float]


class Prior(msgspec.Struct, kw_only=True, frozen=True):
    """Standard deviations of the relative errors of scale and shift, and their correlation."""

    scale: Deviation
    shift: Deviation
    correlation: Annotated[float, msgspec.Meta(gt=-1, lt=1)]


class Imported(msgspec.Struct, kw_only=True, frozen=True):
    """Where a head came from that was not trained here; measures : its own, by dataset."""

    file: str
    steps: int | None = None
    measures: dict[str, dict[str, float]] = {}


class Description(msgspec.Struct, kw_only=True, frozen=True):
    """head.json.

    architecture : registry name, and further arguments of its constructor.
    weights : sha256 of head.safetensors. training : fingerprint of the description (the file that
        says what a training follows from) under which the head was trained.
    history : sha256 of history.parquet. digest : of all the rest of this file.
    segments, captions : by dataset, the table of segments and the options of its captions, so that
        new images are described in the same way. options : of train-head.
    far, prior : see `predict.calibration`.
    """

    format: int
    architecture: dict[str, str | Size | float]
    features: Features
    parameters: Count | UnsetType = UNSET
    standardized: bool | UnsetType = UNSET
    depth_model: DepthModel | UnsetType = UNSET
    datasets: dict[str, Used] | UnsetType = UNSET
    segments: dict[str, str] | UnsetType = UNSET
    captions: dict[str, dict[str, Any]] | UnsetType = UNSET
    options: dict[str, Any] | UnsetType = UNSET
    validation: Validation | UnsetType = UNSET
    epochs_run: Count | UnsetType = UNSET
    far: float | UnsetType | None = UNSET
    prior: Prior | UnsetType | None = UNSET
    imported: Imported | UnsetType = UNSET
    weights: str | UnsetType = UNSET
    training: str | UnsetType = UNSET
    history: str | UnsetType = UNSET
    digest: str | UnsetType = UNSET

    def sealed(self) -> "Description":
        """The same with its digest."""
        return msgspec.structs.replace(self, digest=self._digest())

    def check_digest(self, where: str) -> None:
        """Raises RsaDataError when the file was changed after it was written."""
        if self.digest and self.digest != self._digest():
            raise RsaDataError(
                f"{where}: changed since it was written: expected the digest {self.digest}, found "
                f"{self._digest()}. Train or import the head again"
            )

    def _digest(self) -> str:
        return fingerprint(msgspec.structs.replace(self, digest=UNSET).plain())

    @property
    def name(self) -> str:
        """Name of the architecture in the registry."""
        return str(self.architecture["name"])

    @property
    def sizes(self) -> dict[str, Any]:
        """Further arguments of the architecture's constructor."""
        return {key: value for key, value in self.architecture.items() if key != "name"}

    @property
    def depth(self) -> DepthModel:
        """What made the relative depth, as far as it is known."""
        return self.depth_model or DepthModel()

    @property
    def trained_on(self) -> dict[str, Used]:
        """The datasets; none where it is not known."""
        return self.datasets or {}

    @property
    def only_synthetic(self) -> bool:
        """Whether every image that it was trained on was rendered."""
        return bool(self.trained_on) and all(used.synthetic for used in self.trained_on.values())

    @property
    def control(self) -> str:
        """Which kind of control the head is, or none."""
        return str((self.options or {}).get("control", "none"))

    def plain(self) -> dict[str, Any]:
        """The same as JSON's values."""
        found: dict[str, Any] = msgspec.to_builtins(self)
        return found


def parse(data: bytes, where: str) -> dict[str, Any]:
    """The description of a head; raises RsaDataError that names the first place that is wrong."""
    return read(data, where).plain()


def read(data: bytes, where: str) -> Description:
    """head.json from its bytes; raises RsaDataError: where, expected, found."""
    told = f"{where}: does not describe a head"
    return of(parse_json(data, dict[str, Any], told), where)


def of(values: Any, where: str = "head.json") -> Description:
    """head.json from plain values, those of the version before too."""
    told = f"{where}: does not describe a head"
    form = convert(values, _Format, told).format
    if form != FORMAT:
        raise RsaDataError(
            f"{where}: expected format {FORMAT}; found {form}: written by another version of "
            "rsa-data"
        )
    if isinstance(values.get("features"), dict):
        values = {**values, "features": _current(values["features"])}
    found = convert(values, Description, told)
    if not isinstance(found.architecture.get("name"), str):
        raise RsaDataError(f"{told}: architecture.name: expected text, found nothing")
    if found.features.dim < 1:
        raise RsaDataError(f"{told}: features.dim: expected at least 1")
    return found


class _Format(msgspec.Struct):
    format: int


def _current(features: dict[str, Any]) -> dict[str, Any]:
    """Until version 0.1 image features that stood behind a text's were named `images`."""
    if "images" in features and "beside" not in features:
        return {**features, "beside": [features["images"]]}
    return features
