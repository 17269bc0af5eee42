"""Occupancy captions as one would write them: an image at a time, in pandas or datasets.map.

Plurals and tokens come from this project, so that the captions compare; the loop remembers the
tokens of each phrase that it has seen.
"""

import json
import random
import sys
import tempfile
import time

given = json.loads(sys.argv[1])
DELETE, VARIANTS = 0.2, given["variants"]


def writer():
    from rsa_data.captions.words import word
    from rsa_data.common.tokenizers import clip

    tokenizer, rng, known = clip(), random.Random(0), {}
    limit, around = tokenizer.max_tokens, int(tokenizer.count(["An image with"])[0])

    def write(labels, areas):
        largest = sorted(range(len(labels)), key=lambda i: -areas[i])
        for variant in range(VARIANTS):
            kept, used = [], around
            for i in largest:
                if variant and rng.random() < DELETE:
                    continue
                named = word(labels[i])
                verb = "occupy" if named.is_plural else "occupies"
                phrase = f"{named.name} {verb} {round(100 * areas[i], 2):.2f}% of the image"
                tokens = known.get(phrase)
                if tokens is None:
                    tokens = known[phrase] = int(tokenizer.count([phrase])[0]) - 2
                more = tokens + 1 if kept else tokens
                if used + more <= limit:
                    kept.append(phrase)
                    used += more
            if variant:
                rng.shuffle(kept)
            text = "An image with " + ", ".join(kept) if kept else "An image."
            yield variant, text, len(kept), used

    return write


if given["way"] == "pandas":
    import pandas as pd

    begun = time.process_time()
    write = writer()
    frame = pd.concat(pd.read_parquet(file) for file in given["files"])
    rows = [
        (image.sample_id, *one)
        for image in frame.itertuples()
        for one in write(image.label, image.area)
    ]
    names = ["sample_id", "variant", "text", "n_kept", "n_tokens"]
    pd.DataFrame(rows, columns=names).to_parquet(given["out"])
else:
    import datasets

    begun = time.process_time()
    write = writer()

    def captions(batch):
        made = {"sample_id": [], "variant": [], "text": [], "n_kept": [], "n_tokens": []}
        for sample, labels, areas in zip(
            batch["sample_id"], batch["label"], batch["area"], strict=True
        ):
            for one in write(labels, areas):
                for name, value in zip(made, (sample, *one), strict=True):
                    made[name].append(value)
        return made

    datasets.disable_progress_bars()
    datasets.disable_caching()  # or a second run would only read what the first one made
    cache = tempfile.TemporaryDirectory()
    table = datasets.Dataset.from_parquet(
        given["files"], columns=["sample_id", "label", "area"], cache_dir=cache.name
    )
    made = table.map(captions, batched=True, remove_columns=table.column_names)
    made.to_parquet(given["out"])
print(json.dumps({"steady": time.process_time() - begun}))
