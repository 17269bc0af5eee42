"""What the images show and what the captions say of it: classes, segments, lengths, duplicates."""

from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ... import registry
from ...captions import summary
from ...common.html import Html, tag
from ...store.tables import Table, WorkDir
from . import plots

_CLASSES = 20
# Parts read a table, evenly over it. At 2,000 images a part that is 100,000 images.
_PARTS = 50


def content(work: WorkDir) -> Html:
    """A section on segments and one on captions, a few plots for each table."""
    segments, captions = [], []
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            if name.startswith("segments/"):
                segments += _segments(table)
            elif name.startswith("captions/"):
                captions += _captions(work, table)
    nothing = tag("p", "There is no such table in this work dir yet.")
    return tag(
        "div",
        tag("section", tag("h2", "Segments"), tag("div", segments or nothing, class_="plots"),
            id="segments"),
        tag("section", tag("h2", "Captions"), tag("div", captions or nothing, class_="plots"),
            id="captions"),
    )  # fmt: skip


def spread(numbers: list[int], most: int) -> list[int]:
    """At most `most` of the numbers, evenly over them, the first always."""
    return numbers if len(numbers) <= most else numbers[:: -(-len(numbers) // most)]


def _segments(table: Table) -> list[Html]:
    numbers = table.parts()
    counted: Counter[str] = Counter()
    lengths = []
    for number in spread(numbers, _PARTS):
        rows = table.read(number, ["status", "label"])
        rows = rows.filter(pc.equal(rows["status"], "ok"))
        lengths.append(pc.list_value_length(rows["label"]).to_numpy())
        for entry in pc.value_counts(pc.list_flatten(rows["label"])).to_pylist():
            counted[entry["values"]] += entry["counts"]
    count = np.concatenate(lengths) if lengths else np.zeros(0)
    if not len(count):
        return []
    common = counted.most_common(_CLASSES)
    more = f" (of {len(counted)})" if len(counted) > _CLASSES else ""
    found = [
        plots.histogram(
            f"{table.path}: segments in an image, {_of(table, len(count))}",
            count, "segments in an image", "images",
        )
    ]  # fmt: skip
    if common:
        names, values = zip(*common, strict=True)
        title = f"{table.path}: most frequent classes{more}"
        found.append(plots.bars(title, names, values, "segments"))
    return found


def _captions(work: WorkDir, table: Table) -> list[Html]:
    numbers = table.parts()
    read = [table.read(n, list(summary.COLUMNS)) for n in spread(numbers, _PARTS)]
    if not read:
        return []
    rows = pa.concat_tables(read)
    tokens = rows["n_tokens"].to_numpy()
    options = table.description().options
    limit = options.get("max_tokens") or _limit(options.get("tokenizer", "clip"))
    title = f"{table.path}: tokens in a caption, {_of(table, len(tokens), 'captions')}"
    mark = (limit, f"limit {limit}") if limit else None
    kept = summary.kept([rows])
    said = []
    if kept["objects"]:
        lost = 1 - kept["objects_kept"] / kept["objects"]
        area = 1 - kept["area_kept"] / kept["area"] if kept["area"] else 0.0
        said.append(
            f"{kept['losing']:,.0f} of {kept['captions']:,.0f} plain captions leave objects out: "
            f"{lost:.1%} of all objects, {area:.1%} of their area, are not told of."
        )
    over = int((tokens > limit).sum()) if limit else 0
    said.append(f"{over:,} of {len(tokens):,} captions are longer than {limit} tokens.")
    said += _duplicates(work, table)
    plot = plots.histogram(title, tokens, "tokens, start and end included", "captions", mark)
    return [tag("div", plot, [tag("p", sentence) for sentence in said])]


def _limit(tokenizer: str) -> int | None:
    limit: int | None = registry.resolve("tokenizer", registry.TOKENIZERS, tokenizer)().max_tokens
    return limit


def _duplicates(work: WorkDir, table: Table) -> list[str]:
    """What encoding each distinct text of a part once has saved, from the receipts alone."""
    said = []
    style = table.name.removeprefix("captions/")
    for name in work.tables(table.dataset):
        if not name.startswith(f"embeddings/{style}/"):
            continue
        other = work.table(table.dataset, name)
        both = sorted(set(table.parts()) & set(other.parts()))
        texts = sum(table.receipt(n).rows for n in both)
        distinct = sum(other.receipt(n).rows for n in both)
        if texts:
            said.append(
                f"{name}: {distinct:,} distinct texts of {texts:,} were encoded; "
                f"{1 - distinct / texts:.1%} were duplicates within their part and were saved."
            )
    return said


def _of(table: Table, seen: int, what: str = "images") -> str:
    every = len(table.parts()) <= _PARTS
    return f"all {seen:,} {what}" if every else f"a sample of {seen:,} {what}"
