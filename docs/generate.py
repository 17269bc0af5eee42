"""What the documentation takes from the code, so that it cannot say anything else.

    python docs/generate.py            # writes formats.md from schemas/, api.md from docstrings
                                       # and performance.md from benchmarks/results/
    python docs/generate.py --check    # exits 1 when one of them is not what they say

As a hook of mkdocs (mkdocs.yml) it also adds, at every build, the page commands.md from the command
line itself.
"""

import ast
import inspect
import json
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

import click

import rsa_data
from rsa_data.cli.main import Group, cli, names
from rsa_data.common import cards
from rsa_data.heads.checkpoint import ScaleHead
from rsa_data.store import schemas
from rsa_data.views.open_work import OpenDataset, OpenTable, OpenWork
from rsa_data.views.torch_dataset import ShardDataset, ShardStream

HERE = Path(__file__).parent
ROOT = HERE.parent
_ORDER = ["samples", "segments", "captions", "embeddings", "objects", "depth", "history", "metrics"]

_FORMATS = """\
# File formats

This page is generated from `schemas/` by `docs/generate.py`; the hook `schema docs` keeps it up to
date.

A table is a folder of Parquet parts, `WORK/DATASET/TABLE/part-NNNNN-HASH.parquet`; heads
keep theirs in `WORK/heads/NAME`. Beside the parts stand

- `_table.json`: what made the table (stage, options, sha256 of model files, inputs, versions);
- `_part-NNNNN.json`: the receipt. A part without a receipt is not done. It holds rows, ok, failed,
  skipped, split, sha256 of the file, digest of the content, and the digests of the input parts;
- `_manifest.json`: all receipts, once every part is done.

Part n of every table of a dataset belongs to the same samples. pandas, DuckDB and pyarrow.dataset
open the folder as one table, since Arrow leaves out names that begin with an underscore:
`pandas.read_parquet("work/nyuv2/captions/occupancy")`; Polars takes the glob
`work/nyuv2/captions/occupancy/*.parquet`. While a run writes, a folder may hold data that no
receipt names yet; a finished one holds exactly its parts.

Tables of version 0.1 have the same helper files without the underscore. They are read, continued
and verified as they are; `--start-over` makes one under the new names.

A schema's version goes up when a column is added, is removed, or changes its meaning or type;
CHANGELOG.md says then what to do with tables of the version before.
"""


def formats() -> str:
    """docs/formats.md."""
    folder = ROOT / "schemas"
    names = sorted(
        (path.stem for path in folder.glob("*.toml")),
        key=lambda n: (_ORDER.index(n) if n in _ORDER else len(_ORDER), n),
    )
    parts = [_FORMATS]
    for name in names:
        schema = schemas.definition(name)
        parts.append(f"## {name}\n\n{schema['doc']}\n\nVersion {schema['version']}; ")
        parts[-1] += f"key `{schema['key']}`.\n"
        rows = ["| column | type | unit | null | meaning |", "|---|---|---|---|---|"]
        for column, about in schema["columns"].items():
            doc = about["doc"] + (
                f" One of: {', '.join(about['values'])}." if "values" in about else ""
            )
            kind = about["type"].replace("|", "\\|")
            null = "yes" if about.get("nullable") else ""
            rows.append(f"| {column} | `{kind}` | {about.get('unit', '')} | {null} | {doc} |")
        parts.append("\n".join(rows) + "\n")
    return "\n".join(parts)


def commands() -> str:
    """docs/commands.md: the help of every command, as the terminal shows it."""
    parts = [
        "# Command line\n",
        "Generated from the code. Every command can be stopped at any time",
    ]
    parts[-1] += " and run again.\n"
    parts.append(f"```text\n{_help(cli, 'rsa-data')}\n```\n")
    assert isinstance(cli, Group)
    context = click.Context(cli, info_name="rsa-data")
    for name in names():
        command = cli.get_command(context, name)
        assert command is not None
        parts.append(f"## {name}\n\n```text\n{_help(command, f'rsa-data {name}')}\n```\n")
    return "\n".join(parts)


def _help(command: click.Command, name: str) -> str:
    context = click.Context(command, info_name=name, terminal_width=96, max_content_width=96)
    return command.get_help(context)


def performance() -> str:
    """docs/performance.md: the tables that benchmarks left, and which left none."""
    scripts = {path.stem: path for path in sorted((ROOT / "benchmarks").glob("*.py"))}
    results = ROOT / "benchmarks" / "results"
    parts, none, machines = [_PERFORMANCE], [], set()
    # What people ask first stands first.
    order = [*_FIRST, *(name for name in scripts if name not in _FIRST)]
    for name, script in ((name, scripts[name]) for name in order):
        doc = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or ""
        first, _, rest = doc.partition("\n\n")
        file, texts = results / f"{name}.json", sorted(results.glob(f"{name}*.md"))
        if not file.is_file() and not texts:
            none.append(f"| `benchmarks/{name}.py` | {' '.join(first.split())} |")
            continue
        command = rest.strip().partition("\n\n")[0].strip()
        parts.append(f"## {name}\n\n{first}\n\n```text\n{command}\n```\n")
        tables = tables_of(file)
        machines |= {table["machine"] for table in tables.values()}
        parts += [_result(title, table) for title, table in tables.items()]
        if not tables and not texts:
            parts.append(f"What it found stands in `benchmarks/results/{name}.json`.\n")
        if (HERE / "img" / f"{name}.svg").is_file():
            parts.append(f"![{first}](img/{name}.svg)\n")
        parts += [_lowered(text) + "\n" for text in texts]
    gpus = [m for m in machines if "no GPU" not in m]
    parts.append("## Without a table\n")
    if not gpus:
        parts.append("No figure on this page was made on a GPU.\n")
    parts.append("These scripts have left no table:\n")
    parts.append("\n".join(["| script | what it measures |", "|---|---|", *none]) + "\n")
    return "\n".join(parts)


_PERFORMANCE = """\
# Measured performance

This page is generated by `docs/generate.py` from what the scripts in `benchmarks/` wrote to
`benchmarks/results/`. Both sides of a comparison ran in the same process or in turns, so that a
ratio lasts where seconds do not. Tables of time and memory say when and on which machine they were
made.
"""

_FIRST = ("peers", "gpu", "gpu_detection", "scale", "growth", "loader", "shards")


def tables_of(file: Path) -> dict[str, dict[str, Any]]:
    """The tables that benchmarks/recording wrote to a file, by title; other JSON has none."""
    found = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    entries = found.items() if isinstance(found, dict) else ()
    return {t: v for t, v in entries if isinstance(v, dict) and {"columns", "rows"} <= v.keys()}


def _lowered(file: Path) -> str:
    """Markdown whose headings stand below those of this page; of a long file its first section."""
    first, *others = re.split(r"^#+ (?=rsa_data/)", file.read_text("utf-8"), flags=re.MULTILINE)
    if others:
        first += f"Each of the {len(others)} stands in `benchmarks/results/{file.name}`.\n"
    return re.sub(r"^#+ ", "### ", first, flags=re.MULTILINE)


def _result(title: str, table: dict[str, Any]) -> str:
    """One table of a benchmark, with where and when it was made."""
    rows = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    lines = [f"| {' | '.join(map(_cell, row))} |" for row in rows]
    versions = ", ".join(f"{name} {v}" for name, v in table["versions"].items() if v != "-")
    known = ("date", "commit", "machine", "versions", "note", "columns", "rows", "runs")
    more = "".join(f"; {key} {value}" for key, value in table.items() if key not in known)
    note = f"{table['note']}\n\n" if table["note"] else ""
    made = f"{table['date']}, commit {table['commit']}; {table['machine']}{more}; {versions}."
    return f"### {title}\n\n" + "\n".join(lines) + f"\n\n{note}{made}\n"


def _cell(value: Any) -> str:
    """A number with digits that matter, a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:g}"
    return f"{value:,}" if isinstance(value, int) else str(value).replace("|", "\\|")


# Public classes and what calls give back, with the methods that are documented.
_CLASSES = (ShardDataset, ShardStream, OpenWork, OpenDataset, OpenTable, ScaleHead)


def api() -> str:
    """docs/api.md: the public names of the package and their docstrings."""
    parts = [
        "# Python API\n",
        "Generated from the docstrings by `docs/generate.py`; nothing else is public. "
        "[The notebook](notebook.ipynb) shows most of it on the work dir of `rsa-data demo`.\n",
    ]
    given = [found for found in _CLASSES if found.__name__ not in rsa_data.__all__]
    for found in [*(getattr(rsa_data, name) for name in rsa_data.__all__), *given]:
        parts.append(f"## {found.__name__}\n\n```text\n{_described(found)}\n```\n")
        if found in _CLASSES:
            for name, member in vars(found).items():
                method = getattr(member, "__func__", member)
                if inspect.isfunction(method) and not name.startswith("_") and method.__doc__:
                    parts.append(f"```text\n{found.__name__}.{_described(method)}\n```\n")
    return "\n".join(parts)


_KINDS = {
    "segments": "segmenters",
    "relative-depth": "depth models",
    "text-encoder": "encoders",
    "head": "published heads",
}
_BLOCK = re.compile(r"(?<=<!-- models -->\n).*?(?=<!-- /models -->)", re.DOTALL)


def readme() -> str:
    """README.md with its table of models: every card, and what `models check` found of its file."""
    checked = json.loads((HERE / "models.json").read_text("utf-8"))
    state = {model["name"]: model["state"] for model in checked["models"]}
    rows = ["| models | run with their real file | not yet run |", "|---|---|---|"]
    for kind, title in _KINDS.items():
        groups: dict[bool, list[str]] = {True: [], False: []}
        for name in cards.names(kind):
            wrong = " (failed)" if state.get(name) == "failed" else ""
            groups[state.get(name) == "ok"].append(f"{name}{wrong}")
        rows.append(f"| {title} | {', '.join(groups[True])} | {', '.join(groups[False])} |")
    table = "\n".join(rows) + "\n"
    return _BLOCK.sub(lambda _: table, (ROOT / "README.md").read_text("utf-8"))


def _described(found: Any) -> str:
    """Signature as the source has it, whatever Python prints of types, and docstring."""
    signature = ""
    if not (inspect.isclass(found) and issubclass(found, Exception)):
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(found))).body
        if isinstance(node, ast.ClassDef):
            defined = (n for n in node.body if isinstance(n, ast.FunctionDef))
            node = next(n for n in defined if n.name == "__init__")
        assert isinstance(node, ast.FunctionDef)
        node.args.args = [a for a in node.args.args if a.arg not in ("self", "cls")]
        returns = f" -> {ast.unparse(node.returns)}" if node.returns and node.name[0] != "_" else ""
        signature = f"({ast.unparse(node.args)}){returns}"
    return f"{found.__name__}{signature}\n\n{inspect.getdoc(found)}"


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """mkdocs asks for the list of pages."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, "commands.md", content=commands()))
    return files


def main(arguments: list[str]) -> int:
    """Writes or checks the pages that stand in docs/, and the table of models in README.md."""
    pages = {
        HERE / "formats.md": formats(),
        HERE / "api.md": api(),
        HERE / "performance.md": performance(),
        ROOT / "README.md": readme(),
    }
    if arguments == ["--check"]:
        old = [
            p.relative_to(ROOT).as_posix()
            for p, t in pages.items()
            if not p.is_file() or p.read_text("utf-8") != t
        ]
        if old:
            sys.stderr.write(f"{', '.join(old)}: out of date: python docs/generate.py\n")
        return 1 if old else 0
    for page, text in pages.items():
        page.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
