"""The files of models: found in the cache, or downloaded and checked against their card."""

import hashlib
import math
import socket
import urllib.parse
import urllib.request
from pathlib import Path

from . import bounded, http
from .cards import Card, card_path, read_card
from .digests import read_sha256
from .errors import RsaDataError
from .files import cache_folder, replacing
from .units import size

# Option that takes the file of a model, by the kind of its card.
OPTIONS = {
    "segments": "--segmenter-weights",
    "relative-depth": "--depth-weights",
    "text-encoder": "--encoder-weights",
    "head": "--head",
}


class MissingFile(RsaDataError):
    """A model's file that is not on this machine and cannot be had.

    option : of the command that takes the file; None where that command takes none.
    reason : why the download failed; None where the card names no download.
    line : the file as an entry of a list: size, address, where to put it.
    """

    def __init__(self, card: Card, own: Path, option: str | None, reason: object):
        self.card, self.reason = card, reason
        digest = f"sha256 {card.sha256}" if card.sha256 else ""
        about = f" ({told})" if (told := ", ".join(filter(None, [_size(card), digest]))) else ""
        place = f"put it at {own}" + (f", or give it as {option} FILE" if option else "")
        kind = f"{card.kind}, " if card.kind else ""
        where = _address(card) or card.source or "a file of your own"
        checksum = f", {digest}" if digest else ""
        if _address(card) and card.source:
            place += f" ({card.source})"
        known = f"{kind}{_size(card) or 'size not known'}{checksum}"
        self.line = f"{card.name} ({known}): {where}; {place}"
        if reason is None:
            option = option or OPTIONS.get(card.kind or "")
            given = f"give it as {option} FILE, or put it at {own}" if option else place
            text = f"model {card.name}: its file is not downloaded for you; it is {where}: {given}"
        else:
            text = (
                f"model {card.name}: its file is not on this machine and the download failed: "
                f"{reason}\nWay out: get {where}{about} where there is a network, and {place}"
            )
        super().__init__(text)


def _size(card: Card) -> str:
    return size(card.bytes) if card.bytes else ""


def fetch(name: str, option: str = "--encoder-weights") -> Path:
    """The file of the shipped model `name`: from the cache, or downloaded and checked."""
    return local_file(read_card(card_path(name)), option=option)


def local_file(card: Card, given: Path | None = None, option: str | None = "--weights") -> Path:
    """The model's file on this machine.

    given : a file of the user's own, taken as it is; otherwise the cache, then the download.
    option : the option of the command that takes such a file, for messages; None: there is none.
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
    if card.hub:
        return _from_hub(card, own, option)
    if card.url:
        _download(card, own, option)
        return own
    raise MissingFile(card, own, option, None)


def with_data(name: str, path: Path) -> dict[str, Path]:
    """An ONNX file under a name, and what it leaves out: the usual names of Hugging Face, torch."""
    outside = {suffix: path.with_name(path.name + suffix) for suffix in ("_data", ".data")}
    return {name: path} | {f"{name}{s}": data for s, data in outside.items() if data.is_file()}


def found(card: Card) -> Path | None:
    """The model's file if it is on this machine, unchecked; nothing is downloaded."""
    own = cached_path(card)
    if own.is_file():
        return own
    if not card.hub or not card.file:
        return None
    from huggingface_hub import try_to_load_from_cache

    path = try_to_load_from_cache(card.hub, card.file, revision=card.revision)
    return Path(path) if isinstance(path, str) else None


def cached_path(card: Card) -> Path:
    """Where a model's file lies once it was downloaded from a URL or put there by hand."""
    version = (card.sha256 or card.revision or "any")[:16]
    file = Path(card.file or card.url or f"{card.name}.onnx").name
    return cache_folder("models") / f"{card.name}-{version}" / file


def _address(card: Card) -> str:
    if card.url or not card.hub:
        return card.url or ""
    return f"https://huggingface.co/{card.hub}/resolve/{card.revision or 'main'}/{card.file}"


def _checked(card: Card, path: Path, option: str | None) -> Path:
    if (wanted := card.sha256) and (found := read_sha256(path)) != wanted:
        raise RsaDataError(
            f"model {card.name}: expected sha256 {wanted} of {path}; found {found}. "
            "Delete that file and run again"
            + (f", or give another as {option} FILE" if option else "")
        )
    return path


def _from_hub(card: Card, own: Path, option: str | None) -> Path:
    from huggingface_hub import constants, hf_hub_download
    from huggingface_hub.errors import LocalEntryNotFoundError

    assert card.hub and card.file
    where, revision = (card.hub, card.file), card.revision
    try:
        path = hf_hub_download(*where, revision=revision, local_files_only=True)
    except LocalEntryNotFoundError:
        try:
            _resolve_host(constants.ENDPOINT)
            path = hf_hub_download(*where, revision=revision)
        # The layers below (HTTP, Xet, the disk) raise errors of many unrelated kinds.
        except Exception as error:
            reason = str(error).strip().splitlines()
            told = reason[0] if reason else type(error).__name__
            raise MissingFile(card, own, option, told) from error
    return _checked(card, Path(path), option)


def _resolve_host(address: str) -> None:
    """Fails at once where there is no network; the hub's client would retry for half a minute."""
    if not urllib.request.getproxies():
        host = urllib.parse.urlsplit(address)
        try:
            socket.getaddrinfo(host.hostname, host.port or 443)
        except socket.gaierror as error:
            raise OSError(f"cannot resolve {host.hostname}") from error


def _download(card: Card, own: Path, option: str | None) -> None:
    """Fetches the card's url to `own`, which appears only whole and with the right checksum."""
    from urllib3.exceptions import HTTPError

    try:
        download(
            card.url or "", own, most=card.bytes, sha256=card.sha256, where=f"model {card.name}"
        )
    except (OSError, ValueError, HTTPError) as error:
        raise MissingFile(card, own, option, http.reason(error)) from error


def download(
    url: str,
    own: Path,
    *,
    most: int | None = None,
    sha256: str | None = None,
    where: str = "download",
) -> Path:
    """Fetches a url to `own`, which appears only whole, and with the right checksum if known.

    most : bytes that are taken at most, beside the limit `model` of common.bounded. where : begins
    the messages. Raises RsaDataError for another kind of address, too many bytes or another
    checksum; OSError, ValueError or urllib3's HTTPError where the transport fails, or does not end
    within the limit `download`.
    """
    if not url.startswith(("https://", "http://")):
        raise RsaDataError(f"{where}: expected an http(s) url; found {url!r}")
    sha = hashlib.sha256()
    most = int(min(bounded.limit("model"), most or math.inf))
    seconds = bounded.limit("download")
    with replacing(own, durable=True) as file, http.deadline(seconds):
        answer = http.client(url, tries=3).request(
            "GET", url, preload_content=False, enforce_content_length=False
        )
        if answer.status != 200:
            raise OSError(f"HTTP Error {answer.status}: {answer.reason}")
        for block in answer.stream(1 << 20, decode_content=False):
            sha.update(block)
            file.write(block)
            if file.tell() > most:
                raise RsaDataError(f"{where}: expected at most {most:,} bytes of {url}")
        length, expected = file.tell(), answer.headers.get("Content-Length")
        if expected is not None and length != int(expected):
            raise ValueError(f"expected {expected} bytes, got {length}")
        if sha256 is not None and sha.hexdigest() != sha256:
            raise RsaDataError(
                f"{where}: expected sha256 {sha256} of {url}; found {sha.hexdigest()}: nothing was "
                "kept"
            )
    return own
