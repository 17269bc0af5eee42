"""Images whose words tell scale and shift, written into a work dir: for tests of evaluation."""

import numpy as np
from made_tables import write

from rsa_data.store.tables import WorkDir

SIZE = (6, 8)


def images(work: WorkDir, dataset: str, n: int, split: str, first_part: int = 0, **more):
    """n images of 4 kinds of room, whose words tell scale and shift; y and depth of 48 pixels."""
    rng = np.random.default_rng(n)
    kind = np.arange(n) % 4
    vectors = {f"a {k}": np.eye(4, 16)[k].astype(np.float16) for k in range(4)}
    scale, shift = 0.05 * (1 + kind), 0.1 + 0.05 * kind
    y = rng.uniform(0, 10, (n, 48))
    depth = 1 / (scale[:, None] * y + shift[:, None])
    if split == "test":
        depth[:, 0] = 0
    arrays = {
        "scenes": [f"{split} {i // 4}" for i in range(n)],
        "texts": [[f"a {k}", f"a {(k + 1) % 4}"] for k in kind],
        "features": vectors,
        "relative": y,
        "metric": depth,
        "split": split,
        "first_part": first_part,
        "size": SIZE if split == "test" else None,
    }
    write(work, dataset, **arrays | more)


def maps(work: WorkDir, dataset: str, part: int):
    table = work.table(dataset, "depth/files").read(part)
    for row in table.to_pylist():
        yield tuple(
            np.frombuffer(row[c], "<f2").reshape(SIZE).astype(float) for c in ("relative", "metric")
        )


FAST = {"batch": 8, "pixels": 48, "validation": 0.2, "threads": 1}
