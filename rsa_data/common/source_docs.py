"""Documentation of registry entries, read from their source: nothing is imported."""

import ast
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def doc(target: str) -> str | None:
    """The documentation of `module:attribute` of this package; None where its source shows none.

    That is the docstring of a function or class. An object that is made by a call has the longest
    text that the call is given, or the docstring of the function that it is given first, or that of
    its class where it is given none.
    """
    module, _, attribute = target.partition(":")
    root, _, below = module.partition(".")
    path = _PACKAGE / f"{below.replace('.', '/')}.py"
    if root != _PACKAGE.name or not path.is_file():
        return None
    found = _statements(path).get(attribute)
    if isinstance(found, ast.Call):
        return _given(found, _statements(path))
    return None if found is None else _docstring(found)


@cache
def _statements(path: Path) -> dict[str, ast.AST]:
    """What each name of a module stands for: a definition, or the value that it is assigned."""
    found: dict[str, ast.AST] = {}
    for node in ast.parse(path.read_bytes()).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found[node.name] = node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found[node.targets[0].id] = node.value
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value:
            found[node.target.id] = node.value
    return found


def _docstring(node: ast.AST) -> str | None:
    return ast.get_docstring(node) if isinstance(node, (ast.FunctionDef, ast.ClassDef)) else None


def _given(call: ast.Call, names: dict[str, ast.AST]) -> str | None:
    values = [*call.args, *(k.value for k in call.keywords if k.arg in ("doc", "formula"))]
    constants = [value.value for value in values if isinstance(value, ast.Constant)]
    if texts := [text for text in constants if isinstance(text, str)]:
        return max(texts, key=len)
    for value in values:
        if isinstance(value, ast.Name) and (text := _docstring(names.get(value.id, value))):
            return text
    own = names.get(call.func.id) if isinstance(call.func, ast.Name) else None
    return None if own is None else _docstring(own)
