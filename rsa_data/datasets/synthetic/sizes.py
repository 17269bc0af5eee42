"""Usual metric sizes of what stands in rooms and streets."""

import numpy as np

Size = tuple[float, float, float]
Range = tuple[float, float]

# Width, depth, height in metres, each drawn evenly from its range. Furniture: ranges of common
# catalogue sizes (beds 0.9 to 1.8 m by 2 m, seats 0.4 to 0.5 m high, worktops and tables at
# 0.72 to 0.92 m, doors 0.8 to 0.95 m by 2 m). Vehicles: European cars of the small to large class;
# buses and lorries within the limits of EU directive 96/53/EC (2.55 m wide, 4 m high). Buildings:
# storeys of about 3 m.
SIZES: dict[str, tuple[Range, Range, Range]] = {
    "banner": ((1.0, 3.0), (0.03, 0.04), (0.6, 1.2)),
    "bed": ((0.9, 1.8), (1.9, 2.1), (0.85, 1.15)),
    "bench": ((1.3, 2.0), (0.4, 0.5), (0.42, 0.48)),
    "bicycle": ((1.6, 1.8), (0.4, 0.5), (1.0, 1.1)),
    "book": ((0.16, 0.30), (0.2, 0.25), (0.03, 0.15)),
    "bottle": ((0.07, 0.1), (0.07, 0.1), (0.25, 0.33)),
    "building": ((9.0, 22.0), (9.0, 14.0), (6.0, 30.0)),
    "bus": ((2.5, 2.55), (10.5, 12.5), (2.9, 3.2)),
    "cabinet": ((0.8, 1.8), (0.4, 0.6), (0.85, 2.1)),
    "car": ((1.65, 1.95), (3.7, 4.9), (1.42, 1.7)),
    "cardboard": ((0.4, 1.0), (0.4, 0.8), (0.3, 0.9)),
    "chair": ((0.42, 0.55), (0.45, 0.55), (0.8, 0.98)),
    "clock": ((0.25, 0.4), (0.04, 0.05), (0.25, 0.4)),
    "couch": ((1.5, 2.6), (0.85, 1.0), (0.75, 0.9)),
    "counter": ((1.2, 2.4), (0.6, 0.65), (0.88, 0.93)),
    "cup": ((0.08, 0.1), (0.08, 0.1), (0.09, 0.12)),
    "curtain": ((0.4, 0.7), (0.08, 0.12), (2.0, 2.2)),
    "dining table": ((1.2, 2.2), (0.8, 1.0), (0.72, 0.78)),
    "door": ((0.8, 0.95), (0.05, 0.06), (1.98, 2.05)),
    "fence": ((4.0, 9.0), (0.08, 0.1), (0.9, 1.5)),
    "house": ((7.0, 12.0), (7.0, 10.0), (4.0, 6.2)),
    "keyboard": ((0.4, 0.46), (0.14, 0.16), (0.02, 0.04)),
    "laptop": ((0.3, 0.38), (0.22, 0.26), (0.2, 0.26)),
    "light": ((0.3, 0.6), (0.3, 0.6), (0.08, 0.14)),
    "microwave": ((0.45, 0.55), (0.35, 0.4), (0.27, 0.32)),
    "mirror": ((0.5, 0.9), (0.03, 0.04), (0.6, 1.0)),
    "motorcycle": ((0.75, 0.85), (2.0, 2.2), (1.05, 1.2)),
    "net": ((5.0, 7.0), (0.05, 0.06), (2.0, 2.4)),
    "oven": ((0.58, 0.62), (0.58, 0.62), (0.85, 0.92)),
    "person": ((0.44, 0.54), (0.26, 0.34), (1.55, 1.88)),
    "pillow": ((0.4, 0.6), (0.3, 0.4), (0.12, 0.16)),
    "potted plant": ((0.4, 0.7), (0.4, 0.7), (0.6, 1.5)),
    "refrigerator": ((0.58, 0.75), (0.6, 0.7), (1.55, 2.0)),
    "rug": ((1.4, 2.6), (1.0, 1.8), (0.015, 0.02)),
    "shelf": ((0.8, 1.6), (0.3, 0.4), (1.6, 2.1)),
    "sink": ((0.45, 0.62), (0.4, 0.5), (0.82, 0.88)),
    "sports ball": ((0.22, 0.25), (0.22, 0.25), (0.22, 0.25)),
    "stop sign": ((0.7, 0.8), (0.06, 0.08), (2.6, 3.0)),
    "storage rack": ((2.4, 4.0), (1.0, 1.2), (3.0, 5.5)),
    "suitcase": ((0.4, 0.5), (0.22, 0.28), (0.55, 0.75)),
    "toilet": ((0.36, 0.4), (0.6, 0.7), (0.75, 0.82)),
    "towel": ((0.4, 0.6), (0.04, 0.06), (0.6, 0.9)),
    "traffic light": ((0.3, 0.36), (0.3, 0.36), (3.0, 3.6)),
    "tree": ((2.4, 5.5), (2.4, 5.5), (4.5, 9.5)),
    "truck": ((2.45, 2.55), (7.5, 14.0), (3.3, 4.0)),
    "tv": ((0.8, 1.5), (0.05, 0.08), (0.48, 0.85)),
    "umbrella": ((2.2, 2.8), (2.2, 2.8), (2.3, 2.6)),
    "vase": ((0.12, 0.2), (0.12, 0.2), (0.25, 0.4)),
    "window": ((0.9, 2.0), (0.05, 0.06), (1.0, 1.5)),
}


def draw_size(name: str, rng: np.random.Generator) -> Size:
    """Width, depth, height of one object of this kind, m."""
    low, high = np.array(SIZES[name]).T
    w, d, h = rng.uniform(low, high)
    return float(w), float(d), float(h)
