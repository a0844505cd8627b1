"""Lines of a table whose cells stand between bars → lines whose cells tabs part. Knows no number, unit or motor.

As Markdown (``| time | voltage |`` above ``|---|---:|``), psql (``time | voltage`` above ``-----+--------``) and mysql
(``+------+---------+`` about all) write them, and programs that part cells by bars alone.
"""

from __future__ import annotations

import re

MOST = 0.5  # of the lines that say anything: in more of them there are bars, equally many in all of these
_RULE = re.compile(r"[\s|+:=-]*[-=]{2}[\s|+:=-]*")  # a line that is drawn
_COUNT = re.compile(r"\s*\(?\d+ rows?( in set)?\b.*", re.I)  # below psql's and mysql's rows


def with_bars_read(lines: list[str]) -> list[str]:
    """Return the lines, the same number of them, with tabs for bars; unchanged where most have none."""
    said = [line for line in lines if line.strip() and not _RULE.fullmatch(line)]
    bars = [count for line in said if (count := line.strip().count("|"))]
    if not bars or len(bars) <= MOST * len(said) or bars.count(bars[0]) <= MOST * len(bars):
        return lines
    return ["" if _RULE.fullmatch(line) or _COUNT.fullmatch(line) else _parted(line) for line in lines]


def _parted(line: str) -> str:
    """Return a line's cells between tabs; without the bars at both of its ends."""
    text = line.strip()
    if "|" not in text:
        return line
    if text[0] == text[-1] == "|":
        text = text[1:-1]
    return "\t".join(cell.strip() for cell in text.split("|"))
