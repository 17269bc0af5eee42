"""Keeps pyarrow from importing pandas before anybody needs it.

The first `pyarrow.array` of a process looks whether pandas is installed and imports all of it, to
recognise its types among its arguments: 0.3 s of CPU time in every command and every worker, none
of which passes it such a type. pyarrow tries again where pandas is really asked for (`to_pandas`).
"""

import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType


def install() -> None:
    """Lets pyarrow find no pandas until something else imports it; then pyarrow is told at once."""
    import pyarrow as pa

    if "pandas" in sys.modules:
        return
    absent, told = _Absent(), _Told()
    sys.meta_path.insert(0, absent)
    try:
        pa.array([0])
    finally:
        sys.meta_path[0] = told


class _Absent:
    """A finder under which there is no pandas."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: object = None) -> None:
        if name == "pandas":
            raise ModuleNotFoundError(name)


class _Told:
    """A finder that finds pandas, once, and makes pyarrow look again when it has been imported."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: object = None
    ) -> ModuleSpec | None:
        if name != "pandas":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def run_and_tell(module: ModuleType) -> None:
                run(module)
                _look_again()

            spec.loader.exec_module = run_and_tell  # type: ignore[method-assign]
        return spec


def _look_again() -> None:
    """Makes pyarrow find pandas, for the types of its arrays."""
    import pyarrow as pa

    pa.table({"n": [0]}).to_pandas()
