"""Places where cosmic-ray can change the code, and a seeded sample of mutants, one a place.

mutmut changes the bodies of functions only; a camera matrix and a depth unit stand outside them,
which is why cosmic-ray makes the mutants here.
"""

import ast
import random
import re
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

# Rooms whose numbers are under test, and two modules that they stand on.
ROOMS = ("captions", "depth", "evaluation", "heads", "store")
MODULES = ("common/splitmix.py", "datasets/nyuv2.py")

# Replacements that a test of any kind finds, because the types do not fit, or that change nothing
# (`is` for `==`), would only flatter the score: arithmetic stays arithmetic, bits stay bits.
_ARITHMETIC, _BITS = {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"}, {
    "RShift", "LShift", "BitOr", "BitAnd", "BitXor"}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change. `start` and `end` are lines of the statement, counted from 1.

    outer : the outermost function whose body it is in, "" where the line runs on import.
    """

    file: str
    function: str
    operator: str
    before: str
    after: str
    line: int
    column: int
    start: int
    end: int
    outer: str
    nth: int
    code: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.file, self.function, self.before, self.after


def files(tree: Path) -> list[str]:
    """The modules that are changed, relative to the tree."""
    package = tree / "rsa_data"
    found = {path for room in ROOMS for path in (package / room).rglob("*.py")}
    found |= {package / module for module in MODULES}
    registry = (package / "registry.py").read_text("utf-8")
    decoders = registry.partition("DECODERS = ")[2].partition(")")[0]
    names = {
        name.replace(".", "/") for name in re.findall(r'"(rsa_data\.segments\.\w+):', decoders)
    }
    found |= {tree / f"{name}.py" for name in names} | {package / "segments/decoding.py"}
    return sorted(path.relative_to(tree).as_posix() for path in found)


def sample(tree: Path, count: int, seed: int) -> list[Mutant]:
    """`count` mutants: places drawn without replacement over all files, one mutant a place."""
    draw = random.Random(seed)
    places = [place for file in files(tree) for place in of_file(tree, file)]
    chosen = []
    for place in draw.sample(places, len(places)):
        ways = list(place)
        draw.shuffle(ways)
        made = (mutant for way in ways if (mutant := way()) is not None)
        if (mutant := next(made, None)) is not None:
            chosen.append(mutant)
        if len(chosen) == count:
            break
    return chosen


def find(tree: Path, entry: dict) -> Mutant | None:
    """The mutant of an entry again, also in a file that has moved since it was drawn."""
    file, key = entry["key"][0], tuple(entry["key"])
    if not (tree / file).is_file():
        return None
    source = (tree / file).read_text("utf-8")
    begin, name = (entry["line"], entry["column"]), f"core/{entry['operator']}"
    if begin[0] <= len(source.splitlines()):
        where = source, file, Statements(source), name, entry["nth"], begin, key[2]
        if (mutant := _made(*where)) is not None and mutant.key == key:
            return mutant
    for place in of_file(tree, file):
        for way in place:
            mutant = way() if way.keywords["before"] == key[2] else None
            if mutant is not None and mutant.key == key:
                return mutant
    return None


def of_file(tree: Path, file: str) -> list[list[partial]]:
    """For each place of the file, in order: functions that make its mutants (None: not valid)."""
    return _of_source((tree / file).read_text("utf-8"), file)


@cache
def _of_source(source: str, file: str) -> list[list[partial]]:
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    lines, statements = source.splitlines(), Statements(source)
    nodes = list(ast_nodes(get_ast(source)))
    places: dict[tuple, list] = {}
    for name in operator_names():
        kind = get_operator(name)
        if kind.arguments() or not _kept(name):
            continue
        operator = kind()
        spots = [spot for node in nodes for spot in operator.mutation_positions(node)]
        for nth, (begin, end) in enumerate(spots):
            if not statements.annotation(begin):
                before = lines[begin[0] - 1].strip()
                way = partial(_made, source, file, statements, name, nth, begin, before=before)
                places.setdefault((begin, end), []).append(way)
    return [places[key] for key in sorted(places)]


def _made(source, file, statements, name, nth, begin, before) -> Mutant | None:
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    try:
        code = mutate_code(source, get_operator(name)(), nth)
    except AttributeError:  # ExceptionReplacer knows no dotted names
        return None
    if code is None or not _compiles(code):
        return None
    row, column = begin
    first, last, function = statements.around(row)
    lines, changed = source.splitlines(), code.splitlines()
    same = len(changed) == len(lines)
    after = changed[row - 1].strip() if same else f"(gone) {lines[row].strip()}"
    return Mutant(file, function, name.removeprefix("core/"), before, after, row, column, first,
                  last, statements.outer(row), nth, code)  # fmt: skip


def _kept(name: str) -> bool:
    kind, _, words = name.removeprefix("core/").partition("_")
    if kind == "ReplaceBinaryOperator":
        pair = set(words.split("_"))
        return pair <= _ARITHMETIC or pair <= _BITS
    if kind == "ReplaceComparisonOperator":
        return words in ("Is_IsNot", "IsNot_Is") or "Is" not in words
    if kind == "ReplaceUnaryOperator":
        return words in ("USub_UAdd", "Delete_USub", "Delete_Not", "Delete_Invert")
    return True


def _compiles(code: str) -> bool:
    try:
        compile(code, "mutant", "exec")
    except (SyntaxError, ValueError):
        return False
    return True


class Statements:
    """Which statement and function a line belongs to, and where annotations are."""

    def __init__(self, source: str):
        self.annotations, self.spans, self.functions = [], [], []
        self._walk(ast.parse(source), [])

    def _walk(self, node: ast.AST, names: list[str]) -> None:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names = [*names, node.name]
            body = node.body[0].lineno if isinstance(node, ast.FunctionDef) else node.end_lineno + 1
            self.functions.append((node.lineno, node.end_lineno, body, ".".join(names)))
        if isinstance(node, ast.stmt):
            inner = [x.lineno for x in getattr(node, "body", []) if isinstance(x, ast.stmt)]
            last = max(node.lineno, min(inner) - 1) if inner else node.end_lineno
            self.spans.append((node.lineno, last))
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            if part is not None:
                end = part.end_lineno, part.end_col_offset
                self.annotations.append(((part.lineno, part.col_offset), end))
        for child in ast.iter_child_nodes(node):
            self._walk(child, names)

    def annotation(self, spot: tuple[int, int]) -> bool:
        return any(begin <= spot < end for begin, end in self.annotations)

    def around(self, row: int) -> tuple[int, int, str]:
        """First and last line to look for tests at, and the function's name ("": none).

        A default in a signature runs on import: there the whole body is looked at.
        """
        first, last = max((s for s in self.spans if s[0] <= row <= s[1]), default=(row, row))
        around = self._functions(row)
        if not around:
            return first, last, ""
        begin, end, body, name = max(around)
        if row < body and begin <= row:
            return (min(row, body), end, name)
        return first, last, name

    def outer(self, row: int) -> str:
        inside = [f for f in self._functions(row) if row >= f[2]]
        return min(inside)[3] if inside else ""

    def _functions(self, row: int) -> list[tuple[int, int, int, str]]:
        return [f for f in self.functions if f[0] <= row <= f[1]]
