"""The engine of English plurals, articles and numbers, inflect, without its type checks."""

from functools import cache
from typing import Any


@cache
def engine() -> Any:
    """inflect's engine.

    inflect has typeguard check the types of its arguments. For that each of its functions is
    parsed and compiled anew when it is imported, with all of its module: 2.4 s of CPU time in
    every process that writes a caption, for arguments that mypy has checked here.
    """
    import typeguard

    checked = typeguard.typechecked
    typeguard.typechecked = _as_it_is  # type: ignore[assignment]
    try:
        import inflect
    finally:
        typeguard.typechecked = checked
    return inflect.engine()


def _as_it_is(target: Any) -> Any:
    return target
