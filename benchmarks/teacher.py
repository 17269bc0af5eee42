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
from rsa_data.heads.training import train_head
from rsa_data.parts import Work

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
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
    }


def write_tables(work: Work, e: dict[str, np.ndarray]) -> None:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--precision", default="float32")
    parser.add_argument("--head", default="mlp5")
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    e = examples(given.data)
    seen = np.isin(e["text"], e["text"][e["split"] == "train"])
    with tempfile.TemporaryDirectory() as folder:
        work = Work(folder)
        write_tables(work, e)
        for control in ("none", "shuffled"):
            begun, used = time.perf_counter(), time.process_time()
            trained = train_head(
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


if __name__ == "__main__":
    main()
