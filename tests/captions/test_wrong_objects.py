"""Objects that are added to robustness captions: how large they are and where they lie."""

import math
import re

import numpy as np
import pytest
import scipy.stats
from made_segments import objects, samples, segments

from rsa_data.captions import write
from rsa_data.common import options as options_of

# A plain caption and four with one object of a street each, for 250 images of one small lamp.
IMAGES = {str(i): objects(("lamp", 0.0001, (10.0, 10.0))) for i in range(250)}
OPTIONS = {"variants": 5, "insert": 1, "delete": 0.0, "max_tokens": 0, "digits": 3}


@pytest.fixture(scope="module")
def added():
    """style -> what the pattern finds of each added object, captions in the same order."""
    table = segments(IMAGES, width=640, height=480)
    patterns = {
        "located": r"(?:an? )?([a-z -]+) located at \((\d+),(\d+)\) occupying ([\d.]+)%",
        "grid": r"(?:an? )?([a-z -]+) located in the ([a-z ]+?) occupying ([\d.]+)%",
    }
    found = {}
    for style, pattern in patterns.items():
        made = options_of.call(write.build, style=style, **OPTIONS)(table, samples(table))
        told = [re.findall(pattern, text) for text in made["text"].to_pylist()]
        assert [len(t) for t in told] == [1, 2, 2, 2, 2] * 250
        found[style] = [next(o for o in t if "lamp" not in o[0]) for t in told if len(t) == 2]
    return found


def test_their_shares_are_log_uniform_from_a_cup_to_a_cupboard(added):
    logs = np.log([float(o[-1]) / 100 for o in added["located"]])
    low, high = math.log(0.002), math.log(0.2)
    assert scipy.stats.kstest(logs, scipy.stats.uniform(low, high - low).cdf).pvalue > 1e-3


def test_they_lie_anywhere_in_the_image(added):
    for axis, side in ((1, 640), (2, 480)):
        at = (np.array([int(o[axis]) for o in added["located"]]) + 0.5) / side
        assert scipy.stats.kstest(at, "uniform").pvalue > 1e-3
    x, y = (np.array([int(o[axis]) for o in added["located"]]) for axis in (1, 2))
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.1


def test_the_cell_is_the_one_that_the_center_lies_in(added):
    rows, columns = ("top", "", "bottom"), ("left", "", "right")
    for located, grid in zip(added["located"], added["grid"], strict=True):
        assert located[0] == grid[0]
        x, y = int(located[1]), int(located[2])
        if x in (213, 426):  # a third ends inside these pixels
            continue
        cell = f"{rows[3 * y // 480]} {columns[3 * x // 640]}".strip() or "center"
        assert grid[1] == cell
