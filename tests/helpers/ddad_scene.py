"""A DDAD scene of one camera and one LiDAR, written by hand."""

import json
from pathlib import Path

import numpy as np


def pose(x=0.0, y=0.0, z=0.0, rotation=(1.0, 0.0, 0.0, 0.0)):
    return {
        "rotation": dict(zip(("qw", "qx", "qy", "qz"), rotation, strict=True)),
        "translation": {"x": x, "y": y, "z": z},
    }


def write_scene(folder: Path, points, **changes) -> None:
    """A scene with one camera of 8 x 6 px, f = 4 px, and the LiDAR 1 m behind it."""
    intrinsics = {"fx": 4.0, "fy": 4.0, "cx": 4.0, "cy": 3.0, "skew": 0.0}
    image = {"filename": "rgb/CAM/5.png", "width": 8, "height": 6, "pose": pose(z=1.0)}
    cloud = {"filename": "point_cloud/LIDAR/7.npz", "pose": pose()}
    scene = {
        "samples": [{"calibration_key": "c", "datum_keys": ["i", "l"]}],
        "data": [
            {"key": "i", "id": {"name": "CAM"}, "datum": {"image": image}},
            {"key": "l", "id": {"name": "LIDAR"}, "datum": {"point_cloud": cloud}},
        ],
    }
    for place in ("calibration", "point_cloud/LIDAR"):
        (folder / place).mkdir(parents=True)
    known = {"names": ["CAM"], "intrinsics": [{**intrinsics, **changes}]}
    (folder / "calibration" / "c.json").write_text(json.dumps(known))
    (folder / "scene_1.json").write_text(json.dumps(scene))
    np.savez(folder / "point_cloud" / "LIDAR" / "7.npz", data=np.array(points, np.float64))
