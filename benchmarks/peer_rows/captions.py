"""Captions from segments: the same occupancy captions, with swap, delete and a token budget."""

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from rsa_data.store.tables import WorkDir

from .ways import Given, Row, Run, Way, ours, peer, stage

VARIANTS = 10


def row(given: Given) -> Row:
    """`rsa-data captions` against a pandas loop and `datasets.map`, from Parquet to Parquet."""
    work = given.folder / "captions"
    release = given.folder / "release-train"
    archive = given.shared / "rsa_release" / ("nyu-test" if given.small else "nyu-train")
    if not release.is_dir():
        import tarfile

        with tarfile.open(archive.with_suffix(".tar.xz")) as opened:
            opened.extractall(release, filter="data")
    text = next(release.rglob("seg_txt_panoptic")).parent
    split = "test" if given.small else "train"
    common = ("--dataset", "nyuv2", "--split", split, "--segments", f"rsa-release:{text}")
    ours(given, work, "detect", *common)
    table = WorkDir(str(work)).table("nyuv2", "segments/rsa-release")
    rows = pa.concat_tables([table.read(number) for number in table.parts()])
    sources = [Path(table.store.location) / table.path / table.receipt(n).file
               for n in table.parts()]  # fmt: skip
    captions = int(pa.compute.sum(pa.compute.equal(rows["status"], "ok")).as_py()) * VARIANTS

    def read() -> pa.Table:
        made = WorkDir(str(work)).table("nyuv2", "captions/occupancy")
        names = ["sample_id", "variant", "text", "n_kept"]
        return pa.concat_tables([made.read(number, names) for number in made.parts()])

    def own() -> Run:
        how = ("--variants", VARIANTS, "--delete", 0.2, "--start-over")
        words = ("captions", *common, *how)
        return stage(given, work, "captions/occupancy", "nyuv2", read, *words)

    def theirs(way: str, name: str) -> Way:
        words = {"way": way, "files": [*map(str, sources)], "variants": VARIANTS}
        there = lambda path: pa.parquet.read_table(path)  # noqa: E731
        # Words and tokens are this project's, so that the captions compare.
        python = sys.executable
        return Way(name, lambda: peer(given, "captions", python=python, read=there, **words))

    ways = (theirs("pandas", "pandas, a loop"), theirs("datasets", "datasets.map"))
    note = (
        "Both sides write each image's objects largest first, 9 more with 20% of the objects left "
        "out and the rest shuffled, cut to CLIP's 77 tokens, and Parquet at the end; draws differ. "
        "Plain captions that are not equal differ in a last digit, where 100 times the area is "
        "half-way between two in float64 and the area itself is not."
    )
    return Row(
        "Captions from segments", captions, "captions", (*ways, Way("rsa-data", own, ours=True)),
        agreement, note,
    )  # fmt: skip


def agreement(found: Any) -> dict[str, str]:
    """Plain captions that are the first one's, and objects kept in the others on average."""

    def plain(table: pa.Table) -> Counter[tuple[str, str]]:
        first = table.filter(pa.compute.equal(table["variant"], 0))
        return Counter(zip(first["sample_id"].to_pylist(), first["text"].to_pylist(), strict=True))

    wanted = plain(next(iter(found.values())))
    return {
        name: f"{(plain(table) & wanted).total():,} of {wanted.total():,} plain captions equal, "
        f"{np.mean(table['n_kept'].to_numpy()):.2f} objects a caption"
        for name, table in found.items()
    }
