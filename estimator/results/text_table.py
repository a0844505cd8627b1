"""A table of texts: without its empty columns, and as aligned lines. Knows no estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class TextTable:
    """A header, rows of as many cells, and which columns are set flush right, by their places."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()

    def without_empty(self) -> TextTable:
        """Return the table without the columns that are empty below the header."""
        used = [k for k in range(len(self.header)) if any(row[k] for row in self.rows)]
        return TextTable(
            [self.header[k] for k in used],
            [[row[k] for k in used] for row in self.rows],
            [n for n, k in enumerate(used) if k in self.right],
        )

    def lines(self, width: int | None = None) -> list[str]:
        """Return aligned lines of the columns that are not empty.

        A table that is wider than `width` goes on below itself, with its first column again, of the rows that go on.
        """
        shown = self.without_empty()
        rows = [shown.header, *shown.rows]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        columns = range(len(widths))
        parts = [[*columns[:1]]]
        for k in columns[1:]:
            if width is not None and len(parts[-1]) > 1 and sum(2 + widths[j] for j in (*parts[-1], k)) - 2 > width:
                parts.append([0])
            parts[-1].append(k)
        lines: list[str] = []
        for part in parts:
            lines += [""] if lines else []
            for row in rows:
                if len(parts) > 1 and not any(row[k] for k in part[1:]):
                    continue
                cells = [row[k].rjust(widths[k]) if k in shown.right else row[k].ljust(widths[k]) for k in part]
                lines.append("  ".join(cells).rstrip())
        return lines
