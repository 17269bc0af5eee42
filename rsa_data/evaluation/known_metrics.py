"""Which metrics there are: those of the registry, and those that RSA_DATA_CODE names."""

from dataclasses import replace
from functools import cache

from .. import registry
from ..common import own_code
from ..common.errors import UsageError
from .metrics import Metric


def metrics() -> dict[str, Metric]:
    """Every metric by the name of its column, in the order that tables print them.

    After those of the registry those that RSA_DATA_CODE names. Narrow tables show metrics that are
    not this package's too: somebody wants to see them.
    """
    return _metrics(own_code.named())


def sources() -> list[str]:
    """Names in the registry, or `module:attribute`, of all metrics."""
    return [*registry.METRICS, *(word for word in own_code.named() if _in_code(word))]


@cache
def _metrics(code: tuple[str, ...]) -> dict[str, Metric]:
    found = {}
    for name in registry.METRICS:
        metric = registry.resolve("metric", registry.METRICS, name)
        found[name] = metric if registry.METRICS.is_own(name) else replace(metric, short=True)
    for word in code:
        if (own := _in_code(word)) is None:
            continue
        if own.name in found:
            raise UsageError(
                f"metric {word!r}: expected a name that no other metric has; found {own.name!r}"
            )
        found[own.name] = replace(own, short=True)
    return found


@cache
def _in_code(word: str) -> Metric | None:
    """The metric that `module:attribute` is; None where it is something else."""
    if not own_code.has_module(word):
        return None  # said when the command began
    found = own_code.load("code", word, word, ("builtins:object",))
    return found if isinstance(found, Metric) else None
