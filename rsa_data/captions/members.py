"""The style `member`: captions that lie beside the images, in the same shards."""

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa

from ..common.errors import RowError, RsaDataError, UsageError
from ..common.progress import advance
from ..common.tokenizers import Tokenizer
from ..datasets.shard_texts import texts_beside
from . import natural


class Style:
    """member:ENDING, texts in the shards, such as member:txt; member:COLUMN in Parquet files.

    In tars and zips, the member of the image's key with that ending; each of its lines is a
    variant. In Parquet files, the column with a text or a list of texts in each row.
    """

    version = 1

    def identity(self, argument: str, asked: object) -> dict[str, str]:
        """Nothing beside the style itself: the ending is part of its name."""
        return {}

    def step(
        self, argument: str, asked: object, tokenizer: Tokenizer, root: Path | None
    ) -> Callable[..., pa.Table]:
        """A step from samples to captions.

        An image without a text gets "An image."; a text that is not UTF-8 counts as none, and the
        receipt says so. Raises RsaDataError when no image of a part has a text.
        """
        if not argument:
            raise UsageError("captions: style: expected member:ENDING, such as member:txt")
        if root is None:
            raise UsageError("captions: the style member reads the shards: give --root")

        def write(*inputs: pa.Table) -> pa.Table:
            samples = inputs[-1]
            found: list[list[str]] = []
            failed: dict[str, str] = {}
            ids, images = samples["sample_id"].to_pylist(), samples["image"].to_pylist()
            for sample_id, image in zip(ids, images, strict=True):
                try:
                    found.append([] if image is None else texts_beside(root, image, argument))
                except RowError as error:
                    failed[sample_id] = str(error)
                    found.append([])
                except RsaDataError as error:
                    raise RsaDataError(f"captions/member: {error}") from error
                advance(1)
            if found and not any(found):
                first = next(iter(failed.values()), "")
                raise RsaDataError(
                    f"captions/member: expected texts in members .{argument} (in Parquet files, in "
                    f"the column {argument}) of {ids[0]} and the {len(found) - 1} other images of "
                    f"its part; found none{first and ': '}{first}"
                )
            table = natural.write_texts("member", samples, found, tokenizer)
            if not failed:
                return table
            audit = {b"audit": json.dumps({"failed": failed}, sort_keys=True).encode()}
            return table.replace_schema_metadata((table.schema.metadata or {}) | audit)

        return write


member = Style()
