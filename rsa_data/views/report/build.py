"""`report`: puts the sections together into one file."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

from ...common import files as whole_files
from ...common import svg
from ...common.errors import RsaDataError, UsageError
from ...common.html import Html, join, tag
from ...common.ranges import Positive
from ...common.units import size
from ...store.outputs import check_output
from ...store.tables import WorkDir
from .features_map import meaning
from .gallery import gallery
from .lineage import head_names, lineage
from .training import heads
from .words import content


@dataclass(frozen=True)
class Report:
    """Where the page lies, and what a terminal says of it."""

    path: Path
    summary: str


def report(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    out: Path = Path("report.html"),
    samples: Positive = 48,
    head: str | None = None,
) -> Report:
    """Writes one HTML file that shows what a work dir holds; it needs no server and no network.

    Everything comes from the tables; pictures from the datasets' files, where they are at hand.

    Parameters
    ----------
    out : file to write.
    samples : about how many samples the gallery shows, over all datasets.
    head : whose predictions the gallery shows; by default one trained on the dataset shown.
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--out {out}: expected a name that ends in .html")
    check_output(out, "--out")
    if not work.datasets():
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    if head is not None and head not in head_names(work):
        raise UsageError(
            f"report: head {head!r}: expected one of {', '.join(head_names(work)) or 'none yet'}"
        )
    sections = [
        lineage(work), gallery(work, samples, head, bar), content(work), meaning(work), heads(work)
    ]  # fmt: skip
    data = page(work, sections).encode()
    try:
        whole_files.write(out, data)
    except OSError as error:
        raise RsaDataError(f"--out {out}: cannot be written: {error.strerror or error}") from error
    return Report(out, f"report of {work.store.location}: {size(len(data))}\n  in {out}")


_CONTENTS = {
    "run": "What was run",
    "samples": "Samples",
    "segments": "Segments",
    "captions": "Captions",
    "features": "Features, scale and shift",
    "heads": "Heads",
}


def page(work: WorkDir, sections: list[Html]) -> Html:
    """The whole document."""
    name = work.store.location.rstrip("/").rpartition("/")[2]
    here = files("rsa_data.views.report")
    style, script = (Html(here.joinpath(f"page.{kind}").read_text("utf-8")) for kind in
                     ("css", "js"))  # fmt: skip
    links = [tag("a", words, href=f"#{place}") for place, words in _CONTENTS.items()]
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    head = tag(
        "head", tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"rsa-data: {name}"), tag("style", Html(svg.style() + style)),
    )  # fmt: skip
    body = tag(
        "body",
        tag("header", tag("h1", f"rsa-data: {name}"),
            tag("p", f"{_count(work.datasets(), 'dataset')}, {_count(head_names(work), 'head')}; "
                f"written {made}."),
            tag("nav", links, aria_label="Sections")),
        tag("main", sections), tag("script", script),
    )  # fmt: skip
    return join([Html("<!DOCTYPE html>\n"), tag("html", head, body, lang="en")])


def _count(things: list[str], word: str) -> str:
    return f"{len(things)} {word}" + ("" if len(things) == 1 else "s")
