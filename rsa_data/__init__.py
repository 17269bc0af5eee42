"""From images to metric depth by way of words: captions, embeddings and a light head, staged.

The public Python API is what this module names; everything else may change between versions.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .common.errors import RsaDataError as RsaDataError
    from .evaluation.metrics import depth_errors as depth_errors
    from .heads.checkpoint import ScaleHead as ScaleHead
    from .heads.metric import to_metric as to_metric

# Imported when first used: torch takes seconds, `rsa-data --help` should not.
_PUBLIC = {
    "ScaleHead": "rsa_data.heads.checkpoint",
    "to_metric": "rsa_data.heads.metric",
    "depth_errors": "rsa_data.evaluation.metrics",
    "RsaDataError": "rsa_data.common.errors",
}
__all__ = ["ScaleHead", "to_metric", "depth_errors", "RsaDataError"]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
