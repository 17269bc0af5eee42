"""Whether the heads of a work dir are whole: what `rsa-data verify` asks of this room."""

import hashlib

import msgspec

from ..common.errors import RsaDataError
from ..store.tables import WorkDir, fingerprint
from .checkpoint import ScaleHead
from .description import Description
from .train.plan import Described


def problems(work: WorkDir, name: str) -> list[str]:
    """What is wrong with a head, a sentence each; nothing when all is well.

    The head is loaded, which compares its weights with the sha256, names, shapes and dtypes in
    head.json; its history is compared with its sha256, and the training it came from with the
    description of its folder.
    """
    place = f"{work.store.location}/heads/{name}"
    try:
        about = ScaleHead.load(place).about
    except RsaDataError as error:
        return [str(error)]
    found = []
    for check in (_history, _training):
        try:
            found += check(work, name, about)
        except RsaDataError as error:
            found.append(str(error))
    return found


def _history(work: WorkDir, name: str, about: Description) -> list[str]:
    if not about.history:
        return []  # version 0.1, or imported
    path = f"heads/{name}/history.parquet"
    data = work.store.read(path)
    if data is None:
        return [f"{path}: expected the history of the training; found none"]
    found = hashlib.sha256(data).hexdigest()
    return [] if found == about.history else [f"{path}: damaged: its sha256 is not head.json's"]


def _training(work: WorkDir, name: str, about: Description) -> list[str]:
    table = work.table("heads", name)
    if not about.training:
        return []
    if not table.exists():
        return [f"{table}: expected the description of its training; found none"]
    described = table.described(Described)
    if fingerprint(msgspec.to_builtins(described)) == about.training:
        return []
    return [f"{table}: head.json is of another training than the description beside it"]
