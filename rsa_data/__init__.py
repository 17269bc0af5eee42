"""From images to metric depth by way of words: captions, embeddings and a light head, staged.

The public Python API is what this module names; everything else may change between versions.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .common.errors import RsaDataError as RsaDataError
    from .evaluation.depth_errors import depth_errors as depth_errors
    from .heads.checkpoint import ScaleHead as ScaleHead
    from .heads.metric import to_metric as to_metric
    from .views.notebook import embed_texts as embed_texts
    from .views.notebook import predict_depth as predict_depth
    from .views.notebook import write_captions as write_captions
    from .views.open_work import open_work as open_work
    from .views.torch_dataset import ShardDataset as ShardDataset

# Imported when first used: torch takes seconds, `rsa-data --help` should not.
_PUBLIC = {
    "ScaleHead": "rsa_data.heads.checkpoint",
    "to_metric": "rsa_data.heads.metric",
    "depth_errors": "rsa_data.evaluation.depth_errors",
    "RsaDataError": "rsa_data.common.errors",
    "open_work": "rsa_data.views.open_work",
    "write_captions": "rsa_data.views.notebook",
    "embed_texts": "rsa_data.views.notebook",
    "predict_depth": "rsa_data.views.notebook",
    "ShardDataset": "rsa_data.views.torch_dataset",
}
__all__ = [
    "open_work",
    "write_captions",
    "embed_texts",
    "predict_depth",
    "ShardDataset",
    "ScaleHead",
    "to_metric",
    "depth_errors",
    "RsaDataError",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
