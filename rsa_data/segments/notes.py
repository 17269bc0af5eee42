"""What the detect stage says after a run: which model it took a file for, and what was found."""

import hashlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..common.cards import card_of, read_card
from ..common.errors import RsaDataError
from . import onnx
from .recognised import Recognised

COLUMNS = ("status", "label", "score")

# Detectors write their results for an evaluation with scores from 0.001 on.
_LOW = 0.05
_LOOK = "look at some images with --preview 12"


def write(
    parts: Iterable[pa.Table],
    *_: pa.Table,
    segments: str,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    names: str | None = None,
    **options: Any,
) -> list[str]:
    """Sentences on the model and on the classes that some parts of the table hold."""
    lines = []
    if segments == "onnx" and segmenter_weights is not None and card is None:
        read = onnx.recognised_file(segmenter_weights, names)
        lines.append(f"{segmenter_weights.name}: read as {read.told}{_threshold(read, options)}")
    elif segmenter_weights is not None:
        lines += _another_file(segments, segmenter_weights, card)
    images = Counter[str]()
    total = found = low = 0
    for part in parts:
        good = part.filter(pc.equal(part["status"], "ok"))
        total += len(good)
        for labels in good["label"].to_pylist():
            images.update(set(labels))
        scores = pc.list_flatten(good["score"])
        found += len(scores)
        low += pc.sum(pc.less(scores, _LOW)).as_py() or 0
    if total and images:
        often = sorted(images.items(), key=lambda item: (-item[1], item[0]))[:5]
        most = ", ".join(f"{name} {count / total:.0%}" for name, count in often)
        classes = "1 class" if len(images) == 1 else f"{len(images)} classes"
        lines.append(f"{classes}; in most images: {most}")
    elif total:
        lines.append(f"warning: no object in any of {total:,} images")
    if low > found / 2:
        lines.append(
            f"warning: {low:,} of {found:,} segments have scores below {_LOW}, as detectors write "
            "them for an evaluation; --score-threshold 0.3 leaves them out"
        )
    return lines


def _another_file(segments: str, weights: Path, card: Path | None) -> list[str]:
    """The warning for a file that is not the one its card was written for."""
    try:
        wanted = (read_card(card) if card else card_of("segments", segments)).sha256
    except RsaDataError:
        return []
    if wanted is None:
        return []
    with weights.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found == wanted:
        return []
    return [
        f"warning: {weights} is not the file that the card {card or segments} was written for "
        f"(sha256 {found[:12]}..., not {wanted[:12]}...): "
        f"colours, scale or classes may differ; {_LOOK}"
    ]


def _threshold(read: Recognised, options: dict[str, Any]) -> str:
    """From which score on objects were kept, where there is such a limit."""
    given = options.get("score_threshold")
    used = read.card.settings["decoder"].get("score_threshold") if given is None else given
    return "" if used is None else f"; kept from a score of {used:g}"
