"""What a head reads of images whose description was changed: captions and objects written anew."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..common.errors import RsaDataError
from ..common.options import call, grouped
from ..store import schemas
from ..store.tables import WorkDir
from .belong import Source
from .inputs import objects
from .inputs.kinds import Block, Feed, find
from .inputs.vectors import Vectors

Step = Callable[..., pa.Table]


@dataclass(frozen=True)
class Inputs:
    """The inputs of a head on one dataset, of which those that describe can be written anew.

    segments : the table that descriptions come from. captions : options of the captions stage.
    encode : captions table -> embeddings table. list_objects : segments and samples -> objects
    table. Both are None where the head does not read them.
    """

    source: Source
    segments: str
    captions: dict[str, Any]
    encode: Step | None
    list_objects: Step | None

    def read(
        self,
        work: WorkDir,
        number: int,
        options: dict[str, Any],
        variant: int,
        nothing: bool = False,
    ) -> list[Block]:
        """Each input of every row of samples of a part, where descriptions are changed.

        options : of the captions stage, over those of the head's own captions. variant : which
        caption of these options. nothing : as if nothing had been found in any image.
        """
        dataset = self.source.dataset
        segments = work.table(dataset, self.segments)
        for name in self.source.tables:
            made_of = work.table(dataset, name).receipt(number).inputs.get(self.segments)
            if made_of not in (None, segments.receipt(number).digest):
                raise RsaDataError(
                    f"{dataset}/{name} part {number} was made from other {self.segments} than "
                    "those that lie there now: run its stage again"
                )
        found = segments.read(number)
        if nothing:
            found = _nothing(found)
        samples = work.table(dataset, "samples").read(number)
        given = {**self.captions, **options, "variants": variant + 1}
        feeds = self.source.inputs
        blocks = [self._described(feed, found, samples, given) for feed in feeds]
        return [
            feed.read(work, dataset, number, variant=0) if block is None else block
            for feed, block in zip(feeds, blocks, strict=True)
        ]

    def listed(
        self, work: WorkDir, number: int, less: Callable[[objects.Objects], objects.Objects]
    ) -> list[Block]:
        """Each input of a part where the head is told less of the objects."""
        blocks = self.source.read(work, number, 0)
        return [less(b) if isinstance(b, objects.Objects) else b for b in blocks]

    def _described(
        self, feed: Feed, segments: pa.Table, samples: pa.Table, options: dict[str, Any]
    ) -> Block | None:
        """An input written anew; None where it does not describe."""
        from ..captions import write
        from ..captions.described import described
        from ..captions.options import Augmentation, Contents, WrongObjects

        ids, variant = samples["sample_id"], options["variants"] - 1
        if feed.kind == "text" and self.encode:
            captions = call(write.build, **options)(segments, samples)
            captions = captions.filter(np.asarray(captions["variant"]) == variant)
            texts = self.encode(captions)
            place = find(ids, captions["sample_id"])
            rows = find(captions["text_id"], texts["text_id"])[place[place >= 0]]
            first = np.concatenate([[0], np.cumsum(place >= 0)])
            return Vectors(schemas.embedding_array(texts), rows, first)
        if feed.kind == "objects" and self.list_objects:
            groups = grouped(write.build, options)
            contents = replace(groups.get("contents", Contents()), group=False)
            found = described(
                segments,
                samples,
                variant,
                augmentation=groups.get("augmentation", Augmentation()),
                contents=contents,
                wrong=groups.get("wrong", WrongObjects()),
            )
            return objects.of_table(ids, self.list_objects(found, samples))
        return None


def inputs(work: WorkDir, source: Source, weights: Path | None) -> Inputs:
    """The inputs of a head on a dataset, with the encoders that its tables were made by.

    weights : file of the text encoder's weights, where it is not found by itself. Raises
    RsaDataError when a description does not come from segments.
    """
    from ..embeddings import embed
    from ..embeddings import objects as listing

    about = {
        feed.kind: work.table(source.dataset, feed.table).description() for feed in source.inputs
    }
    captions, segments = {}, set()
    if "text" in about:
        written = work.table(source.dataset, source.captions).description()
        captions = written.options
        segments |= set(_segments(f"{source.dataset}/{source.captions}", written.inputs))
    if "objects" in about:
        segments |= set(_segments(f"{source.dataset}/objects", about["objects"].inputs))
    if len(segments) > 1:
        raise RsaDataError(
            f"{source.dataset}: expected captions and objects of the same segments, so that both "
            f"change alike; found {' and '.join(sorted(segments))}"
        )
    return Inputs(
        source,
        segments.pop(),
        captions,
        embed.build(**about["text"].options, encoder_weights=weights) if "text" in about else None,
        listing.build(**about["objects"].options, encoder_weights=weights)
        if "objects" in about
        else None,
    )


def _segments(where: str, inputs_: list[str]) -> list[str]:
    found = [name for name in inputs_ if name.startswith("segments/")]
    if not found:
        raise RsaDataError(
            f"{where}: expected captions written from segments, whose objects can be changed; "
            "these were imported"
        )
    return found


def _nothing(segments: pa.Table) -> pa.Table:
    """The same images with no segment in them."""
    columns: dict[str, Any] = {name: segments[name] for name in segments.column_names}
    for name in columns:
        if pa.types.is_list(segments.schema.field(name).type):
            empty: list[list[Any]] = [[]] * len(segments)
            columns[name] = pa.array(empty, segments.schema.field(name).type)
    return pa.table(columns, schema=segments.schema)
