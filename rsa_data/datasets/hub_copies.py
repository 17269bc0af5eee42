"""Copies of datasets on the Hugging Face hub; addresses and columns stand in hub_copies.toml."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from .dataset import Dataset
from .parquet import parquet


def nyuv2_parquet() -> Dataset:
    """NYUv2's 1,449 labelled frames in Parquet, from the hub; not run here with the real files."""
    return _copy("nyuv2-parquet")


def nyuv2_fastdepth() -> Dataset:
    """NYUv2, part of FastDepth's training frames and its 654 test frames, from the hub; not run."""
    # What the copy calls validation are the official test frames: nothing is chosen by them.
    return replace(_copy("nyuv2-fastdepth"), test_splits=("val",), validation_splits=())


def about(name: str) -> dict[str, Any]:
    """What hub_copies.toml says of a copy."""
    found = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))[name]
    return dict(found)


def _copy(name: str) -> Dataset:
    of = about(name)
    return replace(parquet(**of["options"]), address=of["address"])
