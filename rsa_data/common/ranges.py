"""Ranges of numeric options. The range stands in the option's type, as `threads: AtOnce = 2`.

Whatever binds options holds them against it: the command line, pipeline files, --set and
--dataset-option.
"""

import contextlib
import math
import typing
from typing import Annotated, Any

import msgspec

from .errors import UsageError
from .numbers import real, whole
from .typed import Count as Count

_MANY = 2**53

Positive = Annotated[int, msgspec.Meta(ge=1, lt=_MANY)]
# Threads, processes or requests at the same time: more would be a slip.
AtOnce = Annotated[int, msgspec.Meta(ge=1, le=1024)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Amount = Annotated[float, msgspec.Meta(ge=0)]
PositiveAmount = Annotated[float, msgspec.Meta(gt=0)]

# Where an option says nothing of its range.
ANY = msgspec.Meta(gt=-_MANY, lt=_MANY)


def split(annotation: Any) -> tuple[Any, msgspec.Meta | None]:
    """(type, range) of an annotation without None; the range is None where there is none."""
    if typing.get_origin(annotation) is Annotated:
        kind, *more = typing.get_args(annotation)
        return kind, next((m for m in more if isinstance(m, msgspec.Meta)), None)
    return annotation, None


def number(value: Any, kind: Any, limits: msgspec.Meta, where: str = "") -> Any:
    """A number inside its range, from a number or text that spells one.

    kind : int or float. Raises UsageError otherwise; `where` begins the message.
    """
    found, wanted = None, _wanted(math.nan, limits)
    if isinstance(value, (str, int, float)) and not isinstance(value, bool):
        with contextlib.suppress(ValueError, OverflowError):
            if isinstance(value, str):
                found = whole(value) if kind is int else real(value)
            else:
                found = kind(value)
    if isinstance(value, float) and found != value:
        found = None  # int() would cut
    if found is not None and not (wanted := _wanted(found, limits)):
        return found
    kinds = "a whole number" if kind is int else "a number"
    raise UsageError(f"{where}expected {kinds}, {wanted}; found {value!r:.60}")


def _wanted(value: float, limits: msgspec.Meta) -> str:
    """What was expected of a number that is out of its range, such as "1 or more"; "" if it is in.

    Numbers that are not finite are out of every range.
    """
    if not math.isfinite(value):
        return _words(limits, high=False)
    low = (limits.ge is None or value >= limits.ge) and (limits.gt is None or value > limits.gt)
    high = (limits.le is None or value <= limits.le) and (limits.lt is None or value < limits.lt)
    return "" if low and high else _words(limits, high=not high)


def _words(limits: msgspec.Meta, high: bool) -> str:
    low = f"{limits.ge:,} or more" if limits.ge is not None else f"more than {limits.gt:,}"
    if limits.le is not None:
        return f"{limits.ge:,} to {limits.le:,}" if limits.ge is not None else (
            f"{low}, at most {limits.le:,}"
        )  # fmt: skip
    named = limits.lt is not None and (high or limits.lt != _MANY)
    return f"{low}, less than {limits.lt:,}" if named else low
