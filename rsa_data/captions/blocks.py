"""All captions of a part, block by block."""

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.class_names import clean
from ..common.errors import RsaDataError
from ..common.progress import advance
from .assemble import MAX_BYTES
from .caption_table import Columns, measured
from .choose import CAPTIONS_A_BLOCK
from .compose import Recipe, compose


def composer(recipe: Recipe) -> Callable[[pa.Table, pa.Table], Columns]:
    """(segments, samples) -> the columns of their captions but text_id; rows that are ok only.

    In the order of samples, then variant. Raises RsaDataError when the texts pass 2 GB.
    """
    variants = recipe.augmentation.variants
    size = CAPTIONS_A_BLOCK // variants

    def write(segments: pa.Table, samples: pa.Table) -> Columns:
        segments, samples = good_rows(segments, samples)
        label, names = classes_of(segments)
        ends = np.cumsum(pc.list_value_length(segments["label"]).to_numpy())
        begins = np.append(0, ends)
        found = []
        for start in range(0, len(segments), size):
            stop = min(start + size, len(segments))
            images = segments.slice(start, size), samples.slice(start, size)
            found.append(compose(recipe, *images, label[begins[start] : begins[stop]], names))
            advance(stop - start)
        if sum(block["text"].nbytes for block in found) > MAX_BYTES:
            raise RsaDataError(
                f"captions: the texts of {len(segments)} images pass 2 GB, the most of a part. "
                "Give fewer --variants or a smaller --max-tokens, or index into smaller parts"
            )
        rows = np.repeat(np.arange(len(segments)), variants)
        columns: Columns = {
            "sample_id": segments["sample_id"].combine_chunks().take(pa.array(rows)),
            "variant": np.tile(np.arange(variants), len(segments)),
        }
        for name in measured():
            pieces = [block[name] for block in found]
            if name == "text":
                columns[name] = pa.concat_arrays(pieces or [pa.array([], pa.string())])
            else:
                columns[name] = np.concatenate(pieces or [np.zeros(0)])
        return columns

    return write


def good_rows(segments: pa.Table, samples: pa.Table) -> tuple[pa.Table, pa.Table]:
    """The rows that are ok, in the order of samples, each column in one piece."""
    if not segments["sample_id"].equals(samples["sample_id"]):
        place = pc.index_in(samples["sample_id"], segments["sample_id"].combine_chunks())
        samples = samples.filter(place.is_valid())
        segments = segments.take(place.drop_null())
    good = pc.equal(segments["status"], "ok")
    return segments.filter(good).combine_chunks(), samples.filter(good).combine_chunks()


def classes_of(segments: pa.Table) -> tuple[np.ndarray, list[str]]:
    """A number for each segment's class, and the names of the classes by number.

    Labels that are written alike (wall-brick, wall-tile) are one class.
    """
    flat = pa.chunked_array([pc.list_flatten(c) for c in segments["label"].chunks], pa.string())
    coded = flat.combine_chunks().dictionary_encode()
    numbers: dict[str, int] = {}
    of_label = [numbers.setdefault(clean(x), len(numbers)) for x in coded.dictionary.to_pylist()]
    return np.array(of_label, np.int32)[coded.indices.to_numpy()], list(numbers)
