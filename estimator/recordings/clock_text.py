"""Times of day and dates, as loggers print them → seconds since the first. Knows no files and no time zones' rules.

12:03:07.250    12:03:07:250    03:07.250    2026-11-21 12:03:07,250
2026-11-21T12:03:07.250Z    21.11.2026 12:03:07.250    11/21/2026 12:03:07 PM
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import date

import numpy as np

from estimator.recordings.units import FloatArray

_TEXT = re.compile(
    r"(?:(?:(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})|(?P<D>\d{1,2})\.(?P<M>\d{1,2})\.(?P<Y>\d{4})"
    r"|\d{1,2}(?P<mark>[-/.])\d{1,2}(?P=mark)\d{2,4}|\d{8}"
    r"|\d{1,2}[- ][^\W\d_]{3,9}\.?[- ]\d{2,4}|[^\W\d_]{3,9}\.? \d{1,2},? \d{4}"
    r")[T ]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})|:(?P<thousandths>\d{3}))?(?:Z|[+-]\d{2}:?\d{2}|\s*(?P<half>[AaPp])[Mm])?"
)
_MINUTES = re.compile(r"(?P<minute>\d{1,2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})|:(?P<thousandths>\d{3}))")
DAY, HOUR = 86_400, 3_600  # s


def seconds_since_first(cells: Iterable[str]) -> tuple[FloatArray, float] | None:
    """Return seconds, (n,), and half of the last printed digit; None if a cell is no such time.

    A time of day that falls by over half a day has passed midnight, minutes that fall by over half an hour the hour. A
    date with slashes, a name of a month, or a year of two digits is left out: nobody knows which number is the month.
    """
    whole: list[int] = []
    nanoseconds: list[int] = []
    digits = 0
    for cell in cells:
        text = cell.strip().strip('"').strip()
        if (found := _TEXT.fullmatch(text)) is not None:
            year, month, day = (found[a] or found[b] for a, b in (("y", "Y"), ("m", "M"), ("d", "D")))
            hour, half, period = int(found["hour"]), found["half"], DAY
        elif (found := _MINUTES.fullmatch(text)) is not None:
            year = month = day = half = None
            hour, period = 0, HOUR
        else:
            return None
        try:
            days = date(int(year), int(month), int(day)).toordinal() if year else 0
        except ValueError:
            return None
        if half:
            hour = hour % 12 + (12 if half in "Pp" else 0)
        seconds = days * DAY + hour * HOUR + int(found["minute"]) * 60 + int(found["second"])
        if whole and not year and seconds < whole[-1] - period // 2:
            seconds += period * ((whole[-1] - seconds + period // 2) // period)
        fraction = found["fraction"] or found["thousandths"] or ""
        digits = max(digits, len(fraction))
        whole.append(seconds)
        nanoseconds.append(seconds * 10**9 + int(fraction.ljust(9, "0")))
    if not whole:
        return None
    since = np.array([(n - nanoseconds[0]) / 1e9 for n in nanoseconds])
    return since, 0.5 * 10.0**-digits
