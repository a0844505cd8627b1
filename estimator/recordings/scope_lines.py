"""Lines of an oscilloscope that counts its samples and says their interval once → lines with times. Knows no motor.

So Rigol's write: ``X,CH1,CH2,Start,Increment,`` above ``Sequence,Volt,Volt,-1.2e-01,1e-04,`` and ``0,1.2,0.4,,``.
"""

from __future__ import annotations

from estimator.recordings.text_cells import number_in

COUNTED, INTERVAL = ("x", "start", "increment"), "sequence"  # of its names, and of the units below them
AT = 2  # cells at the end: start, interval


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
