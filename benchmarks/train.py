"""Images a second of train-head, against plain PyTorch and against the released way.

    python benchmarks/train.py [--images 24000] [--epochs 4] [--rounds 3]

- train-head, from parts on disk: mlp5, batch 256, 256 of 512 pixels an image.
- plain PyTorch doing the same from tensors in memory: torch.optim.Adam, clip_grad_norm_.
- the released way: each step runs the depth model's backbone (ViT-S/14 at 434x560) and CLIP's text
  tower (77 tokens, padded) for each image. Random weights: only the time counts.

All on the same cores; rounds alternate, so that what else runs on the machine hits all alike.
"""

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn

from rsa_data.common.options import call
from rsa_data.heads.architectures.layers import mlp, positive
from rsa_data.heads.train.train_head import train_head
from rsa_data.store.tables import WorkDir

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))
import recording
from made_tables import write

clock = time.perf_counter
DIM, PIXELS, BATCH = 1024, 256, 256
LR, END, CLIP = 1e-3, 3e-5, 1.0


def examples(count: int) -> dict[str, np.ndarray]:
    """Features of norm near 10 that lie near a 32-d surface, as texts do, and depth they tell."""
    rng = np.random.default_rng(0)
    inner = rng.normal(size=(count, 32))
    features = 3 + inner @ rng.normal(size=(32, DIM)) * 0.04 + rng.normal(size=(count, DIM)) * 0.02
    scale = 0.05 * np.exp(0.4 * np.tanh(inner[:, 0] + inner[:, 1] * inner[:, 2]))
    shift = 0.2 * np.exp(0.4 * np.tanh(inner[:, 3]))
    y = 15 * rng.beta(0.8, 2, (count, 2 * PIXELS))
    noise = np.exp(0.05 * rng.standard_normal(y.shape))
    depth = 1 / (scale[:, None] * y + shift[:, None]) * noise
    return {"features": features.astype(np.float16), "y": y.astype(np.float16), "depth": depth}


class Clock:
    """A progress bar that shows nothing and keeps the time from the first step to the last."""

    def __init__(self, title: str, total: int):
        self.images, self.begun = 0, clock()
        Clock.last = self

    def update(self, images: int) -> None:
        if not self.images:
            self.begun = clock()  # the first step warms up
        else:
            self.images += images
        self.images = self.images or 1
        self.ended = clock()

    def close(self) -> None: ...

    @property
    def rate(self) -> float:
        return self.images / (self.ended - self.begun)


def ours(
    work: WorkDir, epochs: int, precision: str, name: str, threads: int
) -> tuple[float, float]:
    """Images a second, and AbsRel on the validation images."""
    trained = call(
        train_head,
        work,
        Clock,
        name=name,
        epochs=epochs,
        batch=BATCH,
        pixels=PIXELS,
        lr=LR,
        end_lr=END,
        warmup=0.0,
        clip=CLIP,
        precision=precision,
        threads=threads,
    )
    return Clock.last.rate, trained.description["validation"]["abs_rel"]["nyuv2"]


class Plain(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.shared = mlp(DIM, 512, 512, 512, 256, 256)
        self.scale, self.shift = (mlp(256, 256, 128, 128, 64, 1) for _ in range(2))

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        x = self.shared(x)
        return positive(self.scale(x)), positive(self.shift(x))


def plain(e: dict[str, np.ndarray], held: np.ndarray, epochs: int) -> tuple[float, float]:
    """The same from tensors in memory, as one would write it."""
    torch.manual_seed(0)
    x, y, d = (torch.from_numpy(e[k]).float() for k in ("features", "y", "depth"))
    train = torch.from_numpy(np.flatnonzero(~held))
    mean, spread = x[train].mean(0), x[train].std(0).square().mean().sqrt()
    x = (x - mean) / spread
    network = Plain()
    with torch.no_grad():
        network.scale[-1].bias.fill_(math.log(0.05))
        network.shift[-1].bias.fill_(math.log(0.2))
    optimizer = torch.optim.Adam(network.parameters(), LR)
    steps, step = epochs * -(-len(train) // BATCH), 0
    unit, begun, counted = d[train].mean(), 0.0, 0
    for _ in range(epochs):
        for rows in train[torch.randperm(len(train))].split(BATCH):
            lr = END + (LR - END) * 0.5 * (1 + math.cos(math.pi * step / steps))
            optimizer.param_groups[0]["lr"] = lr
            pixels = slice(PIXELS, None) if step % 2 else slice(PIXELS)
            scale, shift = network(x[rows])
            predicted = 1 / (scale[:, None] * y[rows, pixels] + shift[:, None]).clamp_min(0.1)
            loss = (predicted - d[rows, pixels]).abs().mean() / unit
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), CLIP)
            optimizer.step()
            counted, step = counted + (len(rows) if step else 0), step + 1
            begun = begun or clock()
    rate = counted / (clock() - begun)
    with torch.no_grad():
        rows = torch.from_numpy(np.flatnonzero(held))
        scale, shift = network(x[rows])
        predicted = (1 / (scale[:, None] * y[rows] + shift[:, None])).clamp(1e-3, 10)
        error = ((predicted - d[rows]).abs() / d[rows]).mean()
    return rate, float(error)


def transformer(width: int, heads: int) -> nn.Module:
    layer = nn.TransformerEncoderLayer(
        width, heads, 4 * width, 0.0, "gelu", batch_first=True, norm_first=True
    )
    return nn.TransformerEncoder(layer, 12, enable_nested_tensor=False).eval()


def released(images: int = 4) -> float:
    """Images a second when both frozen networks run at each step; one batch of a few images."""
    tokens = (434 // 14) * (560 // 14) + 1
    vit, tower = transformer(384, 6), transformer(512, 8)
    patches = nn.Conv2d(3, 384, 14, 14)
    project = nn.Linear(512, DIM)
    network = Plain()
    optimizer = torch.optim.Adam(network.parameters(), LR)
    image, words = torch.rand(images, 3, 434, 560), torch.rand(images, 77, 512)
    y, d = torch.rand(images, 434 * 560), torch.rand(images, 434 * 560) + 1
    for _ in range(2):  # the first one warms up
        begun = clock()
        with torch.inference_mode():
            grid = patches(image).flatten(2).transpose(1, 2)
            seen = vit(torch.nn.functional.pad(grid, (0, 0, 1, 0)))
            assert seen.shape[1] == tokens
            text = project(tower(words)[:, -1])
        scale, shift = network(text.clone())
        loss = (1 / (scale[:, None] * y + shift[:, None]) - d).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        optimizer.step()
        seconds = clock() - begun
    return images / seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--images", type=int, default=24_000)
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--processor-time", action="store_true", help="on a machine not alone")
    given = parser.parse_args()
    torch.set_num_threads(given.threads)
    if given.processor_time:
        global clock
        clock = time.process_time
    e = examples(given.images)
    scenes = [f"scene {i % 100}" for i in range(given.images)]
    rates: dict[str, list[float]] = {}
    errors: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        work = WorkDir(folder)
        texts = [str(i) for i in range(given.images)]
        write(
            work,
            "nyuv2",
            scenes=scenes,
            texts=[[text] for text in texts],
            features=dict(zip(texts, e["features"], strict=True)),
            relative=e["y"],
            metric=e["depth"],
            part=2000,
        )
        # The same images as train-head holds out, so that the errors compare.
        from rsa_data.heads.train.validation_split import by_scene

        held, _ = by_scene("nyuv2", np.array(scenes, object), 0.1, False)
        for number in range(given.rounds):
            for precision in ("float32", "bfloat16"):
                name = f"train-head {precision}"
                rate, errors[name] = ours(
                    work, given.epochs, precision, f"{precision}-{number}", given.threads
                )
                rates.setdefault(name, []).append(rate)
            rate, errors["plain PyTorch"] = plain(e, held, given.epochs)
            rates.setdefault("plain PyTorch", []).append(rate)
            rates.setdefault("released way", []).append(released())
    base = float(np.median(rates["plain PyTorch"]))
    recording.table(
        "train",
        "Training a head",
        ("way", "images/s", "times plain PyTorch", "AbsRel after the run"),
        [
            (n, round(float(np.median(r)), 1), round(float(np.median(r)) / base, 2), errors.get(n))
            for n, r in rates.items()
        ],
        note=f"{given.images:,} images, "
        f"{'CPU' if given.processor_time else 'wall'} seconds of the steps alone.",
        epochs=given.epochs,
        rounds=given.rounds,
        threads=given.threads,
    )
    print("| way | images/s | times plain PyTorch | AbsRel after the run |\n|---|---|---|---|")
    for name, found in rates.items():
        rate = float(np.median(found))
        error = f"{errors[name]:.4f}" if name in errors else "-"
        print(f"| {name} | {rate:,.1f} | {rate / base:.4g} | {error} |")


if __name__ == "__main__":
    main()
