"""The baseline that knows the dataset and nothing of the image: one scale and shift for all."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..common.errors import RsaDataError
from ..datasets import index
from ..runner.commands import again
from ..store.tables import WorkDir


def fit_constant(
    groups: Sequence[tuple[np.ndarray, np.ndarray, float]], relative: bool = True
) -> tuple[float, float]:
    """The positive scale and shift with the least error in metric depth over all groups.

    groups : (y, depth in m, max_depth in m) of each dataset, arrays of shape (n,). The error is
        |min(1 / (scale * y + shift), max_depth) - depth|; a group's is its mean over the depth of
        each pixel (relative: AbsRel, the figure that tables compare, so that nothing constant
        does better there) or over the group's mean depth (L1, the loss of a head). Groups count
        alike, so that streets do not outweigh rooms.

    Scale and shift are positive as a head's are, so that a head beats this only by what it knows of
    the image. Searched on a grid of the two logarithms that closes in on its
    best point: no start to choose, no local minimum between grid points of the first, wide round.
    """
    scaled = [
        (
            np.asarray(y, np.float64),
            np.asarray(d, np.float64),
            1.0 / m,
            1.0 / np.asarray(d) if relative else 1.0 / np.mean(d),
        )
        for y, d, m in groups
    ]

    def loss(log_scale: float, log_shift: float) -> float:
        scale, shift = np.exp(log_scale), np.exp(log_shift)
        return sum(
            float(np.mean(np.abs(1.0 / np.maximum(scale * y + shift, floor) - d) * weight))
            for y, d, floor, weight in scaled
        )

    # A scale of 1 is a median y at the median inverse depth; shifts reach from 1 km to 10 cm.
    usual = np.median(
        [np.median(1.0 / d) / max(np.median(np.abs(y)), 1e-9) for y, d, _, _ in scaled]
    )
    centre, reach = np.array([np.log(usual), np.log(0.1)]), np.array([7.0, 4.6])
    best = np.inf
    for _ in range(24):
        axes = [np.linspace(c - r, c + r, 9) for c, r in zip(centre, reach, strict=True)]
        losses = np.array([[loss(a, b) for b in axes[1]] for a in axes[0]])
        i, j = np.unravel_index(np.argmin(losses), losses.shape)
        if losses[i, j] < best:
            best, centre = losses[i, j], np.array([axes[0][i], axes[1][j]])
        reach = reach * 0.6
    return float(np.exp(centre[0])), float(np.exp(centre[1]))


def training_pixels(
    work: WorkDir, dataset: str, depth: str, images: int = 1000, pixels: int = 64
) -> tuple[np.ndarray, np.ndarray]:
    """(y, depth in m) of pixels of the training images of a dataset, float32 of shape (n,).

    depth : the table's name. images : at most so many, spread evenly over all; pixels : of each.
    Raises RsaDataError when the table holds no training part.
    """
    table, role = work.table(dataset, depth), index.load_dataset(work, dataset).role
    good = {n: r.ok for n in table.parts() if role((r := table.receipt(n)).split) == "train"}
    total = sum(good.values())
    if not total:
        raise RsaDataError(
            f"{table}: no training image there, so there is no constant to fit. Run "
            f"`{again(work, table, ' --split train')}`"
        )
    wanted = np.unique(np.linspace(0, total - 1, min(images, total)).astype(int))
    y: list[np.ndarray] = []
    metric: list[np.ndarray] = []
    begun = 0
    for number, ok in good.items():
        inside = wanted[(wanted >= begun) & (wanted < begun + ok)] - begun
        begun += ok
        if not len(inside):
            continue
        part = table.read(number, ["relative", "metric"]).drop_null().take(inside)
        for column, values in (("relative", y), ("metric", metric)):
            for data in part[column].to_pylist():
                # Pixels stand in random order, so the first are a sample.
                values.append(np.frombuffer(data, "<f2", min(pixels, len(data) // 2)))
    return np.concatenate(y).astype(np.float32), np.concatenate(metric).astype(np.float32)


def fit_constants(
    work: WorkDir,
    depths: Mapping[str, str],
    limits: Mapping[str, tuple[float, float]],
    trained_on: Iterable[str],
) -> dict[str, dict[str, tuple[float, float]]]:
    """For each dataset evaluated, its own constant and the joint one, where they can be had.

    depths : dataset -> its depth table. limits : dataset -> (min, max) depth, m.
    trained_on : the datasets that the joint constant is fitted on (those of the head); where none
        of them is in the work dir there is no joint constant. A dataset without a training split
        has no constant of its own.
    """
    groups = {}
    for name, depth in depths.items():
        table, role = work.table(name, depth), index.load_dataset(work, name).role
        if any(role(table.receipt(n).split) == "train" for n in table.parts()):
            groups[name] = (*training_pixels(work, name, depth), limits[name][1])
    joint = [groups[name] for name in trained_on if name in groups]
    # With one training set the joint constant is that set's own.
    useful = len(joint) > 1 or (joint and set(depths) - set(trained_on))
    shared = fit_constant(joint) if useful else None

    def own(group: tuple[np.ndarray, np.ndarray, float]) -> dict[str, tuple[float, float]]:
        return {
            "constant": fit_constant([group]),
            "constant (L1)": fit_constant([group], relative=False),
        }

    return {
        name: {
            **(own(groups[name]) if name in groups else {}),
            **({"joint constant": shared} if shared else {}),
        }
        for name in depths
    }
