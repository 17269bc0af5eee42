"""The paper's datasets on small made images, in their own layouts, and models that stand in.

Scenes of one kind have one range of depth and one list of objects; images are as bright as near.
Nothing here is the paper's data, nor are the models its models: they only have their shapes.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import torch
from ddad_scene import write_scene
from own_models import write_graph

from rsa_data.common.tokenizers import clip
from rsa_data.embeddings.batches import PREFIX_AXES, by_prefix
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.encoder import Encoder, TextModel

KINDS = (
    (1.5, "bed 0.3\nwall 0.4\nlamp 0.02\n"),
    (2.5, "chair 0.1\nchair 0.08\ntable 0.2\nwall 0.5\n"),
    (4.0, "counter 0.3\nfloor 0.3\nwindow 0.1\n"),
)
STREETS = (
    (12.0, "car 0.1\nroad 0.4\ntree 0.2\n"),
    (25.0, "road 0.5\nsky 0.2\nbuilding 0.1\n"),
)


def _maps(far: float, width: int, height: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Depth in m, a slope with noise, and the image, uint8 (height, width, 3)."""
    rng = np.random.default_rng(seed)
    depth = far * np.linspace(0.5, 1.0, width)[None, :] * rng.uniform(0.95, 1.05, (height, 1))
    grey = np.clip(255 * 0.6 * far / depth - 40 + 5 * (seed % 3), 1, 254)
    return depth.astype(np.float32), np.repeat(grey.astype(np.uint8)[..., None], 3, 2)


def _frame(image: Path, depth: Path, far: float, size: tuple[int, int], unit: float, seed: int):
    metres, pixels = _maps(far, *size, seed)
    for path, content in ((image, pixels), (depth, np.rint(metres * unit).astype(np.uint16))):
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), content)


def _text(release: Path, dataset: str, split: str, key: str, objects: str) -> None:
    lines = "".join(f"View {n} of {objects.split()[0]} and more.\n" for n in range(15))
    for kind, content in (("seg_txt_panoptic", objects), ("text_all", lines)):
        path = release / "text" / kind / dataset / split / f"{key}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)


def write_paper(folder: Path) -> None:
    """Six datasets below a folder, and RSA, the release's segments."""
    release = folder / "RSA"
    for split, place, n in (("train", "sync", 12), ("test", "official_splits/test", 3)):
        for i in range(n):
            far, objects = KINDS[i % 3]
            key = f"room_{i // 2:04d}a/rgb_{i:05d}" if split == "train" else f"room/rgb_{i:05d}"
            image = folder / "nyuv2" / place / f"{key}.jpg"
            depth = image.with_name(f"sync_depth_{i:05d}.png")
            _frame(image, depth, far, (64, 48), 1000, i)
            _text(release, "nyu", split, key, objects)
    _write_kitti(folder / "kitti", release)
    _write_void(folder / "void", release)
    sun = "SUNRGBD/kv2/kinect2data"
    listed = []
    for i in range(2):
        paths = f"{sun}/{i}/image/{i}.jpg", f"{sun}/{i}/depth/{i}.png"
        listed.append(" ".join(paths))
        image, depth = (folder / "sunrgbd" / path for path in paths)
        # 1/8 mm: the stored bits are rotated by 3.
        _frame(image, depth, KINDS[i][0], (73, 53), 8000, i)
    (folder / "sunrgbd" / "SUNRGBD_val_splits.txt").write_text("\n".join(listed))
    for i in range(2):
        place = folder / "sun3d" / f"place{i}" / "seq"
        _frame(place / "image/1-1.jpg", place / "depth/1-1.png", KINDS[i][0], (64, 48), 8000, i)
    (folder / "sun3d_test.txt").write_text("place0/seq\nplace1/seq\n")
    points = [[x / 4, y / 4, 5 + abs(x), 9] for x in range(-6, 7) for y in range(-4, 5)]
    write_scene(folder / "ddad" / "000", points)
    image = folder / "ddad/000/rgb/CAM/5.png"
    image.parent.mkdir(parents=True)
    cv2.imwrite(str(image), _maps(20, 8, 6, 0)[1])
    splits = {"scene_splits": {"1": {"filenames": ["000/scene_1.json"]}}}
    (folder / "ddad/ddad.json").write_text(json.dumps(splits))
    human = {f"nyuv2/test/room/rgb_{i:05d}": f"a small room with {i} beds" for i in range(3)}
    (folder / "human.json").write_text(json.dumps(human))


def _write_kitti(root: Path, release: Path) -> None:
    for split, n in (("train", 8), ("test", 2)):
        lines = []
        for i in range(n):
            far, objects = STREETS[i % 2]
            drive = f"2011_09_26_drive_{i // 2 + 10 * (split == 'test'):04d}_sync"
            key = f"2011_09_26/{drive}/image_02/data/{i:010d}"
            truth = f"{drive}/proj_depth/groundtruth/image_02/{i:010d}.png"
            depth = root / "data_depth_annotated" / truth
            _frame(root / f"{key}.png", depth, far, (1242, 375), 256, i)
            lines.append(f"{key}.png {truth} 721.5377")
            _text(release, "kitti", split, key, objects)
        (root / f"eigen_{split}_files_with_gt.txt").write_text("\n".join(lines))
    camera = "P_rect_02: 721.5 0 609.6 44.9 0 721.5 172.9 0.2 0 0 1 0.003\n"
    (root / "2011_09_26/calib_cam_to_cam.txt").write_text(camera)


def _write_void(root: Path, release: Path) -> None:
    for split, n in (("train", 8), ("test", 2)):
        images, depths = [], []
        for i in range(n):
            far, objects = KINDS[i % 3]
            sequence = f"void_1500/data/{split}{'abcd'[i // 2]}"
            image, depth = (f"{sequence}/{kind}/{i}.png" for kind in ("image", "ground_truth"))
            _frame(root / image, root / depth, far, (64, 48), 256, i)
            (root / sequence / "K.txt").write_text("500 0 32\n0 500 24\n0 0 1\n")
            images.append(image)
            depths.append(depth)
            _text(release, "void", split, image.removesuffix(".png"), objects)
        for kind, paths in (("image", images), ("ground_truth", depths)):
            (root / "void_1500" / f"{split}_{kind}.txt").write_text("\n".join(paths))


def write_depth_model(path: Path, gain: float) -> Path:
    """In the place of a depth model: the brighter, the nearer, at any size."""
    return write_graph(
        path,
        [
            ("ReduceMean", ["x"], ["grey"], {"axes": [1], "keepdims": 0}),
            ("Mul", ["grey", "gain"], ["much"]),
            ("Exp", ["much"], ["y"]),
        ],
        [("x", [1, 3, "h", "w"])],
        [("y", [1, "h", "w"])],
        [("gain", np.float32(gain))],
    )


def write_maskdino(path: Path) -> Path:
    """In the place of MaskDINO: a bed where the picture is bright and a wall where it is dark."""
    logits = np.full((1, 3, 133), -6, np.float32)
    logits[0, 0, 59] = logits[0, 1, 131] = 4  # bed, wall-other of its 133 classes
    signs = np.array([1, -1, 0], np.float32).reshape(1, 3, 1, 1)
    return write_graph(
        path,
        [
            ("ReduceMean", ["image"], ["grey"], {"axes": [1], "keepdims": 1}),
            ("ReduceMean", ["grey"], ["mean"], {"axes": [2, 3], "keepdims": 1}),
            ("Sub", ["grey", "mean"], ["bright"]),
            ("Mul", ["bright", "signs"], ["two"]),
            ("Add", ["two", "never"], ["pred_masks"]),
            ("ReduceMean", ["image"], ["level"], {"axes": [1, 2, 3], "keepdims": 0}),
            ("Mul", ["level", "none"], ["zero"]),
            ("Add", ["zero", "logits"], ["pred_logits"]),
            ("Mul", ["level", "each"], ["features"]),
        ],
        [("image", [1, 3, "h", "w"])],
        [
            ("pred_logits", [1, 3, 133]),
            ("pred_masks", [1, 3, "h", "w"]),
            ("features", [1, 3, 4]),
        ],
        [
            ("signs", signs),
            ("never", np.array([0, 0, -9], np.float32).reshape(1, 3, 1, 1)),
            ("none", np.float32(0)),
            ("logits", logits),
            ("each", np.linspace(-1, 1, 12, dtype=np.float32).reshape(1, 3, 4)),
        ],
    )


def _load(files: dict[str, Path]) -> TextModel:
    torch.manual_seed(0)
    tower = TextTower(width=16, heads=1, layers=1, dim=16).eval()
    with torch.no_grad():
        for name, parameter in tower.named_parameters():
            parameter.normal_(1.0 if "ln_" in name and "weight" in name else 0.0, 0.3)
    return TextModel(lambda: tower, clip().encode, by_prefix, 512, PREFIX_AXES, 16, False)


# In the place of CLIP's text tower: its tokenizer and its kind of network, 16 numbers a text.
TEXTS = Encoder("A tiny text tower.", lambda argument, weights: {}, _load)
