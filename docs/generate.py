"""What the documentation takes from the code, so that it cannot say anything else.

    python docs/generate.py            # writes docs/formats.md from schemas/
    python docs/generate.py --check    # exits 1 when docs/formats.md is not what schemas/ say

As a hook of mkdocs (mkdocs.yml) it also adds, at every build, the pages commands.md from the
command line itself and performance.md from the scripts and results in benchmarks/.
"""

import ast
import inspect
import sys
from pathlib import Path
from typing import Any

import click

import rsa_data
from rsa_data.cli.main import Group, cli, names
from rsa_data.store import schemas

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
    """docs/performance.md: each script with what it says of itself, and results it has left."""
    parts = [
        "# Measured performance\n",
        "Both sides of every comparison run in the same process or in turns, so that the ratio "
        "lasts where seconds do not. Scripts and what they measure, from their own words; results "
        "that they left in `benchmarks/results/` follow each.\n",
    ]
    for script in sorted((ROOT / "benchmarks").glob("*.py")):
        doc = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or ""
        parts.append(f"## {script.stem}\n\n```text\n{doc}\n```\n")
        for result in sorted((ROOT / "benchmarks" / "results").glob(f"{script.stem}*.md")):
            parts.append(result.read_text("utf-8") + "\n")
    return "\n".join(parts)


def api() -> str:
    """docs/api.md: the public names of the package and their docstrings."""
    parts = ["# Python API\n", "Generated from the docstrings; nothing else is public.\n"]
    for name in rsa_data.__all__:
        found = getattr(rsa_data, name)
        error = isinstance(found, type) and issubclass(found, Exception)
        signature = "" if error else inspect.signature(found)
        parts.append(f"## {name}\n\n```text\n{name}{signature}\n\n{inspect.getdoc(found)}\n```\n")
    return "\n".join(parts)


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """mkdocs asks for the list of pages."""
    from mkdocs.structure.files import File

    for name, make in (("commands.md", commands), ("performance.md", performance), ("api.md", api)):
        files.append(File.generated(config, name, content=make()))
    return files


def main(arguments: list[str]) -> int:
    """Writes or checks docs/formats.md."""
    page, wanted = HERE / "formats.md", formats()
    if arguments == ["--check"]:
        if page.is_file() and page.read_text("utf-8") == wanted:
            return 0
        sys.stderr.write("docs/formats.md is not what schemas/ say: python docs/generate.py\n")
        return 1
    page.write_text(wanted, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
