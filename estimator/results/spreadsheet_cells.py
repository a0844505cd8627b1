"""Texts as cells of a table that a spreadsheet opens. Knows no results."""

from __future__ import annotations

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # how a cell begins that a spreadsheet would compute


def harmless(cell: object) -> object:
    """Return a cell of a CSV file; a text that a spreadsheet would take for a formula gets an apostrophe before it.

    Names come from others: from motors' tables, case files and FMUs.

    >>> harmless("=cmd|' /C calc'!A0"), harmless("motor 1"), harmless(-1.5)
    ("'=cmd|' /C calc'!A0", 'motor 1', -1.5)
    """
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell
