"""What a prediction can be given besides photos and a head: options that belong together."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from ...common.ranges import Count


@dataclass(frozen=True)
class Models:
    """The models that look at a photo, and their files.

    segments : what finds the objects; see `rsa-data list segmenters`. By default the model that the
        head was trained with.
    segmenter_weights : file of the segmenter's weights, instead of the download.
    card : model card (TOML) of a segmenter of your own.
    style : wording of the caption, by default that of the head's training captions; see
        `rsa-data list styles`.
    encoder_weights : file of the text encoder's weights, instead of the download.
    depth_model : relative-depth model, by default that of the head; see
        `rsa-data list depth-models`.
    depth_weights : file of the depth model's weights, instead of the download.
    depth_card : model card (TOML) of a depth model of your own.
    relative : relative depth instead of a model's, larger is nearer (a depth map is the wrong way
        round): .npy or 16-bit PNG (value / 65535), or a folder of maps named like the photos.
    """

    segments: str | None = None
    segmenter_weights: Path | None = None
    card: Path | None = None
    style: str | None = None
    encoder_weights: Path | None = None
    depth_model: str | None = None
    depth_weights: Path | None = None
    depth_card: Path | None = None
    relative: Path | None = None


@dataclass(frozen=True)
class Hints:
    """What is known of the scene, or of the frames around.

    known : a point of known depth as u,v,metres (pixel column and row, may be repeated); one gives
        the scale, two or more give scale and shift, and with a head they correct what it says.
    range : depth of the nearest and of the farthest part (1st and 99th percentile) as near,far in
        metres; used like two points.
    smooth : number of consecutive frames over which scale and shift are averaged.
    """

    known: tuple[str, ...] = ()
    range: str | None = None
    smooth: Count = 0

    def __bool__(self) -> bool:
        return bool(self.known or self.range)


@dataclass(frozen=True)
class View:
    """The camera, where the photo does not say it in its EXIF data.

    intrinsics : focal lengths and principal point as fx,fy,cx,cy in px of the photo.
    fov : horizontal field of view in degrees, instead of intrinsics.
    """

    intrinsics: str | None = None
    fov: Annotated[float, msgspec.Meta(ge=1, le=179)] | None = None
