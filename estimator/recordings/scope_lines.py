"""Lines of an oscilloscope that counts its samples and says their interval once → lines with times. Knows no motor.

So Rigol's write: ``X,CH1,CH2,Start,Increment,`` above ``Sequence,Volt,Volt,-1.2e-01,1e-04,`` and ``0,1.2,0.4,,``, or
``CH1V,CH2V,t0 = -0.1, tInc = 0.001,`` above ``1.2,0.4,``.
Others write a block of settings and bare numbers below it: Yokogawa's ``"TraceName","CH1","CH2"``, ``"VUnit","V","A"``,
``"HResolution","1e-04","1e-04"``; GW Instek's ``Source,CH1,Source,CH2,``, ``Sampling Period,1e-04,…`` (``Mode,Detail``:
a time before each sample; ``Mode,Fast``: counts of the converter).
"""

from __future__ import annotations

import re

from estimator.recordings.headers import parse_header, role_of
from estimator.recordings.text_cells import holds_numbers_only, number_in, split_cells

COUNTED, INTERVAL = ("x", "start", "increment"), "sequence"  # of its names, and of the units below them
AT = 2  # cells at the end: start, interval
SETTINGS = 60  # lines of them, at most
NAMES, UNITS, EVERY, BEGIN = (
    ("tracename", "source"),
    ("vunit", "vertical units"),
    ("hresolution", "sampling period"),
    "hoffset",
)
_START_AND_STEP = re.compile(r"(.*?),\s*t0\s*=\s*([^,\s]+?)s?\s*,\s*tInc\s*=\s*([^,\s]+?)s?[\s,]*", re.I)


def with_settings_read(lines: list[str]) -> list[str]:
    """Return bare numbers below a block of settings as rows with a time, below a header; other lines unchanged."""
    first = next((k for k, line in enumerate(lines[:SETTINGS]) if line.strip(', "') and holds_numbers_only(line)), 0)
    said: dict[str, list[str]] = {}
    for line in lines[:first]:
        key, *values = split_cells(line, ",")
        said[key.lower()] = [value for value in values if value and value != key]
    names, units, every = (next((said[key] for key in keys if said.get(key)), []) for keys in (NAMES, UNITS, EVERY))
    step = number_in(every[0], ".") if every else None
    if first < 2 or not names or not step:
        return lines
    start = number_in((said.get(BEGIN) or ["0"])[0], ".") or 0.0
    if "Fast" in said.get("mode", ()):
        names, units = [f"{name} raw" for name in names], []
    rows = [[cell for cell in split_cells(line, ",") if cell] for line in lines[first:]]
    if len(rows[0]) == 2 * len(names):
        timed = [",".join([*row[:1], *row[1::2]]) for row in rows]
    elif len(rows[0]) == len(names):
        timed = [",".join([f"{start + step * k:.12g}", *row]) if row else "" for k, row in enumerate(rows)]
    else:
        return lines
    header = [",".join(["time", *names]), ",".join(["s", *(units or ["-"] * len(names))])]
    return ["", *[""] * (first - 3), *header, *timed][-len(lines) :]


def with_times(lines: list[str]) -> list[str]:
    """Return the lines, the same number of them, with a time in the place of a count; unchanged if they are others."""
    names, units = (line.rstrip(", \t").split(",") if "," in line else [] for line in (*lines[:2], "", "")[:2])
    first, *channels = names[:-AT] or [""]
    if (first.strip().lower(), *(name.strip().lower() for name in names[-AT:])) != COUNTED or not channels:
        return lines
    start, step = (number_in(cell.strip(), ".") for cell in (*units[-AT:], "", "")[:AT])
    if units[0].strip().lower() != INTERVAL or len(units) != len(names) or start is None or not step:
        return lines
    kept = 1 + len(channels)
    timed = [",".join(["time", *channels]), ",".join(["s", *(unit.strip() for unit in units[1:kept])])]
    for line in lines[2:]:
        count, *cells = line.split(",")
        number = number_in(count.strip(), ".")
        timed.append(line if number is None else ",".join([f"{start + step * number:.12g}", *cells[: kept - 1]]))
    return timed


def with_start_and_step(lines: list[str]) -> list[str]:
    """Return rows below names that end in the start and the step, with their times; other lines unchanged."""
    found = _START_AND_STEP.fullmatch(lines[0]) if lines else None
    start, step = (number_in(text, ".") for text in found.groups()[1:]) if found else (None, None)
    if found is None or start is None or not step:
        return lines
    names = [re.sub(r"V$", " [V]", name.strip()) for name in found[1].split(",")]
    rows = [split_cells(bare, ",") if (bare := line.rstrip(", \t")) else [] for line in lines[1:]]
    channels = names[1:] if role_of(parse_header(names[0]).name) == "time" else names
    if len(rows[0] if rows else names) > len(channels):
        return [",".join(names), *(",".join(row) for row in rows)]
    timed = (",".join([f"{start + step * k:.12g}", *row]) if row else "" for k, row in enumerate(rows))
    return [",".join(["time [s]", *channels]), *timed]
