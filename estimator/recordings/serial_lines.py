"""What an Arduino prints, and its Serial Monitor or Plotter keeps → delimited text. Knows no unit and no motor.

millis:20 voltage:5.00 rpm:61.4    voltage:5.00,rpm:61.4    12:03:07.250 -> voltage:5.00 rpm:61    12:03:07.250 -> 5.00
t=0.02, v=5.00
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

LOOKED_AT = 50  # lines that show how all are written
_STAMP = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?)\s*->\s*")
_PAIR = re.compile(
    r"([^\W\d][^:=,;\t]*?)\s*[:=]\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|nan|ovf|inf)(?:[\s,;]+|$)", re.I
)


def are_serial(lines: Sequence[str]) -> bool:
    """Tell whether most of a file's first lines have labels, or the Monitor's stamps."""
    head = [line for line in lines[:LOOKED_AT] if line.strip()]
    return any(2 * sum(map(bool, map(kind, head))) > len(head) for kind in (_STAMP.match, _pairs))


def delimited_lines(lines: list[str], is_header: Callable[[Sequence[str]], bool]) -> tuple[list[str], bool]:
    """Return lines with labels as a header and a row for each line, or without; the Monitor's stamps as a first column.

    Lines that are written otherwise come back as they are, or empty where most others have labels.

    Parameters
    ----------
    lines
        A file's.
    is_header
        Whether labels hold the time: then the stamps, of a later clock, are left out.

    Returns
    -------
    lines, bool
        And whether a header was put in front of them.
    """
    if not are_serial(lines):
        return lines, False
    stamps = [found[1].replace(",", ".") if (found := _STAMP.match(line)) else "" for line in lines]
    pairs = [_pairs(line) for line in lines]
    if 2 * sum(map(bool, pairs)) <= sum(bool(line.strip()) for line in lines):
        return [_stamped(line) for line in lines], False
    shown = [k for k, found in enumerate(pairs) if found]
    for end, inner in {(shown[0], shown[1]), (shown[-1], shown[-2])} if len(shown) > 2 else ():
        if pairs[end].keys() != pairs[inner].keys():  # cut off where the log begins or ends
            pairs[end] = {}
    labels = list(dict.fromkeys(label for found in pairs for label in found))
    is_timed = is_header(labels) or not any(stamps)
    rows = [
        ",".join(([] if is_timed else [stamp]) + [found.get(label, "") for label in labels]) if found else ""
        for stamp, found in zip(stamps, pairs, strict=True)
    ]
    return [",".join(labels if is_timed else ["time", *labels]), *rows], True


def _pairs(line: str) -> dict[str, str]:
    """Return a line's values by their labels; none where it holds anything else."""
    text = line[found.end() :] if (found := _STAMP.match(line)) else line
    text = text.strip()
    pairs = {}
    while text:
        found = _PAIR.match(text)
        if found is None:
            return {}
        pairs[found[1]] = found[2] if found[2][-1].isdigit() or found[2][-1] == "." else ""
        text = text[found.end() :]
    return {} if len(pairs) == 1 and "=" in line else pairs  # a setting: "rate = 1000"


def _stamped(line: str) -> str:
    """Return a line of numbers with its stamp in front, or of names with the stamp's."""
    found = _STAMP.match(line)
    if found is None:
        return line
    rest = line[found.end() :].strip()
    mark = next((mark for mark in ";\t," if mark in rest), ",")
    return f"{found[1] if rest[:1] in '+-.0123456789' else 'time'}{mark}{rest}"
