"""Plain PyTorch as one would write it: tensors from Parquet, Adam, a clipped gradient."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch

sys.path.insert(0, str(Path(__file__).parents[1]))
import train

from rsa_data.heads.train.validation_split import by_scene

given = json.loads(sys.argv[1])
torch.set_num_threads(given["threads"])
read = {name: pq.read_table(files) for name, files in given["files"].items()}
samples, features, depth = read.values()
rows = {
    "features": np.stack([np.frombuffer(v, "<f2") for v in features["embedding"].to_pylist()]),
    "y": np.stack([np.frombuffer(v, "<f2") for v in depth["relative"].to_pylist()]),
    "depth": np.stack([np.frombuffer(v, "<f2") for v in depth["metric"].to_pylist()]),
}
held, _ = by_scene("nyuv2", samples["scene"].to_numpy().astype(object), 0.1, False)
begun = time.process_time()
_, error = train.plain(rows, held, given["epochs"])
Path(given["out"]).write_text(json.dumps(error))
print(json.dumps({"steady": time.process_time() - begun}))
