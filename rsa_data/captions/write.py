"""The captions stage: segments -> captions, whole columns at a time."""

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from .. import registry, tables
from ..encoders.tokenizers import Tokenizer
from ..errors import RsaDataError, UsageError
from . import assemble, chance, objects, styles, words
from .assemble import Column
from .choose import CAPTIONS_A_BLOCK, choose

Step = Callable[[pa.Table, pa.Table], pa.Table]


def build(
    *,
    style: str = "occupancy",
    variants: int = 5,
    seed: int = 0,
    delete: float = 0.2,
    delete_by_area: float | None = None,
    which: objects.Which = "all",
    group: bool = False,
    digits: int = 2,
    tokenizer: str = "clip",
    max_tokens: int | None = None,
) -> Step:
    """Writes the captions of each image: one plain, the others augmented by swap and delete.

    Parameters
    ----------
    style : how an object is worded; see `rsa-data list styles`.
    variants : captions an image. Variant 0 is the plain one, largest object first.
    seed : of swap and delete.
    delete : probability that an object is left out of an augmented caption, 0 to 1.
    delete_by_area : delete with probability 1 - sigmoid(this x share of the image) instead; the
        released code had 100 or 10.
    which : objects to tell of: all, things (countable), or background.
    group : equal classes become one object: 3 chairs occupy 8.00% of the image.
    digits : decimals of a percentage, 0 to 3.
    tokenizer : what counts the tokens of a text; see `rsa-data list tokenizers`.
    max_tokens : the most tokens of a text, start and end tokens included; the tokenizer's own
        limit when not given, no limit when 0.
    """
    wording = registry.resolve("style", registry.STYLES, style)
    counter: Tokenizer = registry.resolve("tokenizer", registry.TOKENIZERS, tokenizer)()
    if not 1 <= variants <= 32_767:
        raise UsageError(f"variants: expected 1 to 32767, found {variants}")
    if not 0 <= digits <= 3:
        raise UsageError(f"digits: expected 0 to 3, found {digits}")
    if not 0 <= delete <= 1:
        raise UsageError(f"delete: expected a probability, 0 to 1, found {delete}")
    limit = counter.max_tokens if max_tokens is None else max_tokens or 2**30
    grouped = group if wording.group is None else wording.group
    costs: dict[str, int] = {}

    def tokens(strings: Any) -> np.ndarray:
        """Tokens of each string alone, without start and end; each distinct string counted once."""
        if new := list({s for s in strings if s not in costs}):
            costs.update(zip(new, (counter.count(new) - counter.specials).tolist(), strict=True))
        return np.array([costs[s] for s in strings], np.int32)

    def block(segments: pa.Table, label: np.ndarray, names: list[str]) -> dict[str, Any]:
        found = objects.from_segments(segments, label, which, grouped)
        spelled = wording.phrase(found, [words.word(name) for name in names], digits)
        comma = int(tokens([wording.between])[0])
        cost = np.full(len(found.label), comma, np.int32)
        for column in spelled:
            table = tokens(column.strings)
            cost += table[0] if column.codes is None else table[column.codes]
        base = counter.specials - comma + int(tokens([styles.OPENING, wording.closing]).sum())
        images = len(segments)
        keys = chance.caption_keys(seed, segments["sample_id"].to_pylist(), variants)
        plain = np.zeros(keys.shape, bool)
        plain[0] = True
        chosen = choose(
            found.first,
            cost,
            np.full(images, base, np.int32),
            np.full(keys.shape, limit, np.int32),
            keys,
            plain,
            np.full(len(cost), delete),
            int(tokens([wording.last])[0]) - comma,
        )
        text = assemble.texts(
            chosen,
            spelled,
            Column([styles.OPENING]),
            wording.between,
            wording.last,
            wording.closing,
            styles.NOTHING,
        )
        some = chosen.object >= 0
        caption, of = chosen.caption[some], found.area[chosen.object[some]]
        kept = np.bincount(caption, minlength=len(text))
        area = np.bincount(found.image, found.area, images)
        nothing = counter.specials + int(tokens([styles.NOTHING])[0])
        return {
            "text": text,
            "n_objects": np.repeat(np.diff(found.first), variants),
            "n_kept": kept,
            "n_tokens": np.where(kept, chosen.n_tokens, nothing),
            "area": np.repeat(area, variants),
            "area_kept": np.bincount(caption, of, len(text)),
        }

    def step(segments: pa.Table, samples: pa.Table) -> pa.Table:
        segments = segments.filter(pc.equal(segments["status"], "ok")).combine_chunks()
        flat = pc.list_flatten(segments["label"]).dictionary_encode().combine_chunks()
        flat = flat.chunk(0) if isinstance(flat, pa.ChunkedArray) else flat
        label, names = flat.indices.to_numpy(), flat.dictionary.to_pylist()
        begins = np.append(0, np.cumsum(pc.list_value_length(segments["label"]).to_numpy()))
        size = max(1, CAPTIONS_A_BLOCK // variants)
        blocks = [
            block(
                segments.slice(a, size),
                label[begins[a] : begins[min(a + size, len(segments))]],
                names,
            )
            for a in range(0, len(segments), size)
        ]
        measured = tables.schema("captions").names[4:]
        columns = {
            name: np.concatenate([b[name] for b in blocks]) if blocks else [] for name in measured
        }
        text = (
            pa.concat_arrays([b["text"] for b in blocks]) if blocks else pa.array([], pa.string())
        )
        rows = np.repeat(np.arange(len(segments)), variants)
        sample_id = segments["sample_id"].combine_chunks().take(pa.array(rows))
        return tables.from_columns(
            "captions",
            {
                "sample_id": sample_id,
                "variant": pa.array(np.tile(np.arange(variants, dtype=np.int16), len(segments))),
                "text": text,
                "text_id": text_ids(text),
                **{n: pa.array(c).cast(tables.schema("captions").field(n).type) for n, c in columns.items()},
            },
        )

    return step


def text_ids(text: pa.Array) -> pa.Array:
    """BLAKE2b of 16 bytes of each text's UTF-8: the key that embeddings have."""
    blake2b = hashlib.blake2b
    digests = [blake2b(t, digest_size=16).digest() for t in text.cast(pa.binary()).to_pylist()]
    return pa.Array.from_buffers(pa.binary(16), len(text), [None, pa.py_buffer(b"".join(digests))])
