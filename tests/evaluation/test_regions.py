"""Fits in each region: exact where regions have scales of their own, and never on what they see."""

import numpy as np
import pytest
from evaluated import images

from rsa_data.evaluation.inputs import TestPart
from rsa_data.evaluation.protocols import Rules, whole
from rsa_data.evaluation.regions import by_regions, fitted, halves, rescaled
from rsa_data.evaluation.rows import measure
from rsa_data.segments import masks
from rsa_data.segments.segments import Segments, to_table
from rsa_data.store.tables import Description, Made, WorkDir

pytest.importorskip("pycocotools")

SIZE = (12, 16)
LEFT = np.arange(16)[None] < 8
ALL = np.ones(SIZE, bool)


def errors(tmp_path, y, gt, shapes):
    """AbsRel of each oracle on one image, whose segments have these masks at twice its size."""
    work = WorkDir(tmp_path)
    given = {"texts": [["a 0"]], "scenes": ["a"], "size": SIZE}
    images(work, "void", 1, "test", relative=y.reshape(1, -1), metric=gt.reshape(1, -1), **given)
    large = [np.kron(shape, np.ones((2, 2))) > 0 for shape in shapes]
    area = np.array([shape.mean() for shape in shapes])
    flags, width, height = np.ones(len(shapes), bool), 2 * SIZE[1], 2 * SIZE[0]
    row = Segments(
        ["thing"] * len(shapes), area, np.ones(len(shapes), np.float32), flags, None, width, height,
        mask=masks.encode(large),
    )  # fmt: skip
    table = work.table("void", "segments/own")
    table.bind(Description(stage="detect", schema="segments", inputs=["samples"]))
    content = to_table(["void/test/000000"], [row])
    table.commit(0, content, Made(ok=1, failed=0, skipped=0, split="test", fingerprint="made"))
    methods = {f.__name__: by_regions("segments/own", f) for f in (fitted, rescaled)}
    part = TestPart(work, "void", 0, "depth/files")
    rows = measure([part], methods, Rules(whole, 1e-3, 100.0)).to_pylist()
    assert [row["status"] for row in rows] == ["ok", "ok"]
    return {row["method"]: row["abs_rel"] for row in rows}


def test_a_region_with_its_own_scale_and_shift_is_exact(tmp_path):
    y = np.random.default_rng(0).uniform(1, 9, SIZE)
    gt = np.where(LEFT, 1 / (0.05 * y + 0.1), 1 / (0.3 * y + 0.02))
    # One segment lies within another: each pixel belongs to the smaller one.
    found = errors(tmp_path, y, gt, [ALL, LEFT & ALL])
    assert found["fitted"] < 2e-3  # float16
    assert found["rescaled"] > 0.05


def test_a_region_with_its_own_factor_is_exact_by_rescaling(tmp_path):
    """y tells nothing, so that the image's fit is one depth; 2 m and 6 m remain."""
    y = np.tile(np.array([[1.0, 2.0], [2.0, 1.0]]), (6, 8))
    gt = np.where(LEFT, 2.0, 6.0) * np.ones(SIZE)
    found = errors(tmp_path, y, gt, [LEFT & ALL])
    assert found == pytest.approx({"fitted": 0, "rescaled": 0}, abs=2e-3)


def test_no_pixel_is_fitted_to_its_own_depth(tmp_path):
    """Every second pixel is 2 m, the others 4 m: each half predicts the other, by its constant."""
    y = np.random.default_rng(1).uniform(1, 9, SIZE)
    gt = np.where(np.arange(16)[None] % 2, 4.0, 2.0) * np.ones(SIZE)
    found = errors(tmp_path, y, gt, [])
    assert found["fitted"] == pytest.approx((abs(4 - 2) / 2 + abs(2 - 4) / 4) / 2, rel=1e-3)


def test_halves_cover_each_region_twice_and_small_ones_never():
    region = np.array([0] * 40 + [1] * 31 + [2] * 33)
    np.random.default_rng(0).shuffle(region)
    pairs = halves(region)
    assert len(pairs) == 4
    for on, at in pairs:
        assert not set(on) & set(at)
        assert len(set(region[on]) | set(region[at])) == 1
    assert sorted(np.concatenate([at for _, at in pairs])) == sorted(np.flatnonzero(region != 1))
