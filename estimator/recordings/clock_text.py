"""Times of day and dates, as loggers print them → seconds since the first. Knows no files and no time zones' rules.

12:03:07.250    12:03:07:250    03:07.250    2026-11-21 12:03:07,250
2026-11-21T12:03:07.250Z    21.11.2026 12:03:07.250    11/21/2026 12:03:07 PM
0 days 00:00:07.250 (pandas)    7.25 sec (MATLAB)
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
    r"|(?P<days>\d+) days?"
    r"|\d{1,2}[- ][^\W\d_]{3,9}\.?[- ]\d{2,4}|[^\W\d_]{3,9}\.? \d{1,2},? \d{4}"
    r")[T ]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})|:(?P<thousandths>\d{3}))?(?:Z|[+-]\d{2}:?\d{2}|\s*(?P<half>[AaPp])[Mm])?"
)
_MINUTES = re.compile(r"(?P<minute>\d{1,2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})|:(?P<thousandths>\d{3}))")
_SECONDS = re.compile(r"(?P<second>\d+)(?:[.,](?P<fraction>\d{1,9}))? ?s(?:ec)?")
DAY, HOUR = 86_400, 3_600  # s


def seconds_since_first(cells: Iterable[str]) -> tuple[FloatArray, float] | None:
    """Return seconds, (n,), and half of the last printed digit; None if a cell is no such time.

    Cells are times of day, behind a date or days or alone, minutes and seconds, or seconds with their unit. A time of
    day that falls by over half a day has passed midnight, minutes that fall by over half an hour the hour. A date with
    slashes, a name of a month, or a year of two digits is left out: nobody knows which number is the month.
    """
    whole: list[int] = []
    nanoseconds: list[int] = []
    digits = 0
    for cell in cells:
        text = cell.strip().strip('"').strip()
        found = _TEXT.fullmatch(text) or _MINUTES.fullmatch(text) or _SECONDS.fullmatch(text)
        if found is None:
            return None
        told = found.groupdict()
        year, month, day = (told.get(a) or told.get(b) for a, b in (("y", "Y"), ("m", "M"), ("d", "D")))
        try:
            days = date(int(year), int(month), int(day)).toordinal() if year and month and day else 0
        except ValueError:
            return None
        days += int(told.get("days") or 0)
        hour, half = int(told.get("hour") or 0), told.get("half")
        if half:
            hour = hour % 12 + (12 if half in "Pp" else 0)
        seconds = days * DAY + hour * HOUR + int(told.get("minute") or 0) * 60 + int(told["second"])
        period = DAY if told.get("hour") else HOUR if told.get("minute") else 0  # after which it begins anew
        if whole and not days and period and seconds < whole[-1] - period // 2:
            seconds += period * ((whole[-1] - seconds + period // 2) // period)
        fraction = told["fraction"] or told.get("thousandths") or ""
        digits = max(digits, len(fraction))
        whole.append(seconds)
        nanoseconds.append(seconds * 10**9 + int(fraction.ljust(9, "0")))
    if not whole:
        return None
    since = np.array([(n - nanoseconds[0]) / 1e9 for n in nanoseconds])
    return since, 0.5 * 10.0**-digits
