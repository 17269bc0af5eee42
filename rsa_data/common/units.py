"""Durations and sizes as people read them, and write them."""

import re

from .errors import UsageError


def duration(seconds: float) -> str:
    """`8.3 s`, `12 min`, `3 h 05 min`."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def size(count: float) -> str:
    """`3.1 MB`, decimal units."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if count < 1000 or unit == "TB":
            break
        count /= 1000
    return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"


def parse_size(text: str, where: str) -> int:
    """Bytes of `4GB`, `500 MB` or `1.5TB`, decimal units; raises UsageError, `where` first."""
    powers = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
    match = re.fullmatch(r"([0-9]{1,18}(?:\.[0-9]+)?)\s*([A-Z]*)", text.strip().upper())
    if not match or match[2] not in powers:
        raise UsageError(f"{where}: expected a size such as 4GB; found {text!r}")
    return int(float(match[1]) * powers[match[2]])
