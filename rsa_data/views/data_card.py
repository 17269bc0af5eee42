"""The data card of an export: what it holds, what it was made of, and under which terms."""

from collections.abc import Iterable, Sequence
from typing import Any

from ..datasets import labels
from ..store.tables import Table, WorkDir

# Where images come from and under which terms; data/README.md says more.
_SOURCES = {
    "nyuv2": ("NYU Depth v2, https://cs.nyu.edu/~silberman/datasets/", "academic use"),
    "nyuv2-labeled": ("NYU Depth v2, https://cs.nyu.edu/~silberman/datasets/", "academic use"),
    "kitti": ("KITTI, https://www.cvlibs.net/datasets/kitti/", "CC BY-NC-SA 3.0"),
    "void": ("VOID, https://github.com/alexklwong/void-dataset", "see there"),
    "7scenes": ("7-Scenes, Microsoft Research", "non-commercial use"),
    "sunrgbd": ("SUN RGB-D, https://rgbd.cs.princeton.edu", "academic use"),
    "sun3d": ("SUN3D, https://sun3d.cs.princeton.edu", "see there"),
    "ddad": ("DDAD, https://github.com/TRI-ML/DDAD", "CC BY-NC-SA 4.0"),
}


def card(work: WorkDir, chosen: dict[str, Table], counts: dict[str, int], format: str) -> str:
    """README.md: what Hugging Face reads (YAML at its head), then what people read.

    chosen : the embeddings table of each dataset. counts : rows by DATASET/SPLIT.
    """
    suffix = "tar" if format == "webdataset" else "parquet"
    head = ["---", "license: other", "task_categories:", "- depth-estimation", "configs:"]
    for name in chosen:
        head += [f"- config_name: {name}", "  data_files:"]
        for split in _splits(name, counts):
            head += [f"  - split: {split}", f"    path: {name}/{split}-*.{suffix}"]
    first = next(iter(chosen))
    body = [
        "# Captions and their features",
        "",
        "Descriptions of images and what a frozen encoder makes of them, written by rsa-data. "
        "`sample_id` is DATASET/SPLIT/KEY. `embedding` is what the encoder gives; `fit_scale` and "
        "`fit_shift`, where they are there, are each image's own least squares of 1/metres on the "
        "relative depth, `relative` and `metric` (m) its pixels. Pictures are there only if they "
        "were asked for, under the terms of their dataset.",
        "",
        "    from datasets import load_dataset",
        f'    rows = load_dataset("this/dataset", "{first}", split="{_splits(first, counts)[0]}")',
        "",
        *_table(
            ("configuration", "split", "rows"), ((*k.split("/"), n) for k, n in counts.items())
        ),
        "",
        *_table(("configuration", "made of", "terms"), ((n, *_source(work, n)) for n in chosen)),
        "",
        *_table(
            ("configuration", "captions", "encoder", "options", "files (sha256)"),
            (_made(name, table) for name, table in chosen.items()),
        ),
        "",
    ]
    return "\n".join([*head, "---", "", *body])


def _splits(name: str, counts: dict[str, int]) -> list[str]:
    return [key.split("/")[1] for key in counts if key.split("/")[0] == name]


def _source(work: WorkDir, name: str) -> tuple[str, str]:
    if labels.is_synthetic(work, name):
        return "scenes rendered by rsa-data", "none"
    kind = work.table(name, "samples").description().options.get("dataset", name)
    return _SOURCES.get(kind, ("a dataset of the exporter's own", "the exporter says"))


def _made(name: str, table: Table) -> tuple[str, ...]:
    description = table.description()
    _, style, encoder = table.name.split("/")
    options = ", ".join(f"{k}={v}" for k, v in description.options.items() if k != "encoder")
    files = ", ".join(f"{file}: {sha}" for file, sha in description.files.items())
    return name, style, encoder, options, files


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(map(str, line)) + " |" for line in lines]
