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

    Returns that folder and the head's description. A head that is there already is left as it is.
    """
    head = ScaleHead.load(file)
    folder = head_folder(name or file.stem)
    if work.store.size(f"{folder}/head.json") is not None:
        raise RsaDataError(
            f"{work.store.location}/{folder}: there is a head of this name already; it was left "
            "as it is. Give another --name"
        )
    head.save(work.store, folder)
    return f"{work.store.location}/{folder}", head.description
