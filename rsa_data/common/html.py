"""HTML as nested function calls: every text is escaped unless it was made here."""

import base64
import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

_VOID = ("img", "input", "meta", "br")


class Html(str):
    """Text that is HTML already. Whatever is not of this class gets escaped."""


def text(value: Any) -> str:
    """A value as HTML: escaped, a lone surrogate replaced, None as nothing."""
    if isinstance(value, Html):
        return value
    plain = "" if value is None else str(value)
    return escape(plain.encode("utf-8", "replace").decode())


def tag(element: str, /, *children: Any, **attributes: Any) -> Html:
    """An element. `class_` is class, `data_scene` is data-scene; None and False are left out."""
    written = "".join(
        f" {key.rstrip('_').replace('_', '-')}"
        + ("" if value is True else f'="{text(str(value))}"')
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if element in _VOID:
        return Html(f"<{element}{written}>")
    return Html(f"<{element}{written}>{join(children)}</{element}>")


def join(children: Iterable[Any], between: str = "") -> Html:
    """Children one after the other; lists are flattened."""
    flat = [join(c) if isinstance(c, (list, tuple)) else text(c) for c in children]
    return Html(between.join(flat))


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> Html:
    """A table that scrolls by itself where it is too wide; numbers stand to the right."""
    numeric = [
        bool(rows) and all(_is_number(row[k]) for row in rows if row[k] not in (None, ""))
        for k in range(len(header))
    ]
    kinds = ["number" if n else None for n in numeric]
    head = tag(
        "tr", [tag("th", h, scope="col", class_=k) for h, k in zip(header, kinds, strict=True)]
    )
    body = [
        tag("tr", [tag("td", c, class_=k) for c, k in zip(row, kinds, strict=True)]) for row in rows
    ]
    inner = tag(
        "table", tag("caption", caption) if caption else "", tag("thead", head), tag("tbody", body)
    )
    return tag(
        "div", inner, class_="scroll", tabindex="0", role="region", aria_label=caption or "table"
    )


def _is_number(cell: Any) -> bool:
    return str(cell)[:1].isdigit() or str(cell)[:2] in ("-0", "-.") or cell == "-"


def picture(pixels: np.ndarray, alt: str, width: int, quality: int = 72) -> Html:
    """An image within the page. pixels : uint8 (h, w, 3), RGB; width : px, not enlarged."""
    import io

    from PIL import Image

    image = Image.fromarray(pixels)
    if image.width > width:
        image = image.resize(
            (width, max(1, round(width * image.height / image.width))), Image.Resampling.LANCZOS
        )
    file = io.BytesIO()
    image.save(file, "JPEG", quality=quality, optimize=True)
    data = base64.b64encode(file.getvalue()).decode()
    return tag(
        "img", src=f"data:image/jpeg;base64,{data}", alt=alt, width=image.width,
        height=image.height, decoding="async",
    )  # fmt: skip


def value(found: Any) -> str:
    """An option's value as a person reads it."""
    return found if isinstance(found, str) else json.dumps(found, ensure_ascii=False)
