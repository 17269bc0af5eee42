"""A trained head, on disk as head.safetensors and head.json: features in, scale and shift out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as from_safetensors
from safetensors.torch import save as to_safetensors

from ..common.errors import RsaDataError
from ..registry import HEADS, resolve
from ..store.stores import Store, open_store
from ..store.tables import to_json
from .description import FORMAT as FORMAT
from .description import parse

_BATCH = 4096


class ScaleHead:
    """Turns features of a scene into the scale and shift that make its relative depth metric.

    network : the architecture, a module from standardised features (n, dim) to scale and shift.
    description : what head.json holds; `features.dim`, `architecture` and `format` are needed.
    mean, factor : float32 (dim,); the network is given (features - mean) * factor, so that callers
        always pass raw features, as they stand in the embeddings table.
    reference : float16 (m, dim), raw features of training captions to measure others' distance
        from; None when the head does not know what it was trained on.
    """

    def __init__(
        self,
        network: torch.nn.Module,
        description: dict[str, Any],
        mean: torch.Tensor,
        factor: torch.Tensor,
        reference: np.ndarray | None = None,
    ):
        self.network = network.eval().requires_grad_(False)
        self.description = description
        self.mean, self.factor, self.reference = mean, factor, reference
        self.dim: int = description["features"]["dim"]

    @classmethod
    def load(cls, path: str | Path) -> "ScaleHead":
        """The head in the folder `path` (WORK/heads/NAME), or in a released RSA `.pt` file.

        Raises RsaDataError when there is none, when it is broken, or when its weights are not
        exactly those of its architecture.
        """
        if str(path).endswith((".pt", ".pth")):
            from .released import read_released

            return read_released(Path(path))
        store = open_store(path)
        text = store.read("head.json")
        if text is None:
            raise RsaDataError(
                f"{path}: expected a head (head.json and head.safetensors); found no head.json. "
                "`rsa-data train-head` writes one to WORK/heads/NAME."
            )
        description = parse(text, f"{path}/head.json")
        try:
            tensors = from_safetensors(store.read("head.safetensors") or b"")
            return cls.from_tensors(tensors, description)
        except (SafetensorError, RsaDataError) as error:
            raise RsaDataError(
                f"{path}/head.safetensors: broken or not of this head: {error}"
            ) from error

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, torch.Tensor], description: dict[str, Any]
    ) -> "ScaleHead":
        """The head of these weights; raises RsaDataError unless they fit exactly."""
        network = build_network(description["architecture"], description["features"]["dim"])
        weights = dict(tensors)
        reference = weights.pop("reference").numpy() if "reference" in weights else None
        try:
            mean, factor = weights.pop("mean"), weights.pop("factor")
            network.load_state_dict(weights, strict=True)
        except (KeyError, RuntimeError) as error:
            name = description["architecture"]["name"]
            raise RsaDataError(f"expected the weights of {name}: {error}") from error
        return cls(network, description, mean, factor, reference)

    def save(self, store: Store, folder: str) -> None:
        """Writes head.safetensors, then head.json: with it the head is complete."""
        # Old weights must never stand beside a new description, nor the other way round.
        store.delete(f"{folder}/head.json")
        tensors = {"mean": self.mean, "factor": self.factor, **self.network.state_dict()}
        if self.reference is not None:
            tensors["reference"] = torch.from_numpy(self.reference)
        tensors = {name: tensor.clone() for name, tensor in tensors.items()}
        store.write(f"{folder}/head.safetensors", to_safetensors(tensors))
        store.write(f"{folder}/head.json", to_json(self.description))

    @torch.inference_mode()
    def __call__(self, features: Any) -> tuple[Any, Any]:
        """Scale and shift of each row of features.

        features : numpy array or torch tensor of shape (n, dim), float16, float32 or float64: raw,
            as the head's encoder gives them.
        Returns scale (1/m per unit of relative depth) and shift (1/m), both positive, float32 of
        shape (n,), arrays or tensors as the features were. Raises RsaDataError for another shape
        or dtype and for features that are not finite.
        """
        x = torch.as_tensor(np.array(features) if isinstance(features, np.ndarray) else features)
        if x.ndim != 2 or x.shape[1] != self.dim:
            raise RsaDataError(
                f"features: expected shape (n, {self.dim}), as this head was trained on "
                f"{self.description['features'].get('encoder', 'features of that size')}; found "
                f"{tuple(x.shape)}"
            )
        if not x.is_floating_point():
            raise RsaDataError(
                f"features: expected float16, float32 or float64; found {str(x.dtype)[6:]}"
            )
        pairs = [self._forward(batch) for batch in x.split(_BATCH)]
        scale, shift = (torch.cat(column) for column in zip(*pairs, strict=True))  # (n,), (n,)
        if isinstance(features, np.ndarray):
            return scale.numpy(), shift.numpy()
        return scale.to(features.device), shift.to(features.device)

    def _forward(self, batch: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        batch = batch.float().cpu()
        if len(bad := (~batch.isfinite().all(1)).nonzero()):
            raise RsaDataError(
                f"features: expected finite numbers; found nan or inf in {len(bad)} rows of "
                f"{len(batch)}, the first is row {int(bad[0])}"
            )
        return self.network((batch - self.mean) * self.factor)

    def predict(self, captions: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Scale and shift of each caption, float32 (n,), by the encoder the head was trained on.

        Raises RsaDataError when that encoder's weights are not at hand, or are not the same file.
        """
        from .belong import encode

        return self(encode(self.description["features"], captions))


def build_network(architecture: dict[str, Any], dim: int) -> torch.nn.Module:
    """A fresh network: `architecture` holds its registry name and its own options."""
    options = {key: value for key, value in architecture.items() if key != "name"}
    build = resolve("head", HEADS, architecture["name"])
    try:
        return build(dim, **options)
    except (TypeError, ValueError, ArithmeticError, RuntimeError, AssertionError) as error:
        raise RsaDataError(f"head {architecture['name']} with {options}: {error}") from error
