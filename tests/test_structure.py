"""The shape of the code: rooms, sizes, no import circle, and tests that use public names only."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "rsa_data"
PYTHON = [
    path for folder in ("rsa_data", "tests", "benchmarks", "docs")
    for path in sorted((ROOT / folder).rglob("*.py"))
]  # fmt: skip


def lines(path: Path) -> int:
    return len(path.read_text("utf-8").splitlines())


def test_the_top_of_the_package_has_at_most_15_entries():
    found = {p.name for p in PACKAGE.iterdir()} - {"__pycache__", "py.typed"}
    assert len(found) <= 15, sorted(found)


def test_modules_are_short():
    assert [p for p in PACKAGE.rglob("*.py") if lines(p) > 250] == []
    assert [p for p in PYTHON if lines(p) > 400] == []


def test_no_module_imports_itself_by_way_of_others():
    grimp = pytest.importorskip("grimp")
    graph = grimp.build_graph("rsa_data", cache_dir=None)
    imports = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    graphlib.TopologicalSorter(imports).prepare()  # raises CycleError, which names the circle


def test_every_room_says_what_it_holds():
    for room in sorted(PACKAGE.rglob("__init__.py")):
        assert ast.get_docstring(ast.parse(room.read_text("utf-8"))), room


def private(tree: ast.Module) -> list[str]:
    """Private names of rsa_data that a file imports, reads off a module, or patches."""
    modules, found = set(), []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rsa_data"):
            modules |= {alias.asname or alias.name for alias in node.names}
            found += [alias.name for alias in node.names if is_private(alias.name)]
        elif isinstance(node, ast.Import):
            modules |= {alias.asname for alias in node.names if alias.name.startswith("rsa_data")}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr):
            if isinstance(node.value, ast.Name) and node.value.id in modules:
                found.append(f"{node.value.id}.{node.attr}")
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "setattr":
            texts = [a.value for a in node.args[:2] if isinstance(a, ast.Constant)]
            found += [t for t in texts if isinstance(t, str) and is_private(t.rpartition(".")[2])]
    return found


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


@pytest.mark.parametrize("folder", ["tests", "benchmarks"])
def test_no_test_reaches_into_private_names(folder):
    trees = {p: ast.parse(p.read_text("utf-8")) for p in sorted((ROOT / folder).rglob("*.py"))}
    assert {str(p): names for p, tree in trees.items() if (names := private(tree))} == {}


def test_test_files_do_not_import_each_other():
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert not any("test_" in name or name.startswith("tests") for name in names), path
