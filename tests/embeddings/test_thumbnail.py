"""The image encoder without weights."""

import numpy as np
import torch

from rsa_data.embeddings.thumbnail import THUMBNAIL


def feature(image):
    model = THUMBNAIL.load(THUMBNAIL.files(None, None))
    with torch.inference_mode():
        found = model.module(torch.from_numpy(model.prepare(image))[None]).numpy()
    assert found.shape == (1, model.dim)
    return found[0]


def test_a_plain_colour_has_no_edges():
    found = feature(np.full((60, 90, 3), (255, 0, 51), np.uint8))
    np.testing.assert_allclose(found[:144].reshape(3, 48).T, [[1, 0, 0.2]] * 48, atol=1e-6)
    np.testing.assert_allclose(found[144:], 0, atol=1e-6)


def test_stripes_have_their_direction():
    stripes = np.zeros((96, 128, 3), np.uint8)
    stripes[:, ::8] = stripes[:, 1::8] = stripes[:, 2::8] = 255
    upright = feature(stripes)[144:].reshape(8, 12)
    assert (upright[0] > 0.1).all() and np.abs(upright[1:]).max() < 1e-6
    lying = feature(np.ascontiguousarray(stripes[:, :96].transpose(1, 0, 2)))
    assert lying[144:].reshape(8, 12)[4].min() > 0.1
