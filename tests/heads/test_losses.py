"""Losses of training against their published formulas."""

import numpy as np
import pytest
import torch

from rsa_data.heads.train import losses

FACTOR = torch.tensor([[0.5], [1.0], [3.0]])  # of predicted to true depth, the same at all pixels
TRUE = torch.tensor([[0.8, 2.0, 4.0, 9.0]]).repeat(3, 1)


def test_silog_of_a_constant_factor_is_what_its_weight_leaves():
    # BTS (Lee et al. 2019), silog_loss with variance_focus 0.85: 10 sqrt(mean d^2 - .85 mean(d)^2),
    # so that a factor f costs 10 sqrt(0.15) |ln f|.
    found = losses.SILOG.of(TRUE * FACTOR, TRUE)
    expected = 10 * np.sqrt(0.15) * np.abs(np.log(FACTOR[:, 0].numpy()))
    assert found.tolist() == pytest.approx(expected.tolist(), abs=2e-3)  # the root has a floor


def test_silog_of_any_errors():
    rng = np.random.default_rng(0)
    d = rng.normal(0, 0.4, (5, 200))
    found = losses.SILOG.of(torch.tensor(np.exp(d)), torch.ones(5, 200, dtype=torch.float64))
    expected = 10 * np.sqrt(d.var(1) + 0.15 * d.mean(1) ** 2)
    assert found.numpy() == pytest.approx(expected, rel=1e-9)


def test_other_losses_of_depth():
    predicted, true = torch.tensor([[1.5, 2.0, 7.0]]), torch.tensor([[1.0, 3.0, 4.0]])
    assert losses.L1.of(predicted, true).tolist() == pytest.approx([(0.5 + 1 + 3) / 3])
    # Huber 1964 with delta 1: e^2 / 2 up to 1, |e| - 1/2 beyond.
    assert losses.HUBER.of(predicted, true).tolist() == pytest.approx([(0.125 + 0.5 + 2.5) / 3])
    logs = np.log([1.5, 1.5, 7 / 4])
    assert losses.LOG_L1.of(predicted, true).tolist() == pytest.approx([logs.mean()])
    assert [x.in_metres for x in (losses.L1, losses.HUBER, losses.LOG_L1, losses.SILOG)] == [
        True, True, False, False,
    ]  # fmt: skip


def test_depth_goes_on_along_its_tangent_beyond_the_farthest():
    far = torch.tensor([[10.0]])
    inverse = torch.tensor([[2.0, 0.1, 0.0, -0.3]], requires_grad=True)
    found = losses.depth(inverse, far)
    # 1 / x up to x = 1/10; from there 10 - 100 (x - 1/10).
    assert found.tolist()[0] == pytest.approx([0.5, 10, 20, 50])
    found.sum().backward()
    assert inverse.grad.tolist()[0][2:] == pytest.approx([-100, -100])


def test_the_fit_counts_where_a_head_can_reach_it():
    scale, shift = torch.tensor([2.0, 2.0, 2.0]), torch.tensor([0.5, 0.5, 0.5])
    fit = torch.tensor([[1.0, 1.0], [4.0, -0.1], [-1.0, 0.0]])
    assert losses.to_fit(scale, shift, fit).tolist() == pytest.approx([2 * np.log(2), np.log(2), 0])
