"""depth_errors against a loop over pixels, written from the papers' definitions."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rsa_data.common.errors import RsaDataError
from rsa_data.evaluation import depth_errors as metrics


def by_pixel(gt, pred, low, high):
    """The same nine numbers, a pixel at a time, in plain Python floats."""
    pairs = []
    for g, p in zip(gt.ravel().tolist(), pred.ravel().tolist(), strict=True):
        if not low < g < high:
            continue
        p = low if math.isnan(p) else min(max(p, low), high)
        pairs.append((g, p))
    n = len(pairs)
    logs = [math.log(p) - math.log(g) for g, p in pairs]
    mean_log = sum(logs) / n
    return {
        **{f"delta{k}": sum(max(g / p, p / g) < 1.25**k for g, p in pairs) / n for k in (1, 2, 3)},
        "abs_rel": sum(abs(g - p) / g for g, p in pairs) / n,
        "sq_rel": sum((g - p) ** 2 / g for g, p in pairs) / n,
        "rmse": math.sqrt(sum((g - p) ** 2 for g, p in pairs) / n),
        "rmse_log": math.sqrt(sum(d * d for d in logs) / n),
        "log10": sum(abs(math.log10(g) - math.log10(p)) for g, p in pairs) / n,
        "silog": 100 * math.sqrt(sum((d - mean_log) ** 2 for d in logs) / n),
    }


@settings(deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(1e-3, 10.0), (1e-3, 80.0), (0.2, 5.0)]))
def test_equals_a_loop_over_pixels(seed, caps):
    rng = np.random.default_rng(seed)
    gt = rng.uniform(0, 1.3 * caps[1], (7, 9))
    gt[rng.random(gt.shape) < 0.2] = 0
    gt[0, 0] = caps[1] / 2
    pred = gt * np.exp(rng.normal(0, 0.3, gt.shape))
    pred[rng.random(gt.shape) < 0.1] = rng.choice([np.nan, np.inf, -np.inf, 0, -3, 1e9])
    found = metrics.depth_errors(gt, pred, min_depth=caps[0], max_depth=caps[1])
    assert found == pytest.approx(by_pixel(gt, pred, *caps), abs=1e-6, rel=1e-9)
    assert tuple(found) == tuple(metrics.metrics())


def test_tensors_give_the_same_as_arrays():
    gt = np.linspace(0, 12, 40).reshape(5, 8)
    pred = gt * 1.1
    caps = {"min_depth": 1e-3, "max_depth": 10.0}
    tensor = torch.tensor(pred, requires_grad=True)
    assert metrics.depth_errors(torch.tensor(gt), tensor, **caps) == metrics.depth_errors(
        gt, pred, **caps
    )


def test_the_range_is_given_by_name():
    """As np.percentile's method: two bare numbers would read as anything."""
    with pytest.raises(TypeError, match="positional"):
        metrics.depth_errors(np.ones(3), np.ones(3), 1e-3, 10.0)


def test_a_perfect_prediction():
    gt = np.array([1.0, 2.0, 4.0])
    found = metrics.depth_errors(gt, gt, min_depth=1e-3, max_depth=10)
    assert list(found.values()) == [1, 1, 1, 0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("gt", "pred", "caps", "says"),
    [
        ([0.0, 11.0], [1.0, 1.0], (1e-3, 10), "no valid pixel"),
        ([1.0, 2.0], [1.0], (1e-3, 10), "one shape"),
        ([1.0], [1.0], (0, 10), "0 < min_depth"),
    ],
    ids=["nothing valid", "shapes", "range"],
)
def test_errors_say_what_was_expected(gt, pred, caps, says):
    with pytest.raises(RsaDataError, match=says):
        metrics.depth_errors(gt, pred, min_depth=caps[0], max_depth=caps[1])
