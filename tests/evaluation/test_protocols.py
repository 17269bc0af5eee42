"""Crops and ranges against the lines of the codebases they are named after."""

from dataclasses import replace

import numpy as np
import pytest

from rsa_data import depth_errors
from rsa_data.common.errors import RowError, RsaDataError, UsageError
from rsa_data.datasets.dataset import Dataset
from rsa_data.evaluation import protocols

ANY = Dataset("mine", lambda root, split: None, lambda path: None, min_depth=0.3, max_depth=20.0)


def bts_kitti(height, width):
    """BTS eval_with_pngs.py / bts_test online: the KB crop, then Garg's of the cropped size."""
    top, left = height - 352, int((width - 1216) / 2)
    mask = np.zeros((352, 1216))
    mask[
        int(0.40810811 * 352) : int(0.99189189 * 352),
        int(0.03594771 * 1216) : int(0.96405229 * 1216),
    ] = 1
    whole = np.zeros((height, width))
    whole[top : top + 352, left : left + 1216] = mask
    return whole.astype(bool)


def monodepth2_kitti(height, width):
    """Monodepth2 evaluate_depth.py: Garg on the full ground truth."""
    crop = np.array(
        [0.40810811 * height, 0.99189189 * height, 0.03594771 * width, 0.96405229 * width]
    ).astype(np.int32)
    mask = np.zeros((height, width))
    mask[crop[0] : crop[1], crop[2] : crop[3]] = 1
    return mask.astype(bool)


@pytest.mark.parametrize("size", [(375, 1242), (370, 1226), (376, 1241), (352, 1216)])
def test_kitti(size):
    for name in ("rsa", "bts", "depth-anything"):
        np.testing.assert_array_equal(
            protocols.rules(name, ANY, "kitti").region(*size), bts_kitti(*size)
        )
    own = protocols.rules("monodepth2", ANY, "kitti")
    np.testing.assert_array_equal(own.region(*size), monodepth2_kitti(*size))


def test_nyu():
    assert protocols.rules("rsa", ANY, "nyuv2").region(480, 640).all()
    for name in ("bts", "monodepth2", "depth-anything"):
        region = protocols.rules(name, ANY, "nyuv2").region(480, 640)
        assert region.sum() == (471 - 45) * (601 - 41) == region[45:471, 41:601].sum()


def test_ranges():
    found = {
        (p, kind): (r.min_depth, r.max_depth, r.median_scaled)
        for p in protocols.PROTOCOLS
        for kind in ("nyuv2", "kitti", "void", "sunrgbd", "folder")
        for r in [protocols.rules(p, ANY, kind)]
    }
    plain, own = False, (0.3, 20.0)
    expected = {
        ("rsa", "void"): (0.2, 5.0, plain),
        ("bts", "void"): (0.2, 5.0, plain),
        ("depth-anything", "void"): (0.2, 5.0, plain),
        ("depth-anything", "sunrgbd"): (1e-3, 8.0, plain),
        ("monodepth2", "void"): (*own, True),
        ("monodepth2", "sunrgbd"): (*own, True),
        ("rsa", "sunrgbd"): (*own, plain),
        ("bts", "sunrgbd"): (*own, plain),
    }
    for p in protocols.PROTOCOLS:
        scaled = p == "monodepth2"
        expected[p, "nyuv2"] = (1e-3, 10.0, scaled)
        expected[p, "kitti"] = (1e-3, 80.0, scaled)
        expected[p, "folder"] = (*own, scaled)
    assert found == expected


@pytest.mark.parametrize(
    ("protocol", "kind", "size"),
    [("bts", "nyuv2", (240, 320)), ("rsa", "kitti", (200, 600))],
)
def test_a_crop_on_another_size_is_refused(protocol, kind, size):
    with pytest.raises(RowError, match=f"found {size[1]}x{size[0]}"):
        protocols.rules(protocol, replace(ANY), kind).region(*size)


def test_an_unknown_protocol_names_the_nearest():
    with pytest.raises(UsageError, match="Did you mean 'monodepth2'"):
        protocols.rules("monodepth", ANY, "nyuv2")


@pytest.mark.parametrize("size", [(530, 730), (427, 561), (531, 681), (441, 591), (240, 320)])
def test_sun_rgbd_as_depth_anything_slices_it(size):
    """Depth Anything metric_depth, SUN RGB-D: eval_mask[45:471, 41:601] = 1 at every size."""
    mask = np.zeros(size, bool)
    mask[45:471, 41:601] = True
    rule = protocols.rules("depth-anything", ANY, "sunrgbd")
    np.testing.assert_array_equal(rule.region(*size), mask)
    assert (rule.min_depth, rule.max_depth) == (1e-3, 8.0)


def test_ddad_as_depth_anything_cuts_it():
    """Garg's fractions of the whole map, no KB crop."""
    rule = protocols.rules("depth-anything", ANY, "ddad")
    np.testing.assert_array_equal(rule.region(1216, 1936), monodepth2_kitti(1216, 1936))


def test_depth_errors_under_a_protocol():
    gt = np.full((480, 640), 2.0)
    pred = np.full((480, 640), 2.2)
    pred[:45] = 9.0  # outside the crop of Eigen
    assert depth_errors(gt, pred, protocol="bts", dataset="nyuv2")["abs_rel"] == pytest.approx(0.1)
    whole = depth_errors(gt, pred, protocol="rsa", dataset="nyuv2")["abs_rel"]
    assert whole == pytest.approx((0.1 * 435 + 3.5 * 45) / 480)
    scaled = depth_errors(gt, pred, protocol="monodepth2", dataset="nyuv2")
    assert scaled["abs_rel"] == pytest.approx(0, abs=1e-12)
    near = depth_errors(gt, pred, protocol="rsa", dataset="nyuv2", max_depth=4.0)["abs_rel"]
    assert near == pytest.approx((0.1 * 435 + 1.0 * 45) / 480)
    with pytest.raises(UsageError, match="protocol and dataset together"):
        depth_errors(gt, pred, protocol="rsa")
    with pytest.raises(RsaDataError, match="expected min_depth and max_depth, or protocol"):
        depth_errors(gt, pred)
