"""Heads that read objects: a set in any order and of any size, none included."""

import numpy as np
import pytest
import torch

from rsa_data.heads.checkpoint import build_network
from rsa_data.heads.inputs.objects import NUMBERS, Objects, numbers
from rsa_data.registry import HEADS

DIM = 5 + len(NUMBERS)
SETS = [name for name in HEADS if "object" in name and not name.startswith(("text", "image"))]


@pytest.fixture
def images() -> Objects:
    """Three images: two objects, none, three."""
    rng = np.random.default_rng(0)
    share, center = rng.uniform(0.01, 0.5, 5), rng.uniform(size=(5, 2))
    center[3] = np.nan
    about = numbers(share, center, np.array([1, 0, 1, 1, 0], bool))
    names = rng.normal(size=(4, 5)).astype(np.float32)
    return Objects(
        names, np.array([0, 1, 2, 0, 3]), about, np.array([0, 2, 2, 5]), np.ones(3, bool)
    )


def outputs(name: str, rows: np.ndarray) -> torch.Tensor:
    torch.manual_seed(0)
    network = build_network({"name": name, "object_dim": DIM}, DIM).eval()
    return torch.stack(network(torch.from_numpy(rows)), 1)


@pytest.mark.parametrize("name", SETS)
def test_neither_order_nor_padding_matters(name, images):
    rows = images.rows(np.arange(3), np.zeros(3))
    assert rows.shape == (3, 3 * DIM)
    whole = outputs(name, rows)
    assert whole.isfinite().all() and (whole > 0).all()
    other = rows.reshape(3, 3, DIM)[:, [2, 0, 1]].reshape(3, -1)
    torch.testing.assert_close(outputs(name, other), whole)
    alone = [outputs(name, images.rows(np.array([i]), np.zeros(1)))[0] for i in range(3)]
    torch.testing.assert_close(torch.stack(alone), whole)


def test_what_a_head_does_not_read_does_not_move_it(images):
    rows = images.rows(np.arange(3), np.zeros(3)).reshape(3, 3, DIM)
    moved, resized = rows.copy(), rows.copy()
    moved[:2, :2, 5 + 3 : 5 + 5] += 0.2
    resized[:2, :2, 5 + 1] *= 0.5
    for name, blind in (
        ("objects", ()),
        ("objects-without-places", (moved,)),
        ("object-names", (moved, resized)),
    ):
        plain = outputs(name, rows.reshape(3, -1))
        for other in (moved, resized):
            same = torch.equal(outputs(name, other.reshape(3, -1)), plain)
            assert same == any(other is b for b in blind)


def test_a_part_keeps_the_names_that_it_uses(images):
    last = images.take(np.array([2]))
    assert len(last.names) == 3 and last.width == DIM
    both = images.take(np.array([0, 1])).joined([last])
    np.testing.assert_array_equal(
        both.rows(np.arange(3), np.zeros(3)), images.rows(np.arange(3), np.zeros(3))
    )
