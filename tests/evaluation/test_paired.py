"""Differences on the same images, by hand."""

import numpy as np
import pandas as pd
import pytest

from rsa_data.evaluation.paired import differences, to_csv
from rsa_data.evaluation.summary import interval


def table(dataset: str, **errors: list) -> pd.DataFrame:
    """AbsRel of four images in three scenes by method; None: it could not do this one."""
    rows = [
        {"dataset": dataset, "scene": scene, "sample_id": f"{dataset}/{i}", "method": method}
        | {"status": "ok" if value is not None else "failed", "abs_rel": value}
        for method, values in errors.items()
        for i, (scene, value) in enumerate(zip("aabc", values, strict=True))
    ]
    return pd.DataFrame(rows)


def test_each_method_less_text_by_hand():
    metrics = pd.concat(
        [
            table("d", text=[0.2, 0.4, 0.5, 0.1], image=[0.1, 0.2, 0.6, None]),
            table("e", **{"text (zero-shot)": [0.2] * 4, "median": [0.3, 0.3, 0.1, 0.1]}),
            table("f", text=[0.4] * 4, **{"text (zero-shot)": [0.2] * 4}),
            table("g", image=[0.1] * 4),
        ]
    )
    found = {(d.dataset, d.method): d for d in differences(metrics, "text", 200)}
    assert [*found] == [("d", "image"), ("e", "median"), ("f", "text (zero-shot)")]
    image = found["d", "image"]
    assert (image.against, image.images, image.scenes, image.ahead) == ("text", 3, 2, 1)
    assert image.mean == pytest.approx((-0.1 - 0.2 + 0.1) / 3)
    assert image.ratio == pytest.approx(0.9 / 1.1)
    low, high = interval(np.array([[-0.1], [-0.2], [0.1]]), np.array(["a", "a", "b"]), 200)
    assert (image.low, image.high) == (pytest.approx(low[0]), pytest.approx(high[0]))
    assert image.low < image.mean < image.high
    median = found["e", "median"]
    assert (median.against, median.ahead, median.scenes) == ("text (zero-shot)", 2, 3)
    assert median.mean == pytest.approx(0) and median.ratio == pytest.approx(1)
    assert found["f", "text (zero-shot)"].against == "text"
    lines = to_csv(list(found.values())).splitlines()
    assert lines[0] == "dataset,method,against,images,scenes,ahead,mean,ratio,low,high"
    assert lines[1].startswith("d,image,text,3,2,1,-0.0666") and len(lines) == 4
