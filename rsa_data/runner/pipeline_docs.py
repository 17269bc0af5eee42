"""What the shipped pipeline files are for; imports nothing of what they run."""

import tomllib

from ..common.files import shipped


def described() -> list[tuple[str, str]]:
    """(name, first sentence of doc) of every pipeline file that is shipped."""
    files = sorted(shipped("pipelines").glob("*.toml"))
    docs = [tomllib.loads(file.read_text("utf-8")).get("doc", "") for file in files]
    return [
        (f.stem, " ".join(d.split()).partition(". ")[0]) for f, d in zip(files, docs, strict=True)
    ]
