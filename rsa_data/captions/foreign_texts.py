"""Files of texts as people, datasets and captioners write them: key -> texts."""

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..common import bounded, text_files
from ..common.errors import RsaDataError

# Names of columns and fields, in lower case; the first that is there is the key.
KEYS: tuple[str, ...] = (
    *("key", "sample_id", "file_name", "filename", "filepath", "image_path", "image_name"),
    *("image", "img", "path", "file", "image_id", "id"),
)
TEXTS: tuple[str, ...] = (
    *("text", "texts", "caption", "captions", "sentence", "sentences", "raw"),
    *("description", "comment", "prompt"),
)

SUFFIXES = (".json", ".jsonl", ".ndjson", ".csv", ".tsv", ".txt", ".token")
_FORMS = f"a column for the image ({', '.join(KEYS)}) and one for its text ({', '.join(TEXTS)})"

# `1000268201_693b08cb0e.jpg#0`, as Flickr8k numbers the texts of an image.
_NUMBERED = re.compile(r"(.+\.\w+)#\d+")
# `val_image.zip@/00000000.jpg`, as ViLBERT names the members of an archive.
_ARCHIVE = re.compile(r"^.*\.zip@/?")
# A list of so many words, each by itself, is one text that was cut into tokens.
_WORDS = 4

# where in the file, key, text
_Row = tuple[str, Any, Any]


def read(path: Path) -> dict[str, list[str]]:
    """The texts of each key in a file, in their order.

    JSON: {key: text or texts}, {key: {"caption": text}}, a list of objects, COCO's captions, or
    Karpathy's splits. JSON Lines: objects. CSV and TSV, also with ; or | between the columns: a
    header. Text without a header: `NAME#N`, a tab, the text (Flickr8k). Objects and headers have
    one column of KEYS and one of TEXTS. Raises RsaDataError that says where, for anything else.
    """
    where = f"captions/import: {path.name}"
    try:
        content = bounded.read_text(path, "json")
        suffix = path.suffix.lower()
        if suffix == ".json":
            rows = _of_json(bounded.parse_json(content), where)
        elif suffix in (".jsonl", ".ndjson"):
            rows = _of_objects(_lines_of_json(content), where, "line")
        else:
            rows = _of_columns(content, where)
        return _gathered(rows, where)
    except (OSError, ValueError, csv.Error) as error:
        raise RsaDataError(f"{where} cannot be read: {error}") from error


def _gathered(rows: Iterable[_Row], where: str) -> dict[str, list[str]]:
    texts: dict[str, list[str]] = {}
    tokens = False
    for place, key, value in rows:
        several = value if isinstance(value, list) else [value]
        if not isinstance(key, (str, int)) or not all(isinstance(t, str) for t in several):
            raise RsaDataError(
                f"{where} {place}: expected a key and a text, found {key!r} and {value!r}"
            )
        tokens |= len(several) >= _WORDS and not any(" " in text.strip() for text in several)
        numbered = _NUMBERED.fullmatch(str(key).strip())
        name = _ARCHIVE.sub("", numbered[1] if numbered else str(key).strip())
        texts.setdefault(name.strip("/"), []).extend(several)
    if tokens and not any(" " in text.strip() for each in texts.values() for text in each):
        raise RsaDataError(
            f"{where}: expected texts, found lists of single words: texts that were cut into "
            "tokens. Join the words of each with spaces"
        )
    return texts


def _of_json(content: Any, where: str) -> Iterable[_Row]:
    if isinstance(content, list):
        return _of_objects(enumerate(content, 1), where, "entry")
    if not isinstance(content, dict):
        raise RsaDataError(
            f"{where}: expected a JSON object of key and text, or a list of objects with key and "
            f"text; found {type(content).__name__}"
        )
    images, annotations = content.get("images"), content.get("annotations")
    if isinstance(annotations, list):
        return _of_coco(images if isinstance(images, list) else [], annotations, where)
    if isinstance(images, list):
        return _of_objects(enumerate(images, 1), where, "images entry")
    return (
        (f"key {key!r}", key, _text_of(value, f"{where} key {key!r}"))
        for key, value in content.items()
    )


def _of_coco(images: list[Any], annotations: list[Any], where: str) -> Iterator[_Row]:
    """COCO's captions: {"images": [{id, file_name}], "annotations": [{image_id, caption}]}."""
    names: dict[Any, Any] = {}
    for number, image in enumerate(images, 1):
        key = image.get("id") if isinstance(image, dict) else None
        if key is None or not isinstance(image.get("file_name"), str) or str(key) in names:
            raise RsaDataError(
                f"{where} images entry {number}: expected an id that stands once, and a file_name"
            )
        names[str(key)] = image["file_name"]
    for number, row in enumerate(annotations, 1):
        place = f"annotations entry {number}"
        key = row.get("image_id") if isinstance(row, dict) else None
        if key is None or (names and str(key) not in names):
            raise RsaDataError(f"{where} {place}: expected an image_id of its images; found {key}")
        yield place, names.get(str(key), key), _text_of(row, f"{where} {place}")


def _of_objects(rows: Iterable[tuple[int, Any]], where: str, what: str) -> Iterator[_Row]:
    for number, row in rows:
        place = f"{what} {number}"
        if not isinstance(row, dict):
            raise RsaDataError(f"{where} {place}: expected a key and a text, found {row!r:.60}")
        key = _key_of(row)
        if key is None:
            raise RsaDataError(f"{where} {place}: expected {_FORMS}; found {', '.join(row)}")
        if row.get("filepath") and key == "filename":  # Karpathy: folder and name
            yield place, f"{row['filepath']}/{row[key]}", _text_of(row, f"{where} {place}")
            continue
        yield place, row[key], _text_of(row, f"{where} {place}")


def _lines_of_json(content: str) -> Iterator[tuple[int, Any]]:
    for number, line in enumerate(text_files.lines(content), 1):
        if line.strip():
            yield number, bounded.parse_json(line)


def _key_of(names: Iterable[str]) -> str | None:
    there = {_plain(name): name for name in names}
    return next((there[name] for name in KEYS if name in there), None)


def _text_of(value: Any, where: str) -> Any:
    """The text or texts of a record: itself, or what one of its fields holds."""
    if isinstance(value, list):
        return [_text_of(one, where) for one in value]
    if not isinstance(value, Mapping):
        return value
    name = _text_column(value, where)
    return _text_of(value[name], where)


def _text_column(names: Iterable[str], where: str) -> str:
    there = {_plain(name): name for name in names}
    found = [there[name] for name in TEXTS if name in there]
    if len(found) != 1:
        raise RsaDataError(
            f"{where}: expected {_FORMS}; found {', '.join(found or there)}"
            + (": which is meant cannot be told. Leave one of them" if found else "")
        )
    return found[0]


def _plain(name: object) -> str:
    return str(name).strip().lower().replace(" ", "_")


def _of_columns(content: str, where: str) -> Iterator[_Row]:
    first = next((line for line in text_files.lines(content) if line.strip()), "")
    if "#" in first.partition("\t")[0] and "\t" in first:
        yield from _of_numbered(content, where)
        return
    between = max(",\t;|", key=lambda sign: _known(first.split(sign)))
    lines = io.StringIO(content, newline="")
    # Flickr30k, and tables between tabs whose texts have quotation marks of their own.
    loose = between == "\t" and any(line.count('"') % 2 for line in text_files.lines(content))
    if between == "|" or loose:
        reader = csv.reader(lines, delimiter=between, quoting=csv.QUOTE_NONE, strict=True)
    else:
        reader = csv.reader(lines, delimiter=between, strict=True)
    header = [field.strip() for field in next(reader, [])]
    key = _key_of(header)
    if key is None:
        raise RsaDataError(
            f"{where}: expected a header with {_FORMS}; found "
            f"{', '.join(header)[:200] or 'an empty file'}"
        )
    places = header.index(key), header.index(_text_column(header, where))
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            raise RsaDataError(
                f"{where} line {reader.line_num}: expected {len(header)} columns between "
                f"{between!r}, found {len(row)}. Put texts that hold {between!r} in quotation marks"
            )
        text = row[places[1]]
        # What pandas writes for a missing text.
        yield f"line {reader.line_num}", row[places[0]], "" if text == "nan" else text


def _known(fields: list[str]) -> int:
    return sum(_plain(field.strip('"')) in (*KEYS, *TEXTS) for field in fields)


def _of_numbered(content: str, where: str) -> Iterator[_Row]:
    for number, line in enumerate(text_files.lines(content), 1):
        key, tab, text = line.partition("\t")
        if not line.strip():
            continue
        if not tab or not _NUMBERED.fullmatch(key):
            raise RsaDataError(f"{where} line {number}: expected NAME#N, a tab and a text")
        yield f"line {number}", key, text
