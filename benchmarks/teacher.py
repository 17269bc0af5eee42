"""Teacher test: does training find scale and shift again that a released head gave?

    python benchmarks/teacher.py ../shared/data

Real CLIP RN50 features of real captions; the truth is what the released Depth Anything head says
of them, seen through y ~ 15 Beta(0.8, 2) and depth = 1 / (scale y + shift) exp(0.05 normal), 256
pixels an image, cut at 10 m (NYU) and 80 m (KITTI). Trains on the train keys from parts and prints
AbsRel on the test keys, captions seen and unseen in training apart.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from rsa_data import ScaleHead, to_metric
from rsa_data.common.options import call
from rsa_data.heads.predict.correction import refine
from rsa_data.heads.train.train_head import train_head
from rsa_data.store.tables import WorkDir

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))
from made_tables import write

DATASETS = {"nyu": ("nyuv2", 10.0), "kitti": ("kitti", 80.0)}


def examples(data: Path) -> dict[str, np.ndarray]:
    """Features, captions, y and depth of every key, with their dataset, split and scene."""
    table = pq.read_table(data / "clip_rn50/captions.parquet")
    keys = np.array(table["key"].to_pylist(), object)
    features = np.load(data / "clip_rn50/features.npy").astype(np.float32) * 10
    scale, shift = ScaleHead.load(data / "rsa_heads/da_lanscale.pt")(features)
    rng = np.random.default_rng(0)
    y = 15 * rng.beta(0.8, 2, (len(keys), 256))
    noise = np.exp(0.05 * rng.standard_normal(y.shape))
    names = np.array([key.split("/")[0] for key in keys])
    far = np.array([DATASETS[name][1] for name in names])
    depth = np.minimum(to_metric(y, scale, shift) * noise, far[:, None])
    return {
        "key": keys,
        "name": names,
        "split": np.array([key.split("/")[1] for key in keys]),
        "scene": np.array(["/".join(key.split("/")[2:-1]) for key in keys], object),
        "text": np.array(table["caption"].to_pylist(), object),
        "features": features,
        "y": y,
        "depth": depth,
        "far": far,
        "teacher": data / "rsa_heads/da_lanscale.pt",
    }


def write_tables(work: WorkDir, e: dict[str, np.ndarray]) -> None:
    for name, (dataset, _) in DATASETS.items():
        rows = np.flatnonzero((e["name"] == name) & (e["split"] == "train"))
        # float16 keeps y and depth to 5e-4; the tables hold the float16 features times 10.
        write(
            work,
            dataset,
            scenes=list(e["scene"][rows]),
            texts=[[text] for text in e["text"][rows]],
            features=dict(zip(e["text"][rows], e["features"][rows], strict=True)),
            relative=e["y"][rows],
            metric=e["depth"][rows],
        )


def abs_rel(depth: np.ndarray, scale: np.ndarray, shift: np.ndarray, e: dict) -> np.ndarray:
    predicted = np.clip(to_metric(e["y"], scale, shift), 1e-3, e["far"][:, None])
    return (np.abs(predicted - depth) / depth).mean(1)


def known_points(head: ScaleHead, e: dict) -> None:
    """AbsRel on the test keys against known points, with the text's prediction and without it.

    Without: the training set's median scale and shift of the dataset are the prior, with their
    spread over the training images.
    """
    scale, shift = head(e["features"])
    true = ScaleHead.load(e["teacher"])(e["features"])
    rng = np.random.default_rng(1)
    test = np.flatnonzero(e["split"] == "test")[::4]
    print("| known points | NYU text | NYU none | KITTI text | KITTI none |\n|---|---|---|---|---|")
    for count in (0, 1, 2, 5):
        means = []
        for name in DATASETS:
            train = (e["name"] == name) & (e["split"] == "train")
            typical = [float(np.median(t[train])) for t in true]
            spread = [float(np.std(t[train]) / m) for t, m in zip(true, typical, strict=True)]
            wide = {"scale": spread[0], "shift": spread[1], "correlation": 0.0}
            rows = test[e["name"][test] == name]
            for text in (True, False):
                pairs = []
                for row in rows:
                    at = rng.choice(256, count, replace=False)
                    start = (float(scale[row]), float(shift[row])) if text else typical
                    prior = head.description.get("prior") if text else wide
                    pairs.append(refine(*start, e["y"][row, at], e["depth"][row, at], prior))
                a, b = np.array(pairs).T
                sub = {k: e[k][rows] for k in ("y", "far")}
                means.append(abs_rel(e["depth"][rows], a, b, sub).mean())
        print(f"| {count} | " + " | ".join(f"{m:.4f}" for m in means) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--precision", default="auto")
    parser.add_argument("--head", default="mlp5")
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    e = examples(given.data)
    seen = np.isin(e["text"], e["text"][e["split"] == "train"])
    with tempfile.TemporaryDirectory() as folder:
        work = WorkDir(folder)
        write_tables(work, e)
        for control in ("none", "shuffled"):
            begun, used = time.perf_counter(), time.process_time()
            trained = call(
                train_head,
                work,
                name=control,
                control=control,
                seed=given.seed,
                precision=given.precision,
                head=given.head,
                threads=given.threads,
            )
            wall, used = time.perf_counter() - begun, time.process_time() - used
            error = abs_rel(e["depth"], *ScaleHead.load(trained.path)(e["features"]), e)
            print(f"captions {control}: {wall:.1f} s, {used:.1f} s of processor time", flush=True)
            for name in DATASETS:
                test = (e["name"] == name) & (e["split"] == "test")
                kinds = {"all": test, "seen": test & seen, "unseen": test & ~seen}
                means = [f"{k} {error[m].mean():.4f} ({m.sum()})" for k, m in kinds.items()]
                print(f"  {name}: AbsRel " + ", ".join(means), flush=True)
            if control == "none":
                known_points(ScaleHead.load(trained.path), e)


if __name__ == "__main__":
    main()
