"""Occupancy captions by a plain loop, an image at a time, in pandas or datasets.map."""

import json
import sys
import tempfile
import time

given = json.loads(sys.argv[1])
if given["way"] == "pandas":
    import pandas as pd

    begun = time.process_time()
    from plain_loop import writer

    write = writer(given["variants"])
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
    from plain_loop import writer

    write = writer(given["variants"])

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
