"""Export: captions and features of a work dir as a dataset that Hugging Face `datasets` opens."""

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..common.errors import RsaDataError, UsageError
from ..runner import jobs
from ..store import schemas
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


def export(
    work: WorkDir,
    *,
    out: Path,
    format: Literal["hf"] = "hf",
    datasets: tuple[str, ...] = (),
    embeddings: str | None = None,
) -> dict[str, int]:
    """Writes captions with their features, one row a caption, and a dataset card.

    Parameters
    ----------
    out : folder to write; it must not be there yet.
    format : hf is what Hugging Face `datasets` opens: Parquet with list columns, one configuration
        a dataset.
    datasets : which datasets of the work dir; all that have such features by default.
    embeddings : which features, as STYLE/ENCODER, where there are several.

    Returns the rows of each configuration and split, by `DATASET/SPLIT`. Raises UsageError when
    the folder is there already, RsaDataError when there is nothing to export or a dataset is
    not finished.
    """
    if out.exists():
        raise UsageError(f"--out {out}: expected a folder that is not there yet")
    names = list(datasets) or [n for n in work.datasets() if _has(work, n, embeddings)]
    if not names:
        raise RsaDataError(
            f"{work.store.location}: no dataset with embeddings"
            f"{f'/{embeddings}' if embeddings else ''}. Make them first: rsa-data embed"
        )
    chosen = {
        name: work.table(
            name, jobs.choose(work, name, "embeddings", embeddings, "--embeddings STYLE/ENCODER")
        )
        for name in names
    }
    for table in chosen.values():
        if missing := table.missing():
            raise RsaDataError(
                f"{table}: {len(missing)} of {len(missing) + len(table.parts())} parts are not "
                "done, and only whole datasets are exported. Run `rsa-data embed`, or leave this "
                "dataset out: --datasets NAME"
            )
    begun = {name: _state(table) for name, table in chosen.items()}
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            dir=out.parent, prefix=f".{out.name}.", ignore_cleanup_errors=True
        ) as folder:
            unfinished = Path(folder) / out.name
            counts = _write(work, chosen, unfinished)
            for name, table in chosen.items():
                if _state(table) != begun[name]:
                    raise RsaDataError(
                        f"{table}: was changed while it was exported. Run the same command again"
                    )
            unfinished.rename(out)
            out.chmod(0o755)
    except OSError as error:
        raise RsaDataError(f"--out {out}: cannot be written: {error.strerror or error}") from error
    return counts


def _state(table: Table) -> tuple[Any, list[str]]:
    """What an export is made from: the description and the parts."""
    numbers = table.parts()
    return table.description(), [receipt.sha256 for receipt in table.receipts(numbers)]


def _write(work: WorkDir, chosen: dict[str, Table], place: Path) -> dict[str, int]:
    """Writes the dataset below `place`; gives its rows by DATASET/SPLIT."""
    counts: dict[str, int] = {}
    for name, table in chosen.items():
        for number in table.parts():
            rows = _rows(work, table, number)
            split = work.table(name, "samples").receipt(number).split
            file = place / name / f"{split}-{number:05d}.parquet"
            file.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(rows, file, row_group_size=20_000, compression="zstd")
            key = f"{name}/{split}"
            counts[key] = counts.get(key, 0) + len(rows)
    if not counts:
        raise RsaDataError(f"{', '.join(map(str, chosen.values()))}: no part is done yet")
    (place / "README.md").write_text(_card(chosen, counts), "utf-8")
    return counts


def _has(work: WorkDir, dataset: str, embeddings: str | None) -> bool:
    prefix = f"embeddings/{embeddings}" if embeddings else "embeddings/"
    return any(name.startswith(prefix) for name in work.tables(dataset))


def _rows(work: WorkDir, table: Table, number: int) -> pa.Table:
    """One part: a row a caption (or an image), its feature as a list."""
    features = table.read(number)
    samples = work.table(table.dataset, "samples").read(number, ["sample_id", "scene", "image"])
    style = table.name.split("/")[1]
    if style == "images":
        features = features.filter(pc.equal(features["status"], "ok"))
        rows = features.select(["sample_id"])
        places = pa.array(range(len(features)))
    else:
        captions = work.table(table.dataset, f"captions/{style}").read(number)
        rows = captions.select(["sample_id", "variant", "text"])
        places = pc.index_in(captions["text_id"], features["text_id"].combine_chunks())
        if places.null_count:
            raise RsaDataError(
                f"{table} part {number}: captions without a feature: they were made again since. "
                "Run `rsa-data embed` again"
            )
    whole = samples.take(pc.index_in(rows["sample_id"], samples["sample_id"].combine_chunks()))
    dim = int(features.schema.field("embedding").metadata[b"shape"])
    values = schemas.embedding_array(features)[pc.cast(places, pa.int64()).to_numpy()]
    rows = rows.append_column("scene", whole["scene"]).append_column("image", whole["image"])
    lists = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), dim)
    return rows.append_column("embedding", lists)


def _card(chosen: dict[str, Table], counts: dict[str, int]) -> str:
    """README.md: what Hugging Face reads (YAML at its head), then what people read."""
    head = ["---", "license: other", "task_categories:", "- depth-estimation", "configs:"]
    for name in chosen:
        head += [f"- config_name: {name}", "  data_files:"]
        for split in _splits(name, counts):
            head += [f"  - split: {split}", f"    path: {name}/{split}-*.parquet"]
    first = next(iter(chosen))
    body = [
        "# Captions and their features",
        "",
        "Descriptions of images and what a frozen encoder makes of them, written by rsa-data. "
        "`sample_id` is DATASET/SPLIT/KEY; images and depth are not part of this dataset.",
        "",
        "    from datasets import load_dataset",
        f'    rows = load_dataset("this/dataset", "{first}", split="{_splits(first, counts)[0]}")',
        "",
        *_table(
            ("configuration", "split", "rows"), ((*k.split("/"), n) for k, n in counts.items())
        ),
        "",
        *_table(("configuration", "made of", "terms"), ((n, *_source(n)) for n in chosen)),
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


def _source(name: str) -> tuple[str, str]:
    if name.startswith("synthetic"):
        return "scenes rendered by rsa-data", "none"
    return _SOURCES.get(name, ("a dataset of the exporter's own", "the exporter says"))


def _made(name: str, table: Table) -> tuple[str, ...]:
    description = table.description()
    _, style, encoder = table.name.split("/")
    options = ", ".join(f"{k}={v}" for k, v in description.options.items() if k != "encoder")
    files = ", ".join(f"{file}: {sha}" for file, sha in description.files.items())
    return name, style, encoder, options, files


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(map(str, line)) + " |" for line in lines]
