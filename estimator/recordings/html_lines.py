"""An HTML page → lines whose cells tabs part, of its longest table. Knows no number, unit or motor.

Or a spreadsheet of XML, whose rows and cells have other names.
"""

from __future__ import annotations

from html.parser import HTMLParser

ROW, CELL = ("tr", "row"), ("td", "th", "cell")
BEGINNINGS = ("<?xml", "<workbook", "<!doctype html", "<html", "<table", "<head", "<body", "<meta", "<style", "<div")


def with_html_read(lines: list[str]) -> list[str]:
    """Return the rows of a page's longest table, each in the line where it begins if all have one; others unchanged."""
    first = next((line for line in lines if line.strip()), "")
    if not first.strip().lower().startswith(BEGINNINGS):
        return lines
    page = _Tables()
    page.feed("\n".join(lines))
    rows = max(page.tables, key=len, default=[])
    places = [line for line, _ in rows]
    if len(set(places)) < len(rows):  # several in a line
        places = list(range(len(rows)))
    written = [""] * max(len(lines), len(rows))
    for place, (_, cells) in zip(places, rows, strict=True):
        written[place] = "\t".join(" ".join(cell.split()) for cell in cells)
    return written


class _Tables(HTMLParser):
    """What stands in the cells of a page's tables; one within a cell is a table of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[list[tuple[int, list[str]]]] = []  # of rows: their line and their cells
        self._open: list[list[tuple[int, list[str]]]] = []
        self._is_in_cell = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a table, a row or a cell."""
        if tag == "table":
            self.tables.append([])
            self._open.append(self.tables[-1])
        elif tag in ROW and self._open:
            self._open[-1].append((self.getpos()[0] - 1, []))
        elif tag in CELL and self._open and self._open[-1]:
            self._open[-1][-1][1].append("")
        self._is_in_cell = tag in CELL or (self._is_in_cell and tag not in ("table", *ROW))

    def handle_endtag(self, tag: str) -> None:
        """End a table or a cell."""
        if tag == "table" and self._open:
            self._open.pop()
        self._is_in_cell = self._is_in_cell and tag not in ("table", *ROW, *CELL)

    def handle_data(self, data: str) -> None:
        """Add to the cell."""
        if self._is_in_cell and self._open and self._open[-1] and self._open[-1][-1][1]:
            self._open[-1][-1][1][-1] += data
