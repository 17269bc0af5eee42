"""What was run: the tables of each dataset, their options, versions, times and failures."""

import warnings
from collections import Counter
from typing import Any

import msgspec
import pyarrow.compute as pc

from ...common import html
from ...common.errors import RsaDataError
from ...common.html import Html, tag
from ...common.units import duration, size
from ...heads.description import read
from ...heads.predict.find import in_work
from ...runner.status import stale
from ...store import logs
from ...store.tables import Receipt, Table, WorkDir

_REASONS, _NAMED = 8, 4
# Failed parts looked into for reasons, a table; the counts themselves are of all parts.
_LOOKED = 20


def lineage(work: WorkDir) -> Html:
    """A section: a table of tables, each one's options to unfold, and what failed and why."""
    rows: list[list[Any]] = []
    details: list[Html] = []
    failures: list[Html] = []
    versions: dict[str, str] = {}
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            about = table.description()
            receipts = [table.receipt(n) for n in table.parts()]
            count = {
                k: sum(getattr(r, k) for r in receipts)
                for k in ("ok", "failed", "skipped", "bytes")
            }
            rate, seconds = _times(work, dataset, name)
            rows.append(
                [
                    dataset,
                    name,
                    ", ".join(about.inputs) or "files",
                    *(f"{count[k]:,}" for k in ("ok", "failed", "skipped")),
                    size(count["bytes"]),
                    duration(seconds) if seconds is not None else "",
                    f"{rate:,.1f}" if rate else "",
                    stale(work, table) or "up to date",
                ]
            )
            versions |= about.made_with or {}
            details.append(_options(f"{dataset} / {name}", msgspec.to_builtins(about)))
            if count["failed"] or count["skipped"]:
                failures.append(_reasons(table, receipts))
    header = ["dataset", "table", "made from", "rows ok", "failed", "skipped", "size",
              "workers' time", "rows/s", "state"]  # fmt: skip
    details += [_options(f"head {h}", head_description(work, h)) for h in head_names(work)]
    made = ", ".join(f"{name} {version}" for name, version in versions.items())
    return tag(
        "section",
        tag("h2", "What was run"),
        html.table(header, rows, "Tables, in the order of their names"),
        tag("p", "Made with ", made or "versions that the tables do not tell", "."),
        tag("h3", "Options"),
        details,
        tag("h3", "Failures"),
        failures or tag("p", "Nothing failed, nothing was skipped."),
        id="run",
    )


def head_names(work: WorkDir) -> list[str]:
    """Heads of the work dir that are complete; of one whose head.json is broken a warning says so,
    and it is left out."""
    return [name for name in in_work(work) if not head_problem(work, name)]


def head_problem(work: WorkDir, name: str) -> str:
    """What is wrong with a head's head.json, with a warning of it; or nothing."""
    try:
        head_description(work, name)
    except RsaDataError as error:
        return left_out(name, error)
    return ""


def left_out(name: str, error: RsaDataError) -> str:
    """Warns that a head is broken; returns the sentence."""
    told = f"the head {name} is left out: {error}"
    warnings.warn(told, stacklevel=3)
    return told


def head_description(work: WorkDir, name: str) -> dict[str, Any]:
    """head.json as plain values; raises RsaDataError where it is broken."""
    where = f"heads/{name}/head.json"
    about = read(work.store.read(where) or b"", f"{work.store.location}/{where}")
    about.check_digest(f"{work.store.location}/{where}")
    return about.plain()


def _times(work: WorkDir, dataset: str, name: str) -> tuple[float | None, float | None]:
    """Rows a second of the last run over a table, and the seconds that its workers took."""
    events = logs.last_run(work, dataset, name)
    parts = [event.get("seconds") for event in events if event.get("event") == "part"]
    seconds = [value for value in parts if isinstance(value, (int, float))]
    return logs.rate(events), sum(seconds) if seconds else None


def _options(title: str, about: dict[str, Any]) -> Html:
    told = dict(about.get("options", {}))
    told |= {f"file: {name}": f"sha256 {sha[:16]}…" for name, sha in about.get("files", {}).items()}
    for key in ("schema_version", "stage_version", "parameters", "epochs_run"):
        if key in about:
            told[key.replace("_", " ")] = about[key]
    items = [(tag("dt", key), tag("dd", html.value(value))) for key, value in told.items()]
    return tag("details", tag("summary", title), tag("dl", items))


def _reasons(table: Table, receipts: list[Receipt]) -> Html:
    """Why rows failed or were skipped, how often, and the first samples of each reason."""
    if "error" not in _columns(table):
        skipped = sum(r.skipped for r in receipts)
        return tag("p", tag("strong", table.path), f": {skipped:,} rows skipped, as their input "
                   "did not end well.")  # fmt: skip
    bad = [r.part for r in receipts if r.failed or r.skipped]
    counted: Counter[str] = Counter()
    named: dict[str, list[str]] = {}
    for number in bad[:: -(-len(bad) // _LOOKED)]:
        rows = table.read(number, ["sample_id", "status", "error"])
        rows = rows.filter(pc.not_equal(rows["status"], "ok"))
        for row in rows.to_pylist():
            reason = f"{row['status']}: {_without(row['error'] or '', row['sample_id'])}"
            counted[reason] += 1
            named.setdefault(reason, []).append(row["sample_id"])
    shown = [
        [reason, f"{count:,}", ", ".join(named[reason][:_NAMED])]
        for reason, count in counted.most_common(_REASONS)
    ]
    if len(counted) > _REASONS:
        rest = sum(counted.values()) - sum(c for _, c in counted.most_common(_REASONS))
        shown.append([f"{len(counted) - _REASONS} other reasons", f"{rest:,}", ""])
    return html.table(["reason", "times", "for example"], shown, table.path)


def _columns(table: Table) -> list[str]:
    from ...store import schemas

    names: list[str] = schemas.schema(table.description().schema).names
    return names


def _without(error: str, sample_id: str) -> str:
    """An error without the name of its file, so that equal reasons count together."""
    stem = sample_id.rpartition("/")[2]
    head, colon, tail = error.partition(": ")
    return tail if colon and stem in head else error
