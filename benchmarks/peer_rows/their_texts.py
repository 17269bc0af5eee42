"""Features of texts by sentence-transformers (torch, onnx) or fastembed."""

import json
import sys
import time
from pathlib import Path

import numpy as np

given = json.loads(sys.argv[1])
texts, threads = json.loads(Path(given["texts"]).read_text()), given["threads"]
if given["way"] == "fastembed":
    from fastembed import TextEmbedding

    name = "sentence-transformers/all-MiniLM-L6-v2"
    model = TextEmbedding(name, specific_model_path=given["model"], threads=threads)

    def encode():
        return np.stack(list(model.embed(texts, batch_size=32)))
else:
    import torch
    from sentence_transformers import SentenceTransformer

    torch.set_num_threads(threads)
    options = {}
    if given["way"] == "onnx":
        import onnxruntime

        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = threads
        options["model_kwargs"] = {"session_options": settings, "file_name": "onnx/model.onnx"}
    model = SentenceTransformer(given["model"], backend=given["way"], device="cpu", **options)

    def encode():
        return model.encode(texts, batch_size=32)


begun = time.process_time()
features = encode()
steady = time.process_time() - begun
np.save(given["out"], features)
print(json.dumps({"steady": steady}))
