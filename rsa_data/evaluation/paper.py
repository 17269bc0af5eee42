"""The paper's own rows (paper.toml), beside ours only where the conditions are the same."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from .summary import Row

_METRICS = ("delta1", "abs_rel", "rmse")


@cache
def _paper() -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / "paper.toml").read_text("utf-8"))


def paper_rows(
    dataset: str,
    kind: str,
    *,
    split: str,
    protocol: str,
    images: int,
    model: str,
    options: Mapping[str, Any],
) -> tuple[list[Row], list[str]]:
    """The paper's rows that may stand beside an evaluation, and why others may not.

    dataset : name in the work dir, kind : in the registry. images : how many have ground truth.
    model, options : of the depth table that was evaluated (geometry, crop).
    Nothing that depends on a depth model is taken unless model, geometry and crop are the paper's.
    """
    paper = _paper()
    here = [row for row in paper["row"] if row["dataset"] == kind]
    if not here:
        return [], [f"paper: {dataset}: the paper reports nothing on {kind}"]
    for what, ours, theirs in (
        ("protocol", protocol, paper["protocol"]),
        ("split", split, paper["split"]),
        ("number of test images", images, paper["images"][kind]),
    ):
        if ours != theirs:
            return [], [f"paper: {dataset}: no row taken: {what} is {ours} here, {theirs} there"]
    rows, reasons = [], {}
    for row in here:
        backbone = row.get("backbone")
        why = (
            None
            if backbone is None
            else _differs(paper["backbone"][backbone], kind, model, options)
        )
        if why is not None:
            reasons[paper["backbone"][backbone]["title"]] = why
            continue
        trained = f" ({row['trained']})" if row["trained"] else ""
        rows.append(
            Row(
                dataset=dataset,
                method=f"paper: {row['method']}{trained}",
                images=images,
                failed=0,
                scenes=0,
                mean=dict(zip(_METRICS, row["numbers"], strict=True)),
                low={},
                high={},
            )
        )
    notes = [f"paper: {dataset}: rows of {title} left out: {why}" for title, why in reasons.items()]
    return rows, notes


def _differs(
    backbone: Mapping[str, Any], kind: str, model: str, options: Mapping[str, Any]
) -> str | None:
    """Why a backbone of the paper is not the depth model at hand; None when it is."""
    if "model" not in backbone:
        return "its weights are not among the models here"
    if backbone["model"] != model:
        return f"y was made by {model} here, by {backbone['model']} there"
    if kind not in backbone["geometry"]:
        return f"the geometry that its y was made at on {kind} is not known"
    for key, default in (("geometry", None), ("crop", "none")):
        ours, theirs = options.get(key, default), backbone[key][kind]
        if ours != theirs:
            return f"{key} of y is {ours or 'the model card' + chr(39) + 's'} here, {theirs} there"
    return None
