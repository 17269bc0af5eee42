"""How many occupancy captions a second, against a straightforward Python loop that does the same.

    python benchmarks/captions.py --release DIR_OR_ARCHIVE [--variants 10]

--release : `nyu-train.tar.xz` with the released segments, or a clone of the RSA repository or its
text folder. Both sides run on one core, get the same segments in memory, swap, delete, round, keep
within the token budget and write out one text a variant; text_id is left out on both sides, and
reported afterwards. The loop may know the tokens of each phrase that it has seen.
Times are CPU seconds of this process, so that other work on the machine does not count.
"""

import argparse
import io
import os
import sys
import tarfile
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import recording
from peer_rows.plain_loop import DELETE, writer

from rsa_data import registry
from rsa_data.captions.blocks import composer
from rsa_data.captions.caption_table import caption_table
from rsa_data.captions.compose import Recipe
from rsa_data.captions.options import Augmentation, Contents, WrongObjects
from rsa_data.common.tokenizers import clip
from rsa_data.segments.rsa_release import parse
from rsa_data.segments.segments import to_table
from rsa_data.store import schemas

DEFAULT = Path(__file__).parents[2] / "shared" / "data" / "rsa_release" / "nyu-train.tar.xz"


def read(release: Path) -> pa.Table:
    """The segments of NYU train, from the archive or from the unpacked tree."""
    found = {}
    if release.is_file():
        with tarfile.open(release) as archive:
            for member in archive:
                if "seg_txt_panoptic" in member.name and member.name.endswith(".txt"):
                    content = archive.extractfile(member)
                    assert content is not None
                    found[member.name] = parse(content.read().decode().split("\n"))
    else:
        for path in release.rglob("seg_txt_panoptic/nyu/train/**/*.txt"):
            found[path.as_posix()] = parse(path.read_text("utf-8").split("\n"))
    if not found:
        sys.exit(f"{release}: expected seg_txt_panoptic/nyu/train/**/*.txt; found none")
    names = sorted(found)
    ids = [f"nyuv2/train/{n.partition('/train/')[2].removesuffix('.txt')}" for n in names]
    return to_table(ids, [found[n] for n in names])


def loop(images: list[tuple[list[str], list[float]]], variants: int) -> list:
    """What one would write: every caption by itself. Returns rows of variant, text and counts."""
    write = writer(variants)
    return [row for labels, areas in images for row in write(labels, areas)]


def best(what: Callable[[], object], times: int) -> tuple[float, object]:
    """The shortest time of several, and the last result."""
    shortest, result = float("inf"), None
    for _ in range(times):
        result = None
        begun = time.process_time()
        result = what()
        shortest = min(shortest, time.process_time() - begun)
    return shortest, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--release", type=Path, default=DEFAULT)
    parser.add_argument("--variants", type=int, default=10)
    parser.add_argument("--repeat", type=int, default=3)
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)

    segments = read(given.release)
    blank = dict.fromkeys(schemas.schema("samples").names)
    rows = [
        {**blank, "sample_id": s, "dataset": "nyuv2", "split": "train", "scene": "-"}
        for s in segments["sample_id"].to_pylist()
    ]
    samples = schemas.from_columns("samples", {n: [r[n] for r in rows] for n in blank})
    tokenizer = clip()
    recipe = Recipe(
        wording=registry.resolve("style", registry.STYLES, "occupancy"),
        tokenizer=tokenizer,
        limit=tokenizer.max_tokens,
        augmentation=Augmentation(variants=given.variants, delete=DELETE),
        contents=Contents(),
        wrong=WrongObjects(),
    )
    write = composer(recipe)
    images = list(zip(segments["label"].to_pylist(), segments["area"].to_pylist(), strict=True))
    captions = len(images) * given.variants
    print(
        f"{len(images):,} images, {sum(len(a) for a, _ in images):,} segments, {captions:,} texts"
    )

    slow, expected = best(lambda: loop(images, given.variants), given.repeat)
    fast, made = best(lambda: write(segments, samples), given.repeat)
    assert isinstance(made, dict) and isinstance(expected, list)
    plain = [row[1] for row in expected[:: given.variants]]
    same = sum(
        a == b for a, b in zip(made["text"].to_pylist()[:: given.variants], plain, strict=True)
    )
    with_id, table = best(lambda: caption_table(made, {"style": "occupancy"}), given.repeat)
    assert isinstance(table, pa.Table)

    def parquet() -> int:
        sink = io.BytesIO()
        binary = [f.name for f in table.schema if pa.types.is_fixed_size_binary(f.type)]
        others = [n for n in table.column_names if n not in binary]
        pq.write_table(
            table,
            sink,
            row_group_size=20_000,
            compression={n: "none" if n in binary else "zstd" for n in table.column_names},
            use_dictionary=others,
            write_statistics=others,
        )
        return sink.tell()

    written, size = best(parquet, given.repeat)
    mean_loop = sum(row[2] for row in expected) / captions
    total = fast + with_id + written
    ways = {"Python loop": slow, "columns": fast, "columns, text_id": fast + with_id}
    recording.table(
        "captions",
        "Occupancy captions",
        ("way", "captions/s", "times the loop"),
        [
            (name, round(captions / took), round(slow / took, 1))
            for name, took in (ways | {"columns, text_id, Parquet (zstd)": total}).items()
        ],
        note=f"{len(images):,} images, one core, CPU seconds, the best of {given.repeat}; {same:,} "
        f"of {len(plain):,} plain captions equal to the loop's, where a half may round up.",
        variants=given.variants,
    )
    print(f"plain captions equal to the loop's: {same:,} of {len(plain):,} (a half may round up)")
    print(f"objects kept a caption: loop {mean_loop:.3f}, columns {made['n_kept'].mean():.3f}")
    print(f"Python loop                       {captions / slow:>12,.0f} captions/s")
    print(f"columns                           {captions / fast:>12,.0f} captions/s")
    print(f"columns, text_id                  {captions / (fast + with_id):>12,.0f} captions/s")
    print(f"columns, text_id, Parquet (zstd)  {captions / total:>12,.0f} captions/s")
    print(f"Parquet: {size / 1e6:.1f} MB")
    print(f"ratio (goal 8): {slow / fast:.1f}")


if __name__ == "__main__":
    main()
