"""A trained head, on disk as head.safetensors and head.json: features in, scale and shift out."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import msgspec
import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as from_safetensors
from safetensors.torch import save as to_safetensors

from ..common import calls
from ..common.errors import RsaDataError, UsageError
from ..registry import HEADS, resolve
from ..store.encoding import to_json
from ..store.stores import Store, open_store
from . import description as forms
from .architectures.layers import Head
from .description import FORMAT as FORMAT
from .description import MAX_BYTES, Description
from .released import read_released

_BATCH = 4096
_Form = dict[str, tuple[tuple[int, ...], torch.dtype]]


class ScaleHead:
    """Turns features of a scene into the scale and shift that make its relative depth metric.

    network : the architecture, a module from standardised features (n, dim) to scale and shift.
    description : head.json, typed or plain; `features.dim`, `architecture`, `format` are needed.
    mean, factor : float32 (dim,); the network is given (features - mean) * factor of raw features.
    reference : float16 (m, dim), raw features of training captions; None where not known.

    Raises RsaDataError when one of these does not fit the others or is not finite.
    """

    def __init__(
        self,
        network: torch.nn.Module,
        description: Description | dict[str, Any],
        mean: torch.Tensor,
        factor: torch.Tensor,
        reference: np.ndarray | None = None,
    ):
        self.about = forms.of(description) if isinstance(description, dict) else description
        self.network = network.eval().requires_grad_(False)
        self.mean, self.factor, self.reference = mean, factor, reference
        self.dim = self.about.features.dim
        held: dict[str, torch.Tensor] = {"mean": mean, "factor": factor}
        expected: _Form = dict.fromkeys(held, ((self.dim,), torch.float32))
        if reference is not None:
            held["reference"] = torch.from_numpy(reference)
            expected["reference"] = ((len(reference), self.dim), torch.float16)
        _compare(expected, held, "a head")

    @property
    def description(self) -> dict[str, Any]:
        """head.json as plain values."""
        return self.about.plain()

    @classmethod
    def load(cls, path: str | Path) -> "ScaleHead":
        """The head in the folder `path` (WORK/heads/NAME), or in a released RSA checkpoint file.

        Raises RsaDataError when there is none, when it is broken, or when its weights are not
        exactly those that head.json speaks of.
        """
        calls.path("ScaleHead.load", path)
        if "://" not in str(path) and (Path(path).is_file() or str(path).endswith((".pt", ".pth"))):
            tensors, known = read_released(Path(path))
            try:
                return cls.from_tensors(tensors, known)
            except RsaDataError as error:
                raise RsaDataError(f"{path}: {error}") from error
        store = open_store(path)
        text = store.read("head.json")
        if text is None:
            raise RsaDataError(
                f"{path}: expected a head (head.json and head.safetensors); found no head.json. "
                "`rsa-data train-head` writes one to WORK/heads/NAME."
            )
        about = forms.read(text, f"{path}/head.json")
        about.check_digest(f"{path}/head.json")
        where = f"{path}/head.safetensors"
        size = store.size("head.safetensors")
        if size is None or size > MAX_BYTES:
            found = "none" if size is None else f"{size:,} bytes"
            raise RsaDataError(
                f"{where}: broken or not of this head: expected a file of at most {MAX_BYTES:,} "
                f"bytes; found {found}"
            )
        data = store.read("head.safetensors") or b""
        digest = hashlib.sha256(data).hexdigest()
        if about.weights and about.weights != digest:
            raise RsaDataError(
                f"{where}: broken or not of this head: expected sha256 {about.weights}, as "
                f"head.json says; found {digest}"
            )
        try:
            return cls.from_tensors(from_safetensors(data), about)
        except (SafetensorError, RsaDataError, KeyError, TypeError) as error:
            raise RsaDataError(f"{where}: broken or not of this head: {error}") from error

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, torch.Tensor], description: Description | dict[str, Any]
    ) -> "ScaleHead":
        """The head of these weights; raises RsaDataError unless they fit exactly."""
        about = forms.of(description) if isinstance(description, dict) else description
        weights = dict(tensors)
        reference = weights.pop("reference", None)
        if not {"mean", "factor"} <= weights.keys():
            raise RsaDataError(f"expected the weights of {about.name}, mean and factor among them")
        mean, factor = weights.pop("mean"), weights.pop("factor")
        # Without memory, to be compared before anything is built.
        with torch.device("meta"):
            network = build_network(about.architecture, about.features.dim)
        expected = {n: (tuple(t.shape), t.dtype) for n, t in network.state_dict().items()}
        _compare(expected, weights, about.name)
        network.load_state_dict(weights, assign=True)
        if reference is not None and reference.dtype != torch.float16:
            raise RsaDataError(f"reference: expected float16; found {str(reference.dtype)[6:]}")
        return cls(network, about, mean, factor, None if reference is None else reference.numpy())

    def weights(self) -> bytes:
        """head.safetensors."""
        tensors = {"mean": self.mean, "factor": self.factor, **self.network.state_dict()}
        if self.reference is not None:
            tensors["reference"] = torch.from_numpy(self.reference)
        return to_safetensors({name: tensor.clone() for name, tensor in tensors.items()})

    def files(self) -> dict[str, bytes]:
        """What a head's folder holds; head.json last, with the sha256 of the weights in it."""
        weights = self.weights()
        about = msgspec.structs.replace(self.about, weights=hashlib.sha256(weights).hexdigest())
        return {"head.safetensors": weights, "head.json": to_json(about.sealed().plain())}

    def save(self, store: Store, folder: str) -> None:
        """Writes head.safetensors, then head.json: with it the head is complete."""
        # Old weights must never stand beside a new description, nor the other way round.
        store.delete(f"{folder}/head.json")
        for name, content in self.files().items():
            store.write(f"{folder}/{name}", content)

    @overload
    def __call__(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
    @overload
    def __call__(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]: ...

    def __call__(self, features: Any) -> tuple[Any, Any]:
        """Scale and shift of each row of features.

        features : numpy array or torch tensor of shape (n, dim), float16, float32 or float64: raw,
            as the head's encoder gives them.
        Returns scale (1/m per unit of relative depth) and shift (1/m), both positive, float32 of
        shape (n,), arrays or tensors as the features were. Raises RsaDataError for another shape
        or dtype and for features, scales or shifts that are not finite.
        """
        scale, shift = self.outputs(features)
        finite = np.isfinite(np.stack([np.asarray(scale), np.asarray(shift)])).all(0)
        if not finite.all():
            raise RsaDataError(
                f"head {self.about.name}: expected a finite scale and shift; found "
                f"{int((~finite).sum())} of {len(finite)} rows that are not, the first is row "
                f"{int(np.argmin(finite))}: its weights or these features are damaged"
            )
        return scale, shift

    @torch.inference_mode()
    def outputs(self, features: Any) -> tuple[Any, Any]:
        """A call without the check that scale and shift are finite."""
        x = torch.from_numpy(np.array(features)) if isinstance(features, np.ndarray) else features
        if not isinstance(x, torch.Tensor):
            raise UsageError(f"features: expected an array; found {type(features).__name__}")
        fits = getattr(self.network, "fits", lambda columns, dim: columns == dim)
        if x.ndim != 2 or not fits(x.shape[1], self.dim):
            raise RsaDataError(
                f"features: expected shape (n, {self.dim}), as this head was trained on "
                f"{self.about.features.encoder or 'features of that size'}; found {tuple(x.shape)}"
            )
        if not x.is_floating_point():
            raise RsaDataError(
                f"features: expected float16, float32 or float64; found {str(x.dtype)[6:]}"
            )
        pairs = [self._forward(batch) for batch in torch.split(x, _BATCH)]
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
        if isinstance(self.network, Head):
            batch = self.network.centred(batch, self.mean, self.factor)
        else:
            batch = (batch - self.mean) * self.factor
        scale, shift = self.network(batch)
        return scale, shift

    @calls.in_python
    def predict(self, captions: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Scale and shift of each caption, float32 (n,), by the encoder the head was trained on.

        Raises RsaDataError when that encoder's weights are not at hand, or are not the same file.
        """
        from .reading import encode

        return self(encode(self.about.features, calls.texts("ScaleHead.predict", captions)))


def build_network(architecture: Mapping[str, Any], dim: int) -> Head:
    """A fresh network: `architecture` holds its registry name and its own options."""
    options = {key: value for key, value in architecture.items() if key != "name"}
    build = resolve("head", HEADS, architecture["name"])
    try:
        network: Head = build(dim, **options)
    except (TypeError, ValueError, ArithmeticError, RuntimeError, AssertionError) as error:
        raise RsaDataError(f"head {architecture['name']} with {options}: {error}") from error
    return network


def _compare(
    expected: Mapping[str, tuple[tuple[int, ...], torch.dtype]],
    found: Mapping[str, torch.Tensor],
    name: str,
) -> None:
    """Raises RsaDataError unless names, shapes and dtypes are the same and all numbers finite."""
    if missing := sorted(expected.keys() ^ found.keys()):
        raise RsaDataError(
            f"expected the weights of {name}: {', '.join(sorted(expected))}; "
            f"missing or too many: {', '.join(missing)}"
        )
    for key, (shape, dtype) in expected.items():
        tensor = found[key]
        if (tuple(tensor.shape), tensor.dtype) != (shape, dtype):
            raise RsaDataError(
                f"expected the weights of {name}: {key} as {str(dtype)[6:]} {shape}; found "
                f"{str(tensor.dtype)[6:]} {tuple(tensor.shape)}"
            )
        if not tensor.isfinite().all():
            raise RsaDataError(f"expected finite weights of {name}; found nan or inf in {key}")
