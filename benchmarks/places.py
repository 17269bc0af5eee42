"""A folder of real frames in the layout that pipelines/places.toml reads.

    python benchmarks/places.py MOSAIC OUT
    rsa-data run places --root rooms=OUT/rooms --root streets=OUT/streets ...

MOSAIC has index.json, PLACE/FRAME_rgb.* and PLACE/FRAME_depth.png (uint16, 0 = none,
`depth_units_per_m` of the index). A place whose median depth is above 6 m, or whose depth reaches
beyond 20 m, is a street. Depth of streets is written in m/256, of rooms in mm; files whose unit is
that already are copied as they are.
"""

import argparse
import json
import shutil
from pathlib import Path

import cv2
import numpy as np

UNITS = {"rooms": 1000, "streets": 256}


def arrange(mosaic: Path, out: Path, frames: int | None = None) -> dict[str, int]:
    """Writes OUT/rooms and OUT/streets; at most so many frames of a place. Frames by kind."""
    taken: dict[str, int] = {}
    counts = dict.fromkeys(UNITS, 0)
    for entry in json.loads((mosaic / "index.json").read_text("utf-8")):
        place, frame, unit = entry["scene"], entry["frame"], entry["depth_units_per_m"]
        taken[place] = taken.get(place, 0) + 1
        if frames is not None and taken[place] > frames:
            continue
        kind = "streets" if entry["median"] > 6 or entry["p98"] > 20 else "rooms"
        counts[kind] += 1
        image = next((mosaic / place).glob(f"{frame}_rgb.*"))
        depth = mosaic / place / f"{frame}_depth.png"
        target = out / kind / place
        for name in ("rgb", "depth"):
            (target / name).mkdir(parents=True, exist_ok=True)
        shutil.copy(image, target / "rgb" / f"{frame}{image.suffix}")
        if unit == UNITS[kind]:
            shutil.copy(depth, target / "depth" / f"{frame}.png")
        else:
            raw = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED).astype(np.float64)
            steps = np.round(raw / unit * UNITS[kind]).clip(0, 65534).astype(np.uint16)
            cv2.imwrite(str(target / "depth" / f"{frame}.png"), steps)
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mosaic", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    counts = arrange(given.mosaic, given.out)
    print(", ".join(f"{count} frames of {kind}" for kind, count in counts.items()))


if __name__ == "__main__":
    main()
