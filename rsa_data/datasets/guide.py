"""Where to get the datasets and how they must lie: data/README.md, which the wheel has too."""

import re

from ..common.files import shipped


def section(name: str) -> str:
    """What the page says of a dataset, as Markdown; empty for one of another package."""
    text = (shipped("data") / "README.md").read_text("utf-8")
    for title, body in re.findall(
        r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL
    ):
        if name in re.split(r" and | ", title):
            return str(body).strip() + "\n"
    return ""
