"""Crops and ranges against the lines of the codebases they are named after."""

from dataclasses import replace

import numpy as np
import pytest

from rsa_data import depth_errors, registry
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
            protocols.protocol(name).of(ANY, "kitti").region(*size), bts_kitti(*size)
        )
    own = protocols.protocol("monodepth2").of(ANY, "kitti")
    np.testing.assert_array_equal(own.region(*size), monodepth2_kitti(*size))


def test_nyu():
    assert protocols.protocol("rsa").of(ANY, "nyuv2").region(480, 640).all()
    for name in ("bts", "monodepth2", "depth-anything"):
        region = protocols.protocol(name).of(ANY, "nyuv2").region(480, 640)
        assert region.sum() == (471 - 45) * (601 - 41) == region[45:471, 41:601].sum()


def test_ranges():
    found = {
        (p, kind): (r.min_depth, r.max_depth, r.median_scaled)
        for p in registry.PROTOCOLS
        for kind in ("nyuv2", "kitti", "void", "sunrgbd", "folder")
        for r in [protocols.protocol(p).of(ANY, kind)]
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
    for p in registry.PROTOCOLS:
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
        protocols.protocol(protocol).of(replace(ANY), kind).region(*size)


def test_an_unknown_protocol_names_the_nearest():
    with pytest.raises(UsageError, match="Did you mean 'monodepth2'"):
        protocols.protocol("monodepth").of(ANY, "nyuv2")


SUN = [(530, 730), (427, 561), (531, 681), (441, 591), (240, 320)]


@pytest.mark.parametrize("size", SUN)
def test_sun_rgbd_as_depth_anything_slices_it(size):
    """Depth Anything metric_depth, SUN RGB-D: eval_mask[45:471, 41:601] = 1 at every size."""
    mask = np.zeros(size, bool)
    mask[45:471, 41:601] = True
    rule = protocols.protocol("depth-anything").of(ANY, "sunrgbd")
    np.testing.assert_array_equal(rule.region(*size), mask)
    assert mask.sum() == (min(471, size[0]) - 45) * (min(601, size[1]) - 41)
    assert (rule.min_depth, rule.max_depth) == (1e-3, 8.0)


def test_ddad_as_depth_anything_cuts_it():
    """Garg's fractions of the whole map, no KB crop."""
    rule = protocols.protocol("depth-anything").of(ANY, "ddad")
    region = rule.region(1216, 1936)
    np.testing.assert_array_equal(region, monodepth2_kitti(1216, 1936))
    # .40810811 * 1216 = 496.26, .99189189 * 1216 = 1206.14; .03594771 * 1936 = 69.59 ...
    assert region[496:1206, 69:1866].all() and region.sum() == (1206 - 496) * (1866 - 69)
    assert (rule.min_depth, rule.max_depth) == (1e-3, 80.0)


def slices(protocol, dataset, height, width):
    """Rows and columns that count, by hand from the codebases' numbers; None: all of them."""
    if dataset == "nyuv2":
        return None if protocol == "rsa" else (45, 471, 41, 601)
    if dataset == "kitti":
        if protocol == "monodepth2":  # Garg's fractions of 375 x 1242
            return (153, 371, 44, 1197)
        # Those of 352 x 1216 (143 to 349, 43 to 1172) in the crop, which begins at (23, 13).
        return (23 + 143, 23 + 349, 13 + 43, 13 + 1172)
    if protocol == "depth-anything":
        return {"sunrgbd": (45, 471, 41, 601), "ddad": (496, 1206, 69, 1866)}.get(dataset)
    return None


SIZES = {"nyuv2": (480, 640), "kitti": (375, 1242), "sunrgbd": (530, 730), "ddad": (1216, 1936)}
CAPS = {"nyuv2": 10.0, "kitti": 80.0, "sunrgbd": 8.0, "ddad": 80.0}


@pytest.mark.parametrize("dataset", SIZES)
@pytest.mark.parametrize("protocol", registry.PROTOCOLS)
def test_sixteen_cases_as_the_published_code_computes_them(protocol, dataset):
    """eval.py of BTS and of Depth Anything, evaluate_depth.py of Monodepth2, train_3d.py of RSA.

    They share their steps: cut, (scale by the median), clip, the errors of valid pixels.
    """
    height, width = SIZES[dataset]
    cap = CAPS[dataset]
    rng = np.random.default_rng(0)
    true = rng.uniform(0, 1.2 * cap, (height, width))
    pred = true * rng.uniform(0.5, 1.6, true.shape)
    true[rng.random(true.shape) < 0.3] = 0.0
    pred[0, :3] = np.nan, np.inf, -1.0
    mask = (true > 1e-3) & (true < cap)
    if (cut := slices(protocol, dataset, height, width)) is not None:
        inside = np.zeros_like(mask)
        inside[cut[0] : cut[1], cut[2] : cut[3]] = True
        mask &= inside
    pred_valid, gt = pred[mask], true[mask]
    if protocol == "monodepth2":
        # Signs that no median can take would stand in the first row.
        pred_valid = pred_valid * np.median(gt) / np.median(pred_valid)
    pred_valid[np.isnan(pred_valid)] = 1e-3
    pred_valid[pred_valid < 1e-3] = 1e-3
    pred_valid[pred_valid > cap] = cap
    thresh = np.maximum(gt / pred_valid, pred_valid / gt)
    log = np.log(pred_valid) - np.log(gt)
    expected = {
        "delta1": (thresh < 1.25).mean(),
        "delta2": (thresh < 1.25**2).mean(),
        "delta3": (thresh < 1.25**3).mean(),
        "abs_rel": np.mean(np.abs(gt - pred_valid) / gt),
        "sq_rel": np.mean((gt - pred_valid) ** 2 / gt),
        "rmse": np.sqrt(((gt - pred_valid) ** 2).mean()),
        "rmse_log": np.sqrt((log**2).mean()),
        "log10": np.mean(np.abs(np.log10(pred_valid) - np.log10(gt))),
        "silog": np.sqrt(np.mean(log**2) - np.mean(log) ** 2) * 100,
    }
    found = depth_errors(true, pred, protocol=protocol, dataset=dataset)
    assert found == pytest.approx(expected, rel=1e-6)


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
    # A dataset whose range no protocol states has its own.
    far = depth_errors(np.full((6, 8), 70.0), np.full((6, 8), 99.0), protocol="rsa", dataset="ddad")
    assert far["abs_rel"] == pytest.approx(10 / 70)
    with pytest.raises(UsageError, match=r"unknown dataset 'ddat'\. Did you mean 'ddad'"):
        depth_errors(gt, pred, protocol="rsa", dataset="ddat")
    with pytest.raises(UsageError, match="protocol and dataset together"):
        depth_errors(gt, pred, protocol="rsa")
    with pytest.raises(RsaDataError, match="expected min_depth and max_depth, or protocol"):
        depth_errors(gt, pred)
