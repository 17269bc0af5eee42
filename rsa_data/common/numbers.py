"""Numbers as a user writes them: ASCII digits, a point, an exponent; nothing else of Python's."""

import re

_REAL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE = re.compile(r"[+-]?[0-9]{1,400}")


def real(text: str) -> float:
    """The number that a text spells; spaces around it are left out. Raises ValueError for other
    digits, underscores, nan and inf."""
    if not _REAL.fullmatch(text.strip(" ")):
        raise ValueError(f"expected a number; found {text!r}")
    return float(text)


def whole(text: str) -> int:
    """The whole number that a text spells; see `real`."""
    if not _WHOLE.fullmatch(text.strip(" ")):
        raise ValueError(f"expected a whole number; found {text!r}")
    return int(text)


def reals(text: str, count: int) -> list[float]:
    """Numbers with commas between them, exactly `count`; raises ValueError as `real` does."""
    found = [real(item) for item in text.split(",")]
    if len(found) != count:
        raise ValueError(f"expected {count} numbers; found {len(found)}")
    return found
