"""What verify says when models come out otherwise: tolerances, maps, segments that flip."""

import numpy as np
import pyarrow as pa
import pytest
import rooms

from rsa_data.runner import recompute
from rsa_data.store import schemas


def features(values: list[list[float]]) -> pa.Table:
    return schemas.from_columns(
        "embeddings",
        {
            "text_id": [bytes([k] * 16) for k in range(len(values))],
            "embedding": schemas.embedding_column(np.array(values, np.float32)),
            "n_tokens": [3] * len(values),
            "truncated": [False] * len(values),
        },
    )


def test_features_differ_by_a_share_of_their_norm():
    one, two = features([[3, 4], [30, 40]]), features([[3, 4.005], [30, 40.005]])
    wrong, most = recompute.compare(one, two, 2e-3)
    assert not wrong and most == pytest.approx(1e-3, rel=1e-3)
    assert recompute.compare(one, two, 5e-4)[0] == [
        "column embedding differs by up to 0.001 of a row's norm"
    ]


@pytest.mark.parametrize("again", [[1.0, 2.002], [1.0, np.nan]])
def test_depth_is_compared_as_numbers(again):
    def depth(values: list[float]) -> pa.Table:
        row = dict.fromkeys(schemas.schema("depth").names)
        row |= {"sample_id": "a", "status": "ok", "relative": np.array(values, "<f2").tobytes()}
        return pa.Table.from_pylist([row], schemas.schema("depth"))

    wrong, most = recompute.compare(depth([1.0, 2.0]), depth(again), 2e-3)
    assert (not wrong and 0 < most < 1e-3) if np.isfinite(again).all() else "inf" in wrong[0]


def test_a_segment_that_comes_or_goes_is_told_by_its_row():
    rows = rooms.segment_rows(["a", "b", "c"])
    gone = rows.to_pylist()
    for column in ("label", "score", "area", "is_thing"):
        gone[2][column] = gone[2][column][:-1]
    gone[1]["score"] = [0.9999]
    wrong, most = recompute.compare(rows, pa.Table.from_pylist(gone, rows.schema), 2e-3)
    assert most == pytest.approx(1e-4, rel=1e-2)
    assert wrong[0] == (
        "1 of 3 rows have another content, the first is row 2 ('c') in label, score, area, is_thing"
    )
    assert "a segment whose score lies at the threshold can come or go" in wrong[1]
