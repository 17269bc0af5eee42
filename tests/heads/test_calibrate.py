"""What a head knows of its limits, and which tables belong together."""

import numpy as np
import pytest
import torch

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads.belong import same
from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.heads.inputs.vectors import Vectors
from rsa_data.heads.predict.calibration import REFERENCES, calibrate, distance, references
from rsa_data.heads.reading import encode
from rsa_data.heads.train.examples import Examples


def test_distance_is_one_minus_the_cosine_to_the_nearest_reference():
    mean = np.array([1.0, 0.0], np.float32)
    seen = np.array([[2.0, 0.0], [1.0, 3.0]], np.float16)  # right and up of the mean
    features = np.array([[9.0, 0.0], [2.0, 1.0], [0.0, 0.0], [1.0, -4.0]])
    expected = [0, 1 - np.sqrt(0.5), 1, 1]
    np.testing.assert_allclose(distance(features, seen, mean), expected, atol=1e-6)


def test_references_are_spread_over_all_parts():
    parts = [np.full((3000, 1), i) for i in range(3)]
    found = references(parts)
    assert found.dtype == np.float16 and len(found) == REFERENCES
    assert set(found[:, 0]) == {0, 1, 2}


def constant_head(scale: float, shift: float) -> ScaleHead:
    network = build_network({"name": "linear"}, 2)
    with torch.no_grad():
        for p in network.parameters():
            p.zero_()
        network.scale_net[-1].bias.fill_(np.log(scale))
        network.shift_net[-1].bias.fill_(np.log(shift))
    about = {"format": 1, "architecture": {"name": "linear"}, "features": {"dim": 2}}
    return ScaleHead(network, about, torch.zeros(2), torch.ones(2), np.eye(2, dtype=np.float16))


def validation(fit: np.ndarray) -> Examples:
    n = len(fit)
    pixels = np.ones((n, 4), np.float16)
    return Examples(
        inputs=(Vectors(np.eye(2, dtype=np.float16), np.arange(n) % 2, np.arange(n + 1)),),
        relative=pixels,
        metric=pixels,
        fit=fit.astype(np.float32),
        share=np.ones(len(fit), np.float32),
        dataset=np.zeros(n, np.int64),
        row=np.arange(n),
    )


def test_the_prior_is_the_spread_of_the_fits_around_the_prediction():
    rng = np.random.default_rng(0)
    error = rng.multivariate_normal([0, 0], [[0.04, -0.03], [-0.03, 0.09]], 4000)
    fits = (1 + error) * [0.5, 0.2]
    fits[::50] = 1e6  # single bad fits do not count
    fits[1::100] = np.nan
    said = calibrate(constant_head(0.5, 0.2), validation(fits))
    assert said["far"] == 0
    assert said["prior"].scale == pytest.approx(0.2, rel=0.1)
    assert said["prior"].shift == pytest.approx(0.3, rel=0.1)
    assert -0.6 < said["prior"].correlation < -0.2


@pytest.mark.parametrize("way", [1, -1, 0])
def test_the_prior_to_its_last_digit(way):
    """Errors of -e and e alone: 1.4826 e, the normal's spread for that median (Rousseeuw)."""
    error = np.tile([[0.1, 0.2], [-0.1, -0.2]], (8, 1)) * [1, way]
    prior = calibrate(constant_head(0.5, 0.2), validation((1 + error) * [0.5, 0.2]))["prior"]
    # Complete correlation would make the covariance singular; no spread at all is none.
    assert prior.correlation == 0.99 * way
    assert prior.scale == pytest.approx(0.1483, abs=1e-6)
    assert prior.shift == pytest.approx(0.2965 if way else 0.01, abs=1e-6)


def test_few_fits_leave_the_prior_open():
    assert "prior" not in calibrate(constant_head(0.5, 0.2), validation(np.ones((9, 2))))


def test_what_is_not_known_goes_with_anything():
    known = {"style": "occupancy", "files": {"model": "abc"}}
    assert same("x", {"the head": {"style": None, "files": {"model": "abc"}}, "table": known})
    with pytest.raises(RsaDataError, match="style is 'counts' in the head and 'occ"):
        same("x", {"the head": {"style": "counts"}, "table": known})


def test_an_option_that_came_after_a_head_does_not_part_it_from_its_tables():
    old, new = {"options": {"encoder": "clip"}}, {"options": {"encoder": "clip", "precision": "x"}}
    assert same("x", {"the head": old, "table": new}) == old
    with pytest.raises(RsaDataError, match="options is"):
        same("x", {"the head": new, "table": old})


@pytest.mark.parametrize("features", [{"style": "images"}, {"style": "counts", "images": {}}])
def test_heads_of_image_features_do_not_take_captions(features):
    with pytest.raises(UsageError, match="not captions alone"):
        encode({**features, "encoder": "eye"}, ["a room"])
