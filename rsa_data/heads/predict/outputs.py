"""Metric depth as a file: .npy, 16-bit PNG in mm, or a coloured point cloud."""

from pathlib import Path

import numpy as np

from ...common.errors import RsaDataError, UsageError

KINDS = (".npy", ".png", ".ply")


def write_depth(
    path: Path,
    depth: np.ndarray,
    intrinsics: tuple[float, float, float, float] | None = None,
    colours: np.ndarray | None = None,
) -> None:
    """Writes a depth map in the kind that the file name's ending says.

    depth : float32 (h, w), m; inf beyond everything, nan unknown.
    .npy : as it is. .png : uint16, mm, 0 where unknown, 65535 from 65.535 m on (inf too).
    .ply : a point a pixel of finite depth; needs intrinsics fx, fy, cx, cy, px of this map.
        x right, y down, z forward, m. colours : uint8 (h, w, 3), RGB.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"--out {path.name}: expected a name ending in {', '.join(KINDS)}")
    if kind == ".ply" and intrinsics is None:
        raise UsageError(
            f"--out {path.name}: a point cloud needs the camera: --intrinsics fx,fy,cx,cy in px of "
            f"the relative depth ({depth.shape[1]} x {depth.shape[0]})"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if kind == ".npy":
            with path.open("wb") as file:
                np.save(file, depth.astype(np.float32))
        elif kind == ".png":
            path.write_bytes(_png(depth))
        else:
            assert intrinsics is not None
            path.write_bytes(_ply(depth, intrinsics, colours))
    except OSError as error:
        raise RsaDataError(f"{path}: cannot be written: {error.strerror or error}") from error


def _png(depth: np.ndarray) -> bytes:
    import cv2

    millimetres = np.nan_to_num(depth * 1000.0, nan=0.0, posinf=65535.0)
    image = np.clip(np.rint(millimetres), 0, 65535).astype(np.uint16)
    done, data = cv2.imencode(".png", image)
    assert done
    return data.tobytes()


def _ply(
    depth: np.ndarray, intrinsics: tuple[float, float, float, float], colours: np.ndarray | None
) -> bytes:
    fx, fy, cx, cy = intrinsics
    v, u = np.nonzero(np.isfinite(depth) & (depth > 0))
    z = depth[v, u]
    columns = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if colours is not None:
        columns += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    points = np.zeros(len(z), columns)
    points["x"], points["y"], points["z"] = (u - cx) / fx * z, (v - cy) / fy * z, z
    if colours is not None:
        for i, name in enumerate(("red", "green", "blue")):
            points[name] = colours[v, u, i]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = "".join(f"property {kinds[kind]} {name}\n" for name, kind in columns)
    start = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(z)}\n{header}end_header\n"
    return start.encode() + points.tobytes()
