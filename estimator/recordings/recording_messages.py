"""What ROS prints of a topic's messages (`rostopic echo`, `ros2 topic echo`) → columns. Knows no unit and no motor.

A message is a block of `key: value` in YAML, three hyphens between two of them; its stamp is two whole numbers, of
seconds and nanoseconds. Values of a list that stands beside a list `name` are called by these: `left_wheel.velocity`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError
from estimator.recordings.columns import Columns
from estimator.recordings.named_columns import named_columns
from estimator.recordings.text_cells import is_number

FIRST = 1 << 16  # bytes within which the second message begins
MOST = 0.5  # of the messages: what fewer of them have is no signal
BEGINNING = re.compile(rb"\s*([A-Za-z_]\w*):[ \t\r\n]")
KEY = re.compile(r"([A-Za-z_]\w*):(?:\s+(.*))?")
SECONDS, NANOSECONDS = ("secs", "sec"), ("nsecs", "nanosec")

Way = tuple[str | int, ...]  # keys, and places in lists


def are_messages(path: Path, head: bytes) -> bool:
    """Whether a file begins as messages that ROS prints: two blocks with one first key, three hyphens between them."""
    first = BEGINNING.match(head)
    if first is None:
        return False
    with path.open("rb") as file:
        beginning = file.read(FIRST)
    return re.search(rb"\n---\r?\n\s*" + first[1] + rb":[ \t\r\n]", beginning) is not None


def read_messages(path: Path, head: bytes) -> Columns:
    """Read messages: a row of each, its stamp as the time, a column for each number.

    Raises
    ------
    RecordingError
        They hold no numbers.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    messages = [found for block in re.split(r"^---[ \t]*$", text, flags=re.M) if (found := _message(block))]
    not_read: tuple[str, ...] = ()
    if len(messages) > 1 and len(messages[-1]) < len(messages[-2]):
        messages.pop()
        not_read = ("the last message is cut off and left out",)
    counts = Counter(way for message in messages for way in message)
    often = [way for way, count in counts.items() if count > MOST * len(messages)]
    clock = next((way[:-1] for way in often if way[-1] in SECONDS), None)
    columns: dict[str, list[float]] = {}
    if clock is not None:
        columns["time [s]"] = [_seconds(message, clock) for message in messages]
    for way in often:
        values = [message.get(way, "") for message in messages]
        if (clock is None or way[:-1] != clock) and any(map(is_number, values)):
            columns[_header(way, messages[0], often)] = [float(x) if is_number(x) else np.nan for x in values]
    if columns.keys() <= {"time [s]"}:
        raise RecordingError(f"{path.name} holds messages of ROS without numbers; record a topic that has the signals")
    table = named_columns(path.name, columns, {})
    return Columns(table.headers, table.columns, table.texts, not_read)


def _message(block: str) -> dict[Way, str]:
    """Return a message's values by the keys and places that lead to them."""
    found: dict[Way, str] = {}
    items: Counter[Way] = Counter()
    above: list[tuple[int, str | int]] = []  # where a key or an item begins in its line, and what it is
    for line in block.split("\n"):
        text = line.strip()
        indent = len(line) - len(line.lstrip())
        is_item = text == "-" or text.startswith("- ")
        while above and (indent, is_item and isinstance(above[-1][1], str)) < (above[-1][0], True):
            above.pop()  # a list may begin where its key does
        if is_item:
            way = tuple(name for _, name in above)
            above.append((indent, items[way]))
            items[way] += 1
            text, indent = text[2:].strip(), indent + 2
        if (key := KEY.fullmatch(text)) is not None:
            above.append((indent, key[1]))
            text = key[2] or ""
        elif not is_item:
            continue
        way = tuple(name for _, name in above)
        if text.startswith("[") and text.endswith("]"):
            found |= {(*way, k): cell.strip(" '\"") for k, cell in enumerate(text[1:-1].split(",")) if cell.strip()}
        elif text:
            found[way] = text.strip("'\"")
    return found


def _seconds(message: Mapping[Way, str], clock: Way) -> float:
    """Return a message's stamp; NaN where it has none."""
    parts = {way[-1]: text for way, text in message.items() if way[:-1] == clock and text.isdecimal()}
    seconds, nanoseconds = (
        next((int(parts[key]) for key in keys if key in parts), None) for keys in (SECONDS, NANOSECONDS)
    )
    return np.nan if seconds is None else seconds + 1e-9 * (nanoseconds or 0)


def _header(way: Way, message: Mapping[Way, str], ways: Collection[Way]) -> str:
    """Return a value's name: keys with points between, the name beside a list or its place in it behind."""
    *before, last = way
    if isinstance(last, str):
        return ".".join(str(key + 1 if isinstance(key, int) else key) for key in way)
    path = ".".join(str(key + 1 if isinstance(key, int) else key) for key in before)
    names = (*before[:-1], "name")
    if (*names, last) in message:
        return f"{message[*names, last]}.{path}"
    return f"{path} {last + 1}" if (*before, 1) in ways else path
