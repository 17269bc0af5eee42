"""Files of class names as people and datasets write them: TOML, JSON, lists and tables in text."""

import csv
import re
from pathlib import Path
from typing import Any

from . import bounded, class_names, text_files
from .class_names import ClassTable
from .errors import RsaDataError

# Headers of the columns that tables of classes have, in lower case.
_NUMBERS = ("idx", "id", "index", "number", "class_id", "class id", "label_id", "trainid")
_NAMES = ("name", "names", "class", "class_name", "class name", "label", "category")
_STUFF, _THINGS = "stuff", ("isthing", "is_thing", "thing")

# Three numbers in a row, with or without a name: a palette (CamVid, CVAT's labelmap.txt, DIGITS).
_COLOUR = re.compile(r"(?<![\d.])\d{1,3}([ ,\t]+)\d{1,3}[ ,\t]+\d{1,3}(?![\d.])")

# What other files than lists of names hold, and what to do; a list has it in most of its lines.
_OTHERS = (
    (re.compile(r"\w+\s*=\s*\S.*"), "settings, as in Darknet's obj.data; give the list they name"),
    (re.compile(r"/[mgt]/\w+\s*,.*"), "identifiers before the names; leave them out"),
    (re.compile(r"n\d{8}\b.*"), "WordNet's identifiers; leave them and what is no name out"),
)

_NUMBERED = re.compile(r"(\d{1,6})\s*[:=\t,;]\s*(.*)|(\d{1,6}) +(.*)")


def read(path: Path) -> ClassTable:
    """The class table of a file.

    TOML as in class_names.parse; JSON: a list of names, {number: name}, or either under `names` or
    `id2label`; text: one name a line, counted from 0, where an empty line is a class without a
    name; lines `N: name`, `N,name` or `N name`; or a table with a header, its columns between tabs
    or commas. Raises RsaDataError that names the line for text of which neither is certain.
    """
    try:
        text = bounded.read_text(path)
        if path.suffix.lower() == ".toml":
            return class_names.parse(bounded.parse_toml(text), path.name)
        if path.suffix.lower() == ".json":
            return class_names.parse(_of_json(bounded.parse_json(text)), path.name)
    except (OSError, ValueError) as error:
        raise RsaDataError(
            f"names: expected a file of class names, one a line, TOML or JSON, at {path}; "
            f"found {error}"
        ) from error
    return class_names.parse(_of_text(text, path), path.name)


def _of_json(content: Any) -> dict[str, Any]:
    if isinstance(content, dict):
        content = content.get("names", content.get("id2label", content))
    return {"names": content}


def _of_text(text: str, path: Path) -> dict[str, Any]:
    lines = [line.strip() for line in text_files.lines(text)]
    while lines and not lines[-1]:
        lines.pop()
    filled = [(number, line) for number, line in enumerate(lines, 1) if line]
    if path.suffix.lower() in (".yaml", ".yml"):
        raise _refused(path, "a YAML file; write its names one a line")
    for number, line in filled:
        if line[0] in "#[{" or "\r" in line:
            raise _refused(path, f"line {number}: {line[:60]!r}")
    if len(filled) == 1 and "," in filled[0][1]:
        raise _refused(path, "one line with commas; write one name a line")
    _check_list([line for _, line in filled], path)
    if table := _of_table([line for _, line in filled], path):
        return table
    for number, line in filled:
        if _COLOUR.search(line):
            raise _refused(path, f"line {number}, a colour: {line[:60]!r}; leave the colours out")
    numbered = [_NUMBERED.fullmatch(line) for _, line in filled]
    if filled and all(numbered):
        found = [(m[1] or m[3], m[2] if m[1] else m[4]) for m in numbered if m]
        rows = [next(csv.reader([f"{n},{name}"])) for n, name in found]
        # `N,name,other name`: the first is the class's.
        return _by_number([(n, fields[0]) for n, *fields in rows], path)
    if filled and sum(map(bool, numbered)) > len(filled) / 2:
        number, line = next(x for x, m in zip(filled, numbered, strict=True) if not m)
        raise _refused(path, f"numbers before most names but not in line {number}: {line[:60]!r}")
    return {"names": lines}


def _check_list(lines: list[str], path: Path) -> None:
    """Raises RsaDataError for text that a list of names never is."""
    for pattern, what in _OTHERS:
        if lines and sum(bool(pattern.fullmatch(line)) for line in lines) > len(lines) / 2:
            raise _refused(path, what)
    if any(line.endswith("{") for line in lines):
        raise _refused(path, "blocks in braces, as in a label map of TensorFlow")
    if lines and lines[0] == "__ignore__":
        raise _refused(path, "__ignore__ first, which labelme counts as -1; remove that line")
    ends = [re.fullmatch(r"(.*[^\W\d_].*?)[ \t,;:]+(\d+)", line) for line in lines]
    if len(lines) > 1 and len({m[1] for m in ends if m}) == len(lines):
        raise _refused(path, f"a number behind each name: {lines[0][:60]!r}")


def _of_table(lines: list[str], path: Path) -> dict[str, Any] | None:
    """Names by number of a table with a header; None where the first line is none."""
    between = "\t" if lines and "\t" in lines[0] else ","
    rows = list(csv.reader(lines, delimiter=between))
    header = [field.strip().lower() for field in rows[0]] if rows else []
    number = next((header.index(n) for n in _NUMBERS if n in header), None)
    name = next((header.index(n) for n in _NAMES if n in header), None)
    if number is None and name is not None and len(header) > 1:
        raise _refused(path, f"a table without a column of numbers: {between.join(header)[:60]!r}")
    if number is None or name is None:
        return None
    for place, row in enumerate(rows[1:], 2):
        if len(row) != len(header) or not row[number].strip().isdecimal():
            raise _refused(path, f"row {place} of the table: {between.join(row)[:60]!r}")
    found = _by_number([(row[number].strip(), row[name]) for row in rows[1:]], path)
    thing = next((header.index(n) for n in _THINGS if n in header), None)
    column, countable = (thing, "1") if thing is not None else (_place(header, _STUFF), "0")
    if column is not None:
        things = {row[name] for row in rows[1:] if row[column].strip() == countable}
        found["things"] = sorted(things)
    return found


def _place(header: list[str], name: str) -> int | None:
    return header.index(name) if name in header else None


def _by_number(rows: list[tuple[str, str]], path: Path) -> dict[str, Any]:
    names: dict[str, str] = {}
    for number, name in rows:
        if names.setdefault(str(int(number)), name) != name:
            raise _refused(path, f"two names of number {number}: {names[number]!r} and {name!r}")
    return {"names": names}


def _refused(path: Path, found: str) -> RsaDataError:
    return RsaDataError(
        f"names: {path}: expected one name a line, N: name, N,name, or a table with a header; "
        f"found {found}"
    )
