"""What a set of objects is pooled to, and what training hides of it."""

import numpy as np
import pytest
import torch

from rsa_data.heads.architectures.sets import ObjectSet
from rsa_data.heads.inputs.objects import NUMBERS, numbers


class Watched(torch.nn.Module):
    """In the place of the network an object: keeps what it is given, passes its numbers on."""

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        self.seen = seen.detach()
        return seen[..., -7:].abs()


def watched(rows: np.ndarray, train: bool, **reads: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """What a set of one-number names makes of rows (n, m, 9), and what it saw of each object."""
    torch.manual_seed(0)
    network = ObjectSet(1 + len(NUMBERS), **reads).train(train)
    network.object_net = Watched()
    out = network(torch.tensor(rows, dtype=torch.float32).flatten(1))
    return out.detach(), network.object_net.seen


def test_pools_are_the_mean_and_the_mean_by_area():
    share = np.array([0.1, 0.3, 0.0])
    about = numbers(share, np.full((3, 2), 0.25), np.array([1, 0, 1], bool))
    about[2] = 0  # no object
    rows = np.concatenate([np.ones((3, 1)), about], 1)[None]
    out, seen = watched(rows, train=False)
    values = np.abs(seen[0, :2, -7:].numpy())
    np.testing.assert_allclose(out[0, :7], values.mean(0), rtol=1e-6)
    np.testing.assert_allclose(out[0, 7:], np.average(values, 0, weights=share[:2]), rtol=1e-6)
    # Without shares all objects weigh the same.
    out, _ = watched(rows, train=False, shares=False)
    np.testing.assert_allclose(out[0, :7], out[0, 7:], rtol=1e-6)


def test_training_hides_mirrors_and_drops_as_often_as_it_says():
    n, m = 4000, 10
    about = numbers(np.full(m, 0.1), np.full((m, 2), 0.75), np.ones(m, bool))
    rows = np.repeat(np.concatenate([np.ones((m, 1)), about], 1)[None], n, 0)
    plain = watched(rows, train=False)[1][..., -7:].numpy()
    seen = watched(rows, train=True)[1][..., -7:].numpy()
    kept = seen[..., 6] != 0  # whether it is a thing, which is never hidden
    # A fraction drawn evenly between 0 and a fifth of an image's objects: a tenth of all, and
    # in the images the variance of a binomial with that fraction.
    dropped = m - kept.sum(1)
    assert dropped.mean() / m == pytest.approx(0.1, abs=0.005)
    variance = m * (0.1 - 0.2**2 / 3) + m**2 * 0.2**2 / 12
    assert dropped.var() == pytest.approx(variance, rel=0.1)
    some = kept.any(1)
    first = np.take_along_axis(seen, kept.argmax(1)[:, None, None], 1)[some, 0]
    for column, what in ((1, "shares"), (4, "places")):
        hidden = first[:, column] == 0
        assert hidden.mean() == pytest.approx(0.1, abs=0.02), what
        np.testing.assert_allclose(first[~hidden, column], plain[0, 0, column], rtol=1e-6)
        # All objects of an image are hidden together.
        per_image = ((seen[..., column] == 0) & kept).sum(1)[some]
        assert set(np.unique(per_image / kept.sum(1)[some])) == {0.0, 1.0}
    across = first[first[:, 3] != 0, 3] / plain[0, 0, 3]
    assert set(np.unique(np.round(across, 5))) == {-1.0, 1.0}
    assert (across < 0).mean() == pytest.approx(0.5, abs=0.04)
    np.testing.assert_array_equal(first[:, 6], plain[0, 0, 6])
