"""The paper's own rows (paper.toml), beside ours only where the conditions are the same."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from .summary import Row


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
        reason = paper["unknown"].get(kind, f"the paper reports nothing on {kind}")
        return [], [f"paper: {dataset}: {reason}"]
    for what, ours, theirs in (
        ("protocol", protocol, paper["protocol"]),
        ("split", split, paper["split"].get(kind, "test")),
        ("number of test images", images, paper["images"][kind]),
    ):
        if ours != theirs:
            return [], [f"paper: {dataset}: no row taken: {what} is {ours} here, {theirs} there"]
    why = {
        backbone: _differs(about, kind, model, options)
        for backbone, about in paper["backbone"].items()
    }
    rows = [
        Row(
            dataset=dataset,
            method=f"paper: {row['method']}{_trained(row)}",
            images=images,
            failed=0,
            scenes=0,
            mean=dict(zip(_metrics(kind, len(numbers)), numbers, strict=True)),
            low={},
            high={},
        )
        for row in here
        for backbone in (*why, "numbers")
        if (numbers := row.get(backbone)) and why.get(backbone) is None
    ]
    used = [backbone for backbone in why if any(backbone in row for row in here)]
    notes = [
        f"paper: {dataset}: rows of {paper['backbone'][name]['title']} left out: {why[name]}"
        for name in used
        if why[name]
    ]
    return rows, notes


def _trained(row: Mapping[str, Any]) -> str:
    return f" ({row['trained']})" if row["trained"] else ""


def _metrics(kind: str, count: int) -> tuple[str, ...]:
    """The metrics of a row's numbers: three of the main tables, or six of the rebuttal's."""
    if count == 3:
        return ("delta1", "abs_rel", "rmse")
    log = "rmse_log" if kind == "kitti" else "log10"
    return ("delta1", "delta2", "delta3", "abs_rel", log, "rmse")


def _differs(
    backbone: Mapping[str, Any], kind: str, model: str, options: Mapping[str, Any]
) -> str | None:
    """Why a backbone of the paper is not the depth model at hand; None when it is."""
    if backbone["model"] != model:
        return f"y was made by {model} here, by {backbone['model']} there"
    if kind not in backbone["geometry"]:
        return f"the geometry that its y was made at on {kind} is not known"
    for key, default in (("geometry", None), ("crop", "none")):
        ours, theirs = options.get(key, default), backbone[key][kind]
        if ours != theirs:
            return f"{key} of y is {ours or 'the model card' + chr(39) + 's'} here, {theirs} there"
    return None
