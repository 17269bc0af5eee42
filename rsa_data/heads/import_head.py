"""import-head: a released checkpoint becomes a head of a work dir."""

from pathlib import Path
from typing import Any

from ..common.errors import RsaDataError
from ..store.table_names import head_folder
from ..store.tables import WorkDir
from .checkpoint import ScaleHead


def import_head(
    work: WorkDir, file: Path, *, name: str | None = None
) -> tuple[str, dict[str, Any]]:
    """Reads a released checkpoint and writes it as a head of a work dir.

    Parameters
    ----------
    name : folder of the head below WORK/heads; the file's name without its ending by default.

    Returns that folder and the head's description. A head that is there already is left as it is;
    raises RsaDataError when it is another one.
    """
    head = ScaleHead.load(file)
    folder = head_folder(name or file.stem)
    there = work.store.read(f"{folder}/head.json")
    if there is not None and there == head.files()["head.json"]:
        return f"{work.store.location}/{folder}", ScaleHead.load(
            f"{work.store.location}/{folder}"
        ).description
    if there is not None or work.table("heads", folder.rpartition("/")[2]).exists():
        raise RsaDataError(
            f"{work.store.location}/{folder}: there is a head of this name already, or a training; "
            "it was left as it is. Give another --name"
        )
    head.save(work.store, folder)
    return f"{work.store.location}/{folder}", head.description
