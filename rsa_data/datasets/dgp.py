"""TRI's DGP scenes, the format of DDAD: JSON of cameras, LiDAR, poses; projecting the LiDAR.

Follows dgp/utils/camera.py (generate_depth_map) of https://github.com/TRI-ML/dgp, but where two
points fall on one pixel the nearer one is kept, not the later one.
"""

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..common import bounded
from ..common.errors import RowError, RsaDataError
from .images import read_bytes, reason
from .listing import inside
from .pixel_files import check_header


@dataclass(frozen=True)
class View:
    """One image of a scene and the LiDAR sweep of the same sample.

    camera : name, such as CAMERA_01.
    image, lidar : paths below the scene's folder; lidar None where the sample has no sweep.
    width, height : px.
    intrinsics : fx, fy, cx, cy, skew, px.
    camera_from_lidar : float64 of shape (4, 4), m; through the world, as each has its own time.
    """

    camera: str
    image: str
    lidar: str | None
    width: int
    height: int
    intrinsics: tuple[float, float, float, float, float]
    camera_from_lidar: np.ndarray


@lru_cache(maxsize=4)
def read_scene(path: Path) -> tuple[View, ...]:
    """All images of a scene_*.json, in the order of its samples.

    Raises RsaDataError when it, or the calibration that it names, is not as expected.
    """
    try:
        return tuple(_views(path))
    except (OSError, ArithmeticError, ValueError, LookupError, TypeError, AttributeError) as error:
        what = f"{type(error).__name__}: {error}"
        raise RsaDataError(
            f"ddad: {path}: expected a DGP scene with its calibration, found {what}; see "
            "`rsa-data list datasets ddad`"
        ) from error


def _views(path: Path) -> Iterator[View]:
    scene = bounded.read_json(path)
    data = {entry["key"]: entry for entry in scene["data"]}
    where = f"ddad: {path}"
    for sample in scene["samples"]:
        key = inside(sample["calibration_key"], where)
        cameras = _calibration(path.parent / "calibration" / f"{key}.json")
        entries = [data[key] for key in sample["datum_keys"]]
        clouds = [e["datum"]["point_cloud"] for e in entries if "point_cloud" in e["datum"]]
        cloud = clouds[0] if clouds else None
        for entry in entries:
            if (image := entry["datum"].get("image")) is None:
                continue
            size = int(image["width"]), int(image["height"])
            if not 0 < min(size) <= max(size) < 1 << 16:
                raise ValueError(f"an image of {size[0]} x {size[1]} px")
            world_from_camera = _transform(image["pose"])
            world_from_lidar = _transform(cloud["pose"]) if cloud else world_from_camera
            yield View(
                camera=str(entry["id"]["name"]),
                image=inside(image["filename"], where),
                lidar=inside(cloud["filename"], where) if cloud else None,
                width=size[0],
                height=size[1],
                intrinsics=cameras[entry["id"]["name"]],
                camera_from_lidar=np.linalg.inv(world_from_camera) @ world_from_lidar,
            )


def _calibration(path: Path) -> dict[str, tuple[float, float, float, float, float]]:
    """Intrinsics by the name of the sensor. Images are rectified: distortion is refused."""
    known = bounded.read_json(path)
    cameras = {}
    for name, given in zip(known["names"], known["intrinsics"], strict=True):
        fx, fy, cx, cy, skew = (float(given[k]) for k in ("fx", "fy", "cx", "cy", "skew"))
        if bent := [k for k in given if k not in ("fx", "fy", "cx", "cy", "skew") and given[k]]:
            raise ValueError(f"a camera {name} with distortion ({', '.join(bent)})")
        if not (np.isfinite((fx, fy, cx, cy, skew)).all() and min(fx, fy) >= 0):
            raise ValueError(f"a camera {name} with fx {fx}, fy {fy}, cx {cx}, cy {cy}")
        cameras[name] = fx, fy, cx, cy, skew
    return cameras


def _transform(pose: dict[str, Any]) -> np.ndarray:
    """(4, 4) of a pose: unit quaternion w x y z and translation in m."""
    w, x, y, z = (float(pose["rotation"][f"q{axis}"]) for axis in "wxyz")
    norm = w * w + x * x + y * y + z * z
    if not 0.9 < norm < 1.1:
        raise ValueError(f"a rotation of length {norm:.3g}")
    matrix = np.eye(4)
    matrix[:3, :3] -= (2 / norm) * np.array(
        [
            [y * y + z * z, z * w - x * y, -x * z - y * w],
            [-x * y - z * w, x * x + z * z, x * w - y * z],
            [y * w - x * z, -y * z - x * w, x * x + y * y],
        ]
    )
    matrix[:3, 3] = [float(pose["translation"][axis]) for axis in "xyz"]
    if not np.isfinite(matrix).all():
        raise ValueError("a pose that is not finite")
    return matrix


def read_points(path: Path) -> np.ndarray:
    """float64 of shape (n, 3): x, y, z in m in the LiDAR's frame. RowError when unreadable."""
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path))) as archive:
            size = archive.getinfo("data.npy").file_size
            if size > bounded.limit("image"):
                raise bounded.over("image", size)
            with archive.open("data.npy") as file:
                check_header(file, size)
            with archive.open("data.npy") as file:
                points = np.lib.format.read_array(file, allow_pickle=False).astype(np.float64)
        if points.ndim != 2 or points.shape[1] < 3:
            raise ValueError(f"data of shape {points.shape}")
    except RowError:
        raise
    except Exception as error:  # a damaged archive raises anything from KeyError to zlib.error
        raise RowError(f"depth: unreadable point cloud: {reason(error)}") from error
    return points[:, :3]


def project(points: np.ndarray, view: View) -> np.ndarray:
    """Depth along the optical axis: float32 of shape (height, width), m, 0 where no point falls.

    points : float64 of shape (n, 3), m, in the LiDAR's frame.
    """
    turned = points @ view.camera_from_lidar[:3, :3].T + view.camera_from_lidar[:3, 3]  # (n, 3)
    x, y, z = turned[turned[:, 2] > 0].T
    fx, fy, cx, cy, skew = view.intrinsics
    u = np.floor((fx * x + skew * y) / z + cx)
    v = np.floor(fy * y / z + cy)
    seen = (u >= 0) & (u < view.width) & (v >= 0) & (v < view.height)
    u, v, z = u[seen].astype(np.intp), v[seen].astype(np.intp), z[seen]
    depth = np.full((view.height, view.width), np.inf, np.float32)
    np.minimum.at(depth, (v, u), z.astype(np.float32))
    depth[np.isinf(depth)] = 0
    return depth
