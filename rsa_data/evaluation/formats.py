"""A summary as plain text, Markdown, LaTeX or CSV."""

import csv
import io
from collections.abc import Callable, Sequence

from .known_metrics import metrics
from .metrics import Metric
from .summary import Row


def cells(rows: Sequence[Row], chosen: Sequence[Metric] | None = None) -> list[list[str]]:
    """Header and rows of text: dataset, method, images, then each metric.

    chosen : the metrics; by default those of narrow tables.
    """
    chosen = [m for m in metrics().values() if m.short] if chosen is None else chosen
    table = [["dataset", "method", "images", *(metric.heading for metric in chosen)]]
    for row in rows:
        table.append([row.shown, row.method, f"{row.images}", *(_cell(row, m) for m in chosen)])
    return table


def _cell(row: Row, metric: Metric) -> str:
    if metric.name not in row.mean:
        return "-"
    text = f"{row.mean[metric.name]:.{metric.digits}f}"
    if metric.name == "abs_rel" and row.low:
        low, high = (f"{side[metric.name]:.{metric.digits}f}" for side in (row.low, row.high))
        text += f" [{low}, {high}]"
    return text


def text(rows: Sequence[Row]) -> str:
    """For a terminal: columns aligned, the first two to the left."""
    table = cells(rows)
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    )


def markdown(rows: Sequence[Row]) -> str:
    """A pipe table of all metrics."""
    header, *body = cells(rows, list(metrics().values()))
    rule = ["---", "---", *["---:"] * (len(header) - 2)]
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, rule, *body]) + "\n"


def latex(rows: Sequence[Row]) -> str:
    """A booktabs tabular."""
    header, *body = cells(rows)
    lines = [r"\begin{tabular}{ll" + "r" * (len(header) - 2) + "}", r"\toprule"]
    lines += [" & ".join(_title(h) for h in header) + r" \\", r"\midrule"]
    before = body[0][0] if body else ""
    for row in body:
        if row[0] != before:
            lines.append(r"\midrule")
        before = row[0]
        lines.append(" & ".join(_escape(c) for c in row) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _title(title: str) -> str:
    if title.startswith("δ"):
        return rf"$\delta_{title[1]}$ $\uparrow$"
    return _escape(title).replace("↓", r"$\downarrow$").replace("↑", r"$\uparrow$")


def _escape(cell: str) -> str:
    for sign in "&%$#_{}":
        cell = cell.replace(sign, "\\" + sign)
    return cell


def to_csv(rows: Sequence[Row]) -> str:
    """Every number in full: mean, low and high of each metric."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    bounds = [f"{m}_{end}" for m in metrics() for end in ("low", "high")]
    writer.writerow(
        ["dataset", "method", "images", "failed", "scenes", *metrics(), *bounds, "synthetic"]
    )
    for row in rows:
        ends = [side.get(m, "") for m in metrics() for side in (row.low, row.high)]
        means = [row.mean.get(m, "") for m in metrics()]
        synthetic = "yes" if row.synthetic else "no"
        writer.writerow(
            [row.dataset, row.method, row.images, row.failed, row.scenes, *means, *ends, synthetic]
        )
    return file.getvalue()


FORMATS: dict[str, Callable[[Sequence[Row]], str]] = {
    "md": markdown,
    "tex": latex,
    "csv": to_csv,
    "txt": text,
}
