"""Plain text tables for terminals."""

from typing import Any


def table_lines(header: list[str], rows: list[list[Any]]) -> list[str]:
    """A plain text table: first column left, the others right."""
    cells = [header, *[["" if c is None else str(c) for c in row] for row in rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    return [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
