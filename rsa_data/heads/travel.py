"""Heads that travel: export-head, and heads from files and addresses.

A head is written as one safetensors file, whose metadata holds head.json and the model card, or as
a folder of head.safetensors, head.json and README.md, as a repository of the Hugging Face hub. Both
are data: tensors, JSON and Markdown. The architecture is a name of the registry.
"""

import hashlib
import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common import bounded, http
from ..common.errors import RsaDataError, UsageError
from ..common.files import appearing, write
from ..common.model_files import download
from ..store.outputs import check_output
from ..store.table_names import head_folder
from ..store.tables import WorkDir, to_json
from .card import model_card
from .description import MAX_BYTES

if TYPE_CHECKING:
    from .checkpoint import ScaleHead

_WEIGHTS, _CARD, _JSON = "head.safetensors", "README.md", "head.json"


def export_head(work: WorkDir, name: str, place: Path) -> list[Path]:
    """Writes a head of the work dir to take elsewhere, with its model card.

    place : a file NAME.safetensors, or else a folder.
    Returns the files written; the same head may lie there already. Raises RsaDataError when there
    is no such head, UsageError when the place is taken by something else or kept by a work dir.
    """
    from safetensors.torch import load, save

    from .checkpoint import ScaleHead

    single = place.suffix == ".safetensors"
    if not single:
        _check_folder(place)
    check_output(place, folder=not single)
    folder = f"{work.store.location}/{head_folder(name)}"
    head = ScaleHead.load(folder)
    data = work.store.read(f"heads/{name}/head.safetensors") or b""
    about = {**head.description, "weights": hashlib.sha256(data).hexdigest()}
    card = model_card(name, about, work)
    files = {_WEIGHTS: data, _CARD: card.encode(), _JSON: to_json(about)}
    if single:
        metadata = {_JSON: json.dumps(about), _CARD: card}
        files = {"": save(load(data), metadata)}
    _write(place, files)
    return [place / file for file in files]


def _check_folder(place: Path) -> None:
    """Raises UsageError for a file, and for a folder with a README or so that is no head's."""
    taken = place.exists() and not place.is_dir()
    if not (place / _WEIGHTS).exists():
        taken = taken or (place / _CARD).exists() or (place / _JSON).exists()
    if taken:
        raise UsageError(f"{place}: expected a new folder, or a name that ends in .safetensors")


def _write(place: Path, files: dict[str, bytes]) -> None:
    """Writes a file, or a folder at once; nothing where these very bytes lie there already."""
    try:
        there = place.is_file() or (place.is_dir() and any(place.iterdir()))
        if there and any(_bytes(place / file) != data for file, data in files.items()):
            raise UsageError(
                f"{place}: expected a new folder, or a name that ends in .safetensors and is not "
                "there yet; found something else there. Delete it, or choose another name"
            )
        if there:
            return
        if "" in files:
            write(place, files[""])
        else:
            with appearing(place) as unfinished:
                for file, data in files.items():
                    write(unfinished / file, data)
    except OSError as error:
        raise RsaDataError(f"{place}: cannot be written: {error.strerror or error}") from error


def _bytes(path: Path) -> bytes | None:
    return bounded.read(path, "record") if path.is_file() else None


def from_file(path: Path) -> "ScaleHead":
    """A head from a file that `export_head` wrote, or from a released RSA checkpoint."""
    from safetensors import SafetensorError

    from .checkpoint import ScaleHead

    try:
        bounded.check_file(path)  # a pipe would be waited for
        if (size := path.stat().st_size) > MAX_BYTES:
            raise RsaDataError(f"{path}: expected a head of at most {MAX_BYTES:,} bytes: {size:,}")
        with path.open("rb") as file:
            start = file.read(9)
    except OSError as error:
        raise RsaDataError(f"{path}: cannot be read: {error.strerror or error}") from error
    # safetensors begins with the length of its JSON header; a PyTorch file is a ZIP or a pickle.
    if start[8:9] != b"{":
        try:
            return ScaleHead.load(path)
        except SafetensorError as error:
            raise RsaDataError(f"{path}: expected a head; found {error}") from error
    return _from_bytes(path.read_bytes(), str(path))


def _from_bytes(data: bytes, where: str) -> "ScaleHead":
    from safetensors import SafetensorError
    from safetensors.torch import load, save

    from .checkpoint import ScaleHead
    from .description import read

    try:
        tensors = load(data)
        length = int.from_bytes(data[:8], "little")
        metadata = json.loads(data[8 : 8 + length]).get("__metadata__") or {}
    except (SafetensorError, ValueError, RecursionError) as error:
        raise RsaDataError(f"{where}: expected a head as safetensors; found: {error}") from error
    if _JSON not in metadata:
        raise RsaDataError(
            f"{where}: expected a file of `rsa-data export-head`; its metadata holds no {_JSON}"
        )
    about = read(metadata[_JSON].encode(), where)
    checked(about.plain(), where)
    about.check_digest(where)
    # The sha256 in it is that of head.safetensors, which has no metadata.
    if about.weights and hashlib.sha256(save(tensors)).hexdigest() != about.weights:
        raise RsaDataError(f"{where}: damaged: its weights are not those of its description")
    try:
        return ScaleHead.from_tensors(tensors, about)
    except RsaDataError as error:
        raise RsaDataError(f"{where}: {error}") from error


def checked(about: dict[str, Any], where: str) -> dict[str, Any]:
    """A description from elsewhere; its architecture must be one of the registry's own names."""
    from ..registry import HEADS

    name = about["architecture"]["name"]
    if name not in HEADS:
        raise RsaDataError(
            f"{where}: expected an architecture of this version; found {name!r}. Code is never "
            "loaded because a file asks for it"
        )
    return about


def from_address(address: str) -> "ScaleHead":
    """A head from https://..., a file of `export-head`, or hf://OWNER/NAME[@REVISION]."""
    from urllib3.exceptions import HTTPError

    kind, _, rest = address.partition("://")
    if kind == "hf":
        return _from_hub(rest)
    if kind not in ("https", "http"):
        raise UsageError(f"--head {address}: expected https://... or hf://OWNER/NAME")
    if "@" in rest.partition("/")[0]:
        raise UsageError("--head: expected an address without a user's name or password in it")
    with tempfile.TemporaryDirectory() as folder:
        try:
            file = download(address, Path(folder) / "head", most=MAX_BYTES, where="--head")
        except (OSError, ValueError, HTTPError) as error:
            told = f"--head {address}: cannot be fetched: {http.reason(error)}"
            raise RsaDataError(told) from error
        try:
            return from_file(file)
        except RsaDataError as error:  # the file is gone when this is read
            raise RsaDataError(str(error).replace(str(file), f"--head {address}")) from error


def _from_hub(rest: str) -> "ScaleHead":
    from huggingface_hub import hf_hub_download

    from .checkpoint import ScaleHead
    from .description import parse

    name, _, revision = rest.partition("@")
    if name.count("/") != 1 or not all(name.split("/")):
        raise UsageError(
            f"--head hf://{rest}: expected hf://OWNER/NAME or hf://OWNER/NAME@REVISION"
        )
    try:
        paths = {
            file: Path(hf_hub_download(name, file, revision=revision or None))
            for file in ("head.json", "head.safetensors")
        }
    # Hub and network libraries raise errors of many kinds.
    except Exception as error:
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise RsaDataError(f"--head hf://{rest}: cannot be fetched: {reason}") from error
    checked(parse(paths["head.json"].read_bytes(), f"hf://{rest}/head.json"), f"hf://{rest}")
    return ScaleHead.load(paths["head.json"].parent)
