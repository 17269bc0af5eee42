"""Lists, scene descriptions and camera files of the datasets."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rsa_data.common.errors import RsaDataError
from rsa_data.datasets import cameras, dgp
from rsa_data.datasets.dataset import Dataset
from rsa_data.datasets.ddad import ddad, read_depth
from rsa_data.datasets.folder import folder
from rsa_data.datasets.kitti import kitti, read_camera
from rsa_data.datasets.seven_scenes import seven_scenes
from rsa_data.datasets.sun3d import sun3d
from rsa_data.datasets.sunrgbd import sunrgbd
from rsa_data.datasets.void import void
from rsa_data.store import http

from .forms import (
    SHARED,
    Importer,
    One,
    js,
    list_seeds,
    put,
    shared,
)


def listed(
    files: tuple[str, ...], names: tuple[str, ...], build: Callable[[Path], Dataset]
) -> Callable[[Path], One]:
    """files : that lie below the root. names : what the input is written to, below it or beside."""

    def make(here: Path) -> One:
        root = here / "root"
        for name in files:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).touch()

        def one(data: bytes) -> None:
            for name in names:
                (here / name).write_bytes(data)
            found = build(here / names[0]).index(root, None)
            assert len(found)

        return one

    return make


KITTI = "2011_09_26/2011_09_26_drive_0002_sync"


def scene_seeds() -> list[bytes]:
    quaternion = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    pose = {"rotation": quaternion, "translation": {"x": 0.0, "y": 0.0, "z": 1.0}}
    image = {"filename": "rgb/C/1.jpg", "width": 8, "height": 6, "pose": pose}
    cloud = {"filename": "point_cloud/LIDAR/1.npz", "pose": pose}
    made = {
        "scene/scene_0.json": {
            "samples": [{"calibration_key": "k", "datum_keys": ["i", "l"]}],
            "data": [
                {"key": "i", "id": {"name": "CAMERA_01"}, "datum": {"image": image}},
                {"key": "l", "id": {"name": "LIDAR"}, "datum": {"point_cloud": cloud}},
            ],
        },
        "scene/calibration/k.json": {
            "names": ["CAMERA_01"],
            "intrinsics": [{"fx": 8.0, "fy": 8.0, "cx": 4.0, "cy": 3.0, "skew": 0.0}],
        },
        "ddad.json": {"scene_splits": {"0": {"filenames": ["scene/scene_0.json"]}}},
    }
    seeds = [made, {k: v for k, v in made.items() if k != "ddad.json"}]
    for path in SHARED.glob("rgbd/ddad/*/scene_*.json"):
        scene = json.loads(path.read_bytes())
        calibration = next(path.parent.glob("calibration/*.json"))
        scene["samples"][0]["calibration_key"] = "k"
        about = {"scene/scene_0.json": {k: scene[k] for k in ("samples", "data")}}
        seeds.append(about | {"scene/calibration/k.json": json.loads(calibration.read_bytes())})
    return [js(seed) for seed in seeds]


def scene(here: Path) -> One:
    place = here / "scene" / "point_cloud" / "LIDAR"
    place.mkdir(parents=True)
    np.savez(place / "1.npz", data=np.random.default_rng(0).uniform(-9, 9, (50, 4)))
    names = ("scene/scene_0.json", "scene/calibration/k.json", "ddad.json")

    def one(data: bytes) -> None:
        put(here, data, names)
        dgp.read_scene.cache_clear()
        ddad().index(here, None)
        read_depth(place / "1.npz#CAMERA_01")

    return one


def camera_text(here: Path) -> One:
    def one(data: bytes) -> None:
        (here / "a.txt").write_bytes(data)
        for read in (
            lambda path: cameras.read_matrix(path, "folder"),
            lambda path: read_camera(path, "02"),
        ):
            try:
                found = read(here / "a.txt")
            except RsaDataError:
                continue
            assert len(found) == 4 and all(isinstance(v, float) for v in found)

    return one


_FRAME = "image/0000001-000000000001.jpg"
_SUN = "SUNRGBD/kv1/NYUdata/NYU0001"
CAMERA_SEEDS = ["585 0 320\n0 585 240\n0 0 1\n",
                "P_rect_02: 7.2e+02 0 6e+02 4e+01 0 7.2e+02 1e+02 2e-01 0 0 1 2e-03\n"]  # fmt: skip

PAGES = [
    b'<a href="../">..</a><a href="a.png">a</a><a href="b/">b</a><a href="?C=N">N</a>',
    b'<pre><a href="/x/c%20d.jpg">c</a> 01-Jan 9K\n<A HREF=e.png>e</A></pre>',
    b'<a href="http://[::1">x</a><a href="//h/x/">y</a><a href="a%00b%2f..%2f">z</a>',
]


def listing_page(here: Path) -> One:
    """The page that a web server makes of a folder."""

    def one(data: bytes) -> None:
        for name in http.names(data, "http://h/x/"):
            step = name.removesuffix("/")
            assert step and "/" not in step and step not in (".", "..") and "\0" not in step, name

    return one


IMPORTERS = {
    "http-listing": Importer(lambda: PAGES, listing_page, "text"),
    "list-kitti": Importer(
        list_seeds(
            f"{KITTI}/image_02/data/0000000069.png None 721.5377",
            f"{KITTI}/image_02/data/0000000070.png 2011_09_26_drive_0002_sync/proj_depth/"
            "groundtruth/image_02/0000000070.png 721.5377",
        ),
        listed((f"{KITTI}/a.png",), ("list.txt",), lambda path: kitti(train_list=path)),
        "text",
    ),
    "list-void": Importer(
        list_seeds(*(f"void_release/void_1500/data/copyroom{k}/image/1.2.png" for k in range(3))),
        listed(
            ("void_1500/data/a",),
            tuple(
                f"root/void_1500/{s}_{w}.txt"
                for s in ("train", "test")
                for w in ("image", "ground_truth")
            ),
            lambda path: void(),
        ),
        "text",
    ),
    "list-sunrgbd": Importer(
        list_seeds(f"{_SUN}/image/NYU0001.jpg {_SUN}/depth/NYU0001.png"),
        listed(
            (f"{_SUN}/image/NYU0001.jpg", f"{_SUN}/depth/NYU0001.png"),
            ("list.txt",),
            lambda path: sunrgbd(test_list=path),
        ),
        "text",
    ),
    "list-sun3d": Importer(
        list_seeds("hotel_umd/maryland_hotel3"),
        listed(
            (f"hotel_umd/maryland_hotel3/{_FRAME}", "hotel_umd/maryland_hotel3/depth/1-1.png"),
            ("list.txt",),
            lambda path: sun3d(test_list=path),
        ),
        "text",
    ),
    "list-7scenes": Importer(
        list_seeds("sequence1", "sequence2"),
        listed(
            ("chess/seq-01/frame-000000.color.png", "chess/seq-02/frame-000001.color.jpg"),
            tuple(f"root/chess/{w}Split.txt" for w in ("Train", "Test")),
            lambda path: seven_scenes(),
        ),
        "text",
    ),
    "list-folder": Importer(
        list_seeds("a.jpg", "room/b c.png"),
        listed(
            ("a.jpg", "room/b c.png", "room/d.png"),
            ("list.txt",),
            lambda path: folder(test_list=path),
        ),
        "text",
    ),
    "list-files": Importer(
        list_seeds("a.jpg", "room/b c.png", "room/depth/b c.png", "test/x.png", "train/x.png"),
        listed(("a.jpg",), ("list.txt",), lambda path: folder(file_list=path)),
        "text",
    ),
    "dgp": Importer(scene_seeds, scene),
    "camera": Importer(
        lambda: [*map(str.encode, CAMERA_SEEDS), *shared("rgbd/*/*calib*.txt", "rgbd/7scenes/c*")],
        camera_text,
        "text",
    ),
}
