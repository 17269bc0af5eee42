"""Model cards (what a model is, as data), their files (cache, download, checksum), ONNX sessions.

A card is one TOML file. Every card has `kind` (segments, relative-depth, text-encoder) and
`licence`; `about` says what it is in a line, and `tested = true` that the project ran it with its
real weights. Where its file comes from is `hub`, `file` and `revision` (Hugging Face), or `url`;
what the file must be is `sha256`. A card without a source is for a file that the user has. The
other keys belong to the code of that kind.
"""

import hashlib
import os
import socket
import tempfile
import tomllib
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from . import forms, onnx_external
from .errors import RsaDataError, UsageError, unknown

if TYPE_CHECKING:
    import onnxruntime

Card = dict[str, Any]
Device = Literal["auto", "cpu", "cuda"]

_TEXTS = {f"{key}?": "text" for key in ("kind", "licence", "about", "hub", "revision", "sha256")}
_TEXTS |= {"name": "a file's name", "file?": "a path", "url?": "a path"}
_CARDS = Path(__file__).parent / "model_cards"
_TIMEOUT = 30.0  # seconds without an answer


def names(kind: str) -> list[str]:
    """The names of the shipped cards of a kind."""
    return [p.stem for p in sorted(_CARDS.glob("*.toml")) if read_card(p).get("kind") == kind]


def about(name: str) -> str | None:
    """What a shipped card says of its model, with the licence; None where there is nothing."""
    path = _CARDS / f"{name}.toml"
    card = read_card(path) if path.is_file() else {}
    if "about" not in card:
        return None
    tested = "" if card.get("tested") else "; not yet run with its real weights"
    return f"{card['about']}; {card['licence']}{tested}"


def card_path(name: str) -> Path:
    """The file of a shipped card; raises UsageError, with the nearest name, when there is none."""
    path = _CARDS / f"{name}.toml"
    if not path.is_file():
        raise unknown("model", name, (p.stem for p in _CARDS.glob("*.toml")))
    return path


def card_of(kind: str, name: str) -> Card:
    """The shipped card `name`; raises UsageError when there is none of that kind."""
    card = read_card(card_path(name))
    if card.get("kind") != kind:
        raise unknown(f"{kind} model", name, names(kind))
    return card


def read_card(path: Path) -> Card:
    """A card from its file, with `name` (the file's own unless it says another).

    Raises RsaDataError when the file is missing, is no TOML, or names a source that cannot be
    checked: a url needs a sha256, a hub file a revision or a sha256.
    """
    try:
        card = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RsaDataError(f"model card {path}: expected a TOML file; found: {error}") from error
    card = {"name": path.stem, **card}
    forms.check(card, _TEXTS, f"model card {path}")
    if "hub" in card and not ("file" in card and {"revision", "sha256"} & set(card)):
        raise RsaDataError(
            f"model card {path}: with hub = {card['hub']!r} expected file, and revision or sha256"
        )
    if "url" in card and "sha256" not in card:
        raise RsaDataError(f"model card {path}: with a url expected its sha256; found none")
    return card


def fetch(name: str) -> Path:
    """The file of the shipped model `name`: from the cache, or downloaded and checked."""
    return local_file(read_card(card_path(name)), option="--weights")


def local_file(card: Card, given: Path | None = None, option: str = "--weights") -> Path:
    """The model's file on this machine.

    given : a file of the user's own, taken as it is; otherwise the cache, then the download.
    Raises RsaDataError that names the file, where it comes from and where to put it, when it is
    not here and cannot be had, or when its bytes are not those that the card names.
    """
    if given is not None:
        if not given.is_file():
            raise RsaDataError(f"{option}: expected the model's file; there is none at {given}")
        return given
    own = cached_path(card)
    if own.is_file():
        return _checked(card, own, option)
    if "hub" in card:
        return _from_hub(card, own, option)
    if "url" in card:
        _download(card, own, option)
        return own
    raise RsaDataError(
        f"model {card['name']}: its card names no download; give the file with {option} FILE"
    )


def cached_path(card: Card) -> Path:
    """Where a model's file lies once it was downloaded from a URL or put there by hand."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    version = str(card.get("sha256") or card.get("revision", "any"))[:16]
    file = Path(card.get("file") or card.get("url") or f"{card['name']}.onnx").name
    return Path(base) / "rsa-data" / "models" / f"{card['name']}-{version}" / file


def _address(card: Card) -> str:
    if "url" in card:
        return card["url"]
    revision = card.get("revision", "main")
    return f"https://huggingface.co/{card['hub']}/resolve/{revision}/{card['file']}"


def _unavailable(card: Card, own: Path, option: str, reason: object) -> RsaDataError:
    checksum = f" (sha256 {card['sha256']})" if "sha256" in card else ""
    return RsaDataError(
        f"model {card['name']}: its file is not on this machine and the download failed: {reason}\n"
        f"Way out: get {_address(card)}{checksum} where there is a network, and put it at {own}, "
        f"or name it with {option} FILE" + (" of `rsa-data detect`" if option == "--model" else "")
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _checked(card: Card, path: Path, option: str) -> Path:
    if (wanted := card.get("sha256")) and (found := _sha256(path)) != wanted:
        raise RsaDataError(
            f"model {card['name']}: expected sha256 {wanted} of {path}; found {found}. "
            f"Delete that file and run again, or name another with {option} FILE"
        )
    return path


def _from_hub(card: Card, own: Path, option: str) -> Path:
    from huggingface_hub import constants, hf_hub_download
    from huggingface_hub.errors import LocalEntryNotFoundError

    where = (card["hub"], card["file"])
    revision = card.get("revision")
    try:
        path = hf_hub_download(*where, revision=revision, local_files_only=True)
    except LocalEntryNotFoundError:
        try:
            _resolve_host(constants.ENDPOINT)
            path = hf_hub_download(*where, revision=revision)
        # The layers below (HTTP, Xet, the disk) raise errors of many unrelated kinds.
        except Exception as error:
            reason = str(error).strip().splitlines()
            raise _unavailable(
                card, own, option, reason[0] if reason else type(error).__name__
            ) from error
    return _checked(card, Path(path), option)


def _resolve_host(address: str) -> None:
    """Fails at once where there is no network; the hub's client would retry for half a minute."""
    if not urllib.request.getproxies():
        host = urllib.parse.urlsplit(address)
        socket.getaddrinfo(host.hostname, host.port or 443)


def _download(card: Card, own: Path, option: str) -> None:
    """Fetches card["url"] to `own`, which appears only whole and with the right checksum."""
    url = card["url"]
    if not url.startswith(("https://", "http://")):
        raise RsaDataError(f"model {card['name']}: expected an http(s) url; found {url!r}")
    own.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=own.parent, prefix=".part-")
    sha = hashlib.sha256()
    try:
        with (
            os.fdopen(handle, "wb") as file,
            urllib.request.urlopen(url, timeout=_TIMEOUT) as answer,
        ):
            while block := answer.read(1 << 20):
                sha.update(block)
                file.write(block)
            size, expected = file.tell(), answer.headers.get("Content-Length")
            if expected is not None and size != int(expected):
                raise _unavailable(card, own, option, f"expected {expected} bytes, got {size}")
            file.flush()
            os.fsync(file.fileno())
        if sha.hexdigest() != card["sha256"]:
            raise RsaDataError(
                f"model {card['name']}: expected sha256 {card['sha256']} of {url}; "
                f"found {sha.hexdigest()}: nothing was kept"
            )
        Path(temporary).replace(own)
    except (OSError, ValueError, urllib.error.HTTPError) as error:
        raise _unavailable(card, own, option, error) from error
    finally:
        Path(temporary).unlink(missing_ok=True)


def open_session(
    path: Path, threads: int = 1, device: Device = "auto"
) -> "onnxruntime.InferenceSession":
    """An onnxruntime session on a model's file.

    threads : CPU threads inside an operator.
    device : auto takes CUDA when this onnxruntime was built with it, else the CPU.
    Raises RsaDataError when onnxruntime cannot open the file, UsageError for cuda without CUDA.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what matters is raised as well
    providers: list[Any] = ["CPUExecutionProvider"]
    available = "CUDAExecutionProvider" in onnxruntime.get_available_providers()
    if device == "cuda" and not available:
        raise UsageError(
            "device cuda: this onnxruntime has no CUDA; install onnxruntime-gpu in its place"
        )
    if available and device != "cpu":
        # Tuned algorithms and TF32 would give other bits from run to run.
        settings = {"cudnn_conv_algo_search": "DEFAULT", "use_tf32": "0"}
        providers.insert(0, ("CUDAExecutionProvider", settings))
    onnx_external.refuse(path)
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers)
    # onnxruntime's errors have no common base but Exception.
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        raise RsaDataError(
            f"{path}: expected an ONNX model that onnxruntime can run; found: {reason}"
        ) from error
