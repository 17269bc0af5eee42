"""What PyTorch datasets yield: items, the parts of a split, this process's share of them."""

from typing import Any

import numpy as np
import torch
from torch.utils.data import get_worker_info

from ..common.errors import RsaDataError, UsageError
from ..heads.belong import Source
from ..heads.train.examples import Examples
from ..store.tables import WorkDir

Item = dict[str, Any]


def share_of_work() -> tuple[int, int]:
    """(number of this process, number of processes): loader workers of all ranks."""
    info = get_worker_info()
    worker, workers = (info.id, info.num_workers) if info is not None else (0, 1)
    rank, ranks = 0, 1
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        rank, ranks = torch.distributed.get_rank(), torch.distributed.get_world_size()
    return rank * workers + worker, ranks * workers


def batch_of(examples: Examples, ids: np.ndarray, rows: np.ndarray, drawn: np.ndarray) -> Item:
    """drawn : float64 (b,), 0 to below 1: which of an image's captions; 0 is the plain one."""
    return {
        "feature": _float32(examples.rows(rows, drawn)),  # (b, dim)
        "relative": _float32(examples.relative[rows]),  # (b, k)
        "metric": _float32(examples.metric[rows]),  # (b, k)
        "fit": examples.fit[rows],  # (b, 2)
        "sample_id": ids[rows].tolist(),
    }


def _float32(values: np.ndarray) -> np.ndarray:
    """The same numbers; torch widens float16 several times as fast as NumPy."""
    found: np.ndarray = torch.from_numpy(values).float().numpy()
    return found


def parts_of(work: WorkDir, source: Source, split: str) -> list[int]:
    """The parts of a split; raises RsaDataError unless every table has all of them."""
    samples = work.table(source.dataset, "samples")
    receipts = list(samples.receipts(samples.parts()))
    parts = [r.part for r in receipts if r.split == split]
    if not parts:
        there = sorted({r.split for r in receipts})
        raise UsageError(f"{source.dataset}: split {split!r}: expected one of {', '.join(there)}")
    if (
        "map"
        in work.table(source.dataset, source.depth).read(parts[0], ["kind"])["kind"].to_pylist()
    ):
        raise UsageError(
            f"{source.dataset}: split {split!r}: expected sampled pixels, such as those of train; "
            "found whole maps. docs/pytorch.md shows how to measure a network on test images"
        )
    for name in source.tables:
        missing = sorted(set(parts) - set(work.table(source.dataset, name).parts()))
        if missing:
            raise RsaDataError(
                f"{source.dataset}/{name}: {len(missing)} of {len(parts)} parts of the split "
                f"{split} are not done, such as {missing[0]}. Run the command of its stage again"
            )
    return parts
