"""The stage embed: every distinct text of a captions part through a frozen encoder, once."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from .. import registry
from ..common import progress
from ..common.errors import RsaDataError
from ..common.options import accepts_old_names
from ..common.ranges import AtOnce
from ..runner.stage import Notes, Reads, Stage
from ..store import schemas
from . import audit, frozen, runtime
from .features import check_finite, stored
from .running import Precision
from .runtime import Device, Runtime

Step = Callable[[pa.Table], pa.Table]


@accepts_old_names("embed")
def build(
    *,
    encoder: str = "clip-rn50",
    encoder_weights: Path | None = None,
    precision: frozen.Chosen = "float32",
    store: Literal["float16", "float32"] = "float16",
    normalize: bool = False,
    runtime: Runtime = "auto",
    device: Device = "auto",
    threads: AtOnce = 2,
    audit_head: Path | None = None,
) -> Step:
    """Turns texts into features with a frozen text encoder.

    Parameters
    ----------
    encoder : text encoder; see `rsa-data list encoders`.
    encoder_weights : file with the encoder's weights, or folder of a sentence encoder. By default
        it comes from its package, the cache, or a download with its checksum.
    precision : arithmetic of the encoder. What is not float32 is compared with float32 on 256
        texts of the first part and on 1% of the others, and refused beyond the limits in
        embeddings/audit.py. auto is bfloat16 on a CPU or GPU that computes in it, else float32;
        it is chosen once for a table.
    store : type of the stored features; float16 rounds each value by up to 4.9e-4 of itself.
    normalize : scale each feature to norm 1; the paper's heads want CLIP's features raw. An
        encoder whose own definition ends in a normalisation has it in any case.
    runtime : torch or onnx; auto takes the faster one that is installed. ONNX Runtime runs float32
        and int8 on a CPU, and needs the extra `export` to make its graph the first time.
    device : where the encoder runs; auto takes a GPU when there is one.
    threads : CPU threads of each worker; they can change the last bits of a feature.
    audit_head : a trained head: the comparison with float32 then also shows what becomes of scale
        and shift.
    """
    run, model, exact = frozen.runners(
        encoder, encoder_weights, precision, runtime, device, threads
    )

    def step(captions: pa.Table) -> pa.Table:
        text_id, texts = distinct_texts(captions)
        ids, truncated = model.tokenize(texts)
        lengths = np.fromiter(map(len, ids), np.int32, len(ids))
        samples = captions["sample_id"] if "sample_id" in captions.column_names else text_id
        # Rows are counted in samples; the time goes with tokens.
        told = progress.Proportion(len(pc.unique(samples)), int(lengths.sum()))
        features = frozen.features_of(
            run, model, ids, lambda rows: told.add(int(lengths[rows].sum()))
        )
        check_finite(features, texts)
        figures = {}
        if precision != "float32" and texts:
            rows = audit.sample(len(texts), part_number(captions))
            reference = frozen.features_of(exact, model, [ids[row] for row in rows])
            figures = audit.compare(features[rows], reference, precision, audit_head)
        if normalize:
            features /= np.linalg.norm(features, axis=1, keepdims=True)
        table = schemas.from_columns(
            "embeddings",
            {
                "text_id": text_id,
                "embedding": schemas.embedding_column(stored(features, store)),
                "n_tokens": lengths,
                "truncated": truncated,
            },
        )
        return table.replace_schema_metadata({"audit": json.dumps(figures)} if figures else None)

    return step


def notes(made: Iterable[pa.Table], captions: pa.Table, **options: Any) -> list[str]:
    """What the summary says: texts that were cut, and what a faster precision changed."""
    texts = cut = 0
    audits = []
    for table in made:
        texts += len(table)
        cut += pc.sum(table["truncated"], min_count=0).as_py()
        if figures := (table.schema.metadata or {}).get(b"audit"):
            audits.append(json.loads(figures))
    sentences = []
    if cut:
        sentences.append(
            f"{cut / texts:.1%} of the texts are longer than {options['encoder']} reads: their "
            "ends were cut (`captions --max-tokens` writes shorter ones)"
        )
    if audits:
        texts = sum(figures["texts"] for figures in audits)
        # A head may have been given to some of the runs only.
        worst = {
            key: (min if "cosine" in key else max)(a[key] for a in audits if key in a)
            for key in dict.fromkeys(key for a in audits for key in a)
        }
        sentences.append(
            f"{options['precision']} compared with float32 on {texts:,} texts: cosine at least "
            f"{worst['cosine_min']:.5f}, norm changed by at most {worst['norm_change_max']:.2%}"
            + (
                f", scale by {worst['scale_change_p95']:.1%} and shift by "
                f"{worst['shift_change_p95']:.1%} (95th percentiles)"
                if "scale_change_p95" in worst
                else ""
            )
        )
    return sentences


def part_number(captions: pa.Table) -> int:
    """The part of a table, by its metadata; 0 for captions of any other source."""
    return int((captions.schema.metadata or {}).get(b"part", b"0"))


def settle(options: dict[str, Any], there: dict[str, Any] | None) -> dict[str, Any]:
    """The options with `precision = auto` resolved: as the table has it, else by this machine."""
    if options["precision"] != "auto":
        return options
    if there is not None and there.get("precision") in get_args(Precision):
        return {**options, "precision": there["precision"]}
    chosen = runtime.native_precision(options["runtime"], options["device"])
    return {**options, "precision": chosen}


def distinct_texts(captions: pa.Table) -> tuple[pa.Array, list[str]]:
    """Ids and texts of a captions part, each once, in order of first appearance."""
    encoded = captions["text_id"].combine_chunks().dictionary_encode()
    # Codes are numbered by first appearance, so the first row of each code is in that order.
    first = np.unique(encoded.indices.to_numpy(), return_index=True)[1]
    texts = captions["text"].take(pa.array(first)).combine_chunks()
    try:
        return encoded.dictionary, texts.to_pylist()
    except UnicodeDecodeError as error:
        start = error.object[:60]
        raise RsaDataError(f"captions: text: expected UTF-8, found {start!r}") from error


STAGE = Stage(
    name="embed",
    version=2,
    build=build,
    help="""Turn captions into text embeddings.

    Covers every dataset of the work dir unless --dataset is given. Each distinct text is encoded
    once.

    \b
      rsa-data embed --encoder minilm
      rsa-data embed --encoder clip-rn50 --encoder-weights RN50.pt
    """,
    next="depth --dataset {dataset} --depth-model depth-anything-v2-small",
    schema="embeddings",
    folder="embeddings/{label}",
    selector="encoder",
    choices=registry.ENCODERS,
    reads=Reads("captions", "style", with_samples=False),
    unit="text_id",
    noun="texts",
    models=True,
    local=("encoder_weights", "audit_head"),
    files=frozen.files,
    notes=Notes(("truncated", "n_tokens"), notes),
    settle=settle,
)
