"""The recipe rsa-release: its training step is that of the released code, to the gradient."""

from pathlib import Path

import numpy as np
import pytest
import torch
from flat import train_head
from made_tables import DEPTH, write
from safetensors.torch import load

from rsa_data.common.errors import RsaDataError
from rsa_data.heads.checkpoint import build_network
from rsa_data.heads.train.batches import images_in_an_epoch
from rsa_data.runner import pipeline_files
from rsa_data.store.tables import WorkDir

DIM, STORED = 24, 12_288
# By dataset: size of the map that y covers, and the depths (m) between which a pixel counts there.
MAPS = {
    "nyuv2": ((480, 640), 0.3, 9.0),
    "kitti": ((352, 1216), 2.0, 70.0),
    "void": ((480, 640), 0.3, 4.0),
}
# Valid pixels of an image, each a divisor of what is stored: then repeating them changes no mean.
VALID = [STORED // k for k in (1, 2, 3, 4)]


class Stopped(Exception):
    pass


class StopAfter:
    """Progress that ends the training at its n-th word: after the first step of epoch 2."""

    def __init__(self, calls: int):
        self.left = calls

    def update(self, images: int) -> None:
        self.left -= 1
        if not self.left:
            raise Stopped

    def close(self) -> None:
        pass


def images(work: WorkDir, dataset: str, n: int, split: str = "train", part: int = 0):
    """n images in tables; returns features, and y and depth of their valid pixels."""
    size, near, far = MAPS[dataset]
    rng = np.random.default_rng([n, *dataset.encode()])
    valid = [VALID[i % len(VALID)] for i in range(n)]
    y = [np.resize(rng.uniform(0.01, 1, v).astype("<f2"), STORED) for v in valid]
    metric = [np.resize(rng.uniform(near, far, v).astype("<f2"), STORED) for v in valid]
    texts = [[f"{dataset} {split} {i}"] for i in range(n)]
    features = {t[0]: rng.normal(0, 2, DIM).astype(np.float16) for t in texts}
    crop = "kb" if dataset == "kitti" else "none"
    write(
        work,
        dataset,
        scenes=[f"{split} {i}" for i in range(n)],
        texts=texts,
        features=features,
        relative=np.stack(y),
        metric=np.stack(metric),
        split=split,
        first_part=part,
        depth=DEPTH | {"crop": crop},
        n_valid=valid,
        # The map of KITTI is larger than the crop that y covers.
        covers=(375, 1242) if crop == "kb" else size,
    )
    pixels = [(a[:v], b[:v]) for a, b, v in zip(y, metric, valid, strict=True)]
    return np.stack([features[t[0]] for t in texts]), pixels


def released_gradient(network, dataset: str, features, pixels) -> torch.Tensor:
    """The gradient of a dataset's batch in train_3d.py at commit 7e88bc2, from whole maps.

    Huber with delta 1 of 1 / (scale * y + shift + 1e-8) over the valid pixels of an image, its mean
    times their share of all pixels, summed over the batch. NYU's and VOID's are divided by their
    own value, KITTI's is not. The gradients of the three add up in a step.
    """
    height, width = MAPS[dataset][0]
    y = torch.full((len(pixels), height * width), 0.5)
    true = torch.zeros(len(pixels), height * width)
    for i, (own, metric) in enumerate(pixels):
        y[i, 100 : 100 + len(own)] = torch.from_numpy(own.astype(np.float32))
        true[i, 100 : 100 + len(own)] = torch.from_numpy(metric.astype(np.float32))
    network.zero_grad()
    scale, shift = network(torch.from_numpy(features.astype(np.float32)))
    error = (1 / (scale[:, None] * y + shift[:, None] + 1e-8) - true).abs()
    huber = torch.where(error < 1, 0.5 * error**2, error - 0.5)
    far = {"nyuv2": 10.0, "kitti": 80.0, "void": 5.0}[dataset]
    counts = (true > 0.2) & (true < far)
    mean = (huber * counts).sum(1) / counts.sum(1)
    loss = (mean * counts.sum(1) / (height * width)).sum()
    (loss if dataset == "kitti" else loss / (loss.detach() + 1e-8)).backward()
    return torch.cat([p.grad.reshape(-1) for p in network.parameters()])


def test_a_step_has_the_gradient_of_the_released_code(tmp_path):
    """Adam's first moment after one step from 0 is a tenth of the gradient."""
    work = WorkDir(tmp_path)
    seen = {name: images(work, name, 8) for name in MAPS}
    for name in MAPS:
        images(work, name, 1, "val", part=1)
    recipe = pipeline_files.load(Path("rsa-release")).steps[0].options
    assert (recipe["batch"], recipe["clip"]) == (8, 1.0)
    # Such a rate leaves the weights as they were drawn.
    recipe |= {"lr": 1e-30, "end_lr": 0.0, "epochs": 2, "threads": 1}
    moments = {}
    for clip in (1.0, 0.05):
        recipe |= {"clip": clip, "name": f"clip-{clip}"}
        with pytest.raises(Stopped):
            train_head(work, lambda title, total: StopAfter(3), checkpoint_every=0, **recipe)
        file = work.store.read(f"heads/{recipe['name']}/checkpoint.safetensors")
        weights, moments[clip], *_ = load(file)["rows"]
    network = build_network({"name": "mlp5"}, DIM)
    torch.nn.utils.vector_to_parameters(weights, network.parameters())
    each = [released_gradient(network, name, *batch) for name, batch in seen.items()]
    expected = sum(each)
    # Each dataset has its part, and the second one is clipped.
    assert min(one.norm() for one in each) > 0.1 * expected.norm()
    assert 0.05 < expected.norm() < 1
    for clip, moment in moments.items():
        clipped = expected * min(1.0, clip / float(expected.norm()))
        torch.testing.assert_close(
            10 * moment, clipped, rtol=1e-5, atol=1e-5 * float(clipped.abs().max())
        )
        assert (10 * moment - clipped).norm() < 1e-5 * clipped.norm()


def test_an_epoch_of_one_batch_of_each_dataset_ends_with_the_smallest(tmp_path):
    work = WorkDir(tmp_path)
    for name, n in (("nyuv2", 7), ("kitti", 5), ("void", 16)):
        images(work, name, n)
        images(work, name, 1, "val", part=1)
    counted = []

    class Count(StopAfter):
        def update(self, images: int) -> None:
            counted.append(images)

    def bar(title: str, total: int) -> Count:
        counted.append(total)
        return Count(0)

    options = {"batch": 2, "batches": "each", "epochs": 2, "threads": 1, "head": "linear"}
    made = train_head(work, bar, **options)
    # Three steps of 2 images each; the last one of KITTI has 1.
    steps = [6, 6, 5]
    assert counted == [2 * 17, 0, *steps, *steps]
    assert images_in_an_epoch(np.array([7, 5, 16]), 2, "each") == 17
    assert made.description["options"]["batches"] == "each"
    reason = r"--batches each: expected parts of every dataset in memory at once; .* Give --memory"
    with pytest.raises(RsaDataError, match=reason):
        train_head(work, name="small", memory=1e-5, **options)


def test_shares_of_valid_pixels_must_be_known(tmp_path):
    work = WorkDir(tmp_path)
    n = 6
    y = np.ones((n, 4))
    words = {"a": np.ones(4, np.float16)}
    write(
        work, "nyuv2", scenes=list("abcdef"), texts=[["a"]] * n, features=words,
        relative=y, metric=y,
    )  # fmt: skip
    with pytest.raises(RsaDataError, match="--balance pixels: expected the size of each image"):
        train_head(work, balance="pixels", epochs=1, head="linear")
