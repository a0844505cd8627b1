"""Numbers as text: the digits that a standard error leaves, percent, powers of ten. Knows no estimate."""

from __future__ import annotations

import math

VALUE_DIGITS = 9  # at most: beyond that a noise-free fit prints its rounding errors
UNKNOWN_ERROR_DIGITS = 6  # of a value whose standard error is not known
ABSENT = "-"


def value_texts(value: float, standard_error: float | None) -> tuple[str, str]:
    """Return value and standard error as text, the error with two digits and the value to the same place.

    A value that would be rounded to 0 has two digits, too.

    The error's text is empty when it is not known.

    >>> value_texts(3.13712, 0.00234)
    ('3.1371', '0.0023')
    >>> value_texts(9.0012e-6, 2.5e-9)
    ('9.0012e-06', '2.5e-09')
    >>> value_texts(0.0435, 442)
    ('0.043', '442')
    """
    if not math.isfinite(value):
        return ABSENT, ""
    if standard_error is None or not math.isfinite(standard_error) or standard_error < 0:
        return number_text(value), ""
    power = magnitude(value)
    place = magnitude(float(f"{standard_error:.1e}")) - 1 if standard_error > 0 else -math.inf
    fewest = 1 if value != 0 and power < place else 0  # else it would be shown as 0
    digits = int(min(max(power - place, fewest), VALUE_DIGITS - 1))  # after the first one
    if _scientific(value):
        return f"{value:.{digits}e}", f"{standard_error:.1e}"
    decimals = max(digits - power, 0) if place < 0 or fewest else 0
    shown = f"{value:.{decimals}f}"
    if -8 <= place <= 2 and decimals >= -place:
        return shown, f"{standard_error:.{max(-int(place), 0)}f}"
    return shown, f"{standard_error:.1e}"


def number_text(value: float, *, digits: int = UNKNOWN_ERROR_DIGITS) -> str:
    """Return a number with at most so many digits, without trailing zeros, in the notation of `value_texts`.

    >>> number_text(1.69e-4)
    '1.69e-04'
    """
    if not _scientific(value):
        return f"{value:.{digits}g}"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{exponent}"


def relative_text(standard_error: float | None, value: float) -> str:
    """Return ``"0.12 %"``, empty when it cannot be said."""
    if standard_error is None or not math.isfinite(standard_error) or not math.isfinite(value) or value == 0:
        return ""
    percent = 100 * standard_error / abs(value)
    return (f"{percent:.2g} %" if 1e-3 <= percent < 1e3 else f"{percent:.0e} %") if percent else "0 %"


def deviation_text(value: float, nominal: float) -> str:
    """Return ``"+0.12 %"``, the deviation of a value from its nominal one."""
    if not math.isfinite(value) or not math.isfinite(nominal) or nominal == 0:
        return ""
    percent = 100 * (value - nominal) / abs(nominal)
    if percent == 0:
        return "0 %"
    return f"{percent:+.2f} %" if 0.01 <= abs(percent) < 1000 else f"{percent:+.1g} %"


def finite_text(value: float, form: str) -> str:
    """Return a number in a format; ABSENT where it is none."""
    return format(value, form) if math.isfinite(value) else ABSENT


def counted(number: int, thing: str) -> str:
    """Return a number and its noun.

    >>> counted(12000, "step")
    '12 000 steps'
    """
    return f"{number:,} {thing}{'' if number == 1 else 's'}".replace(",", " ")


def _scientific(value: float) -> bool:
    """Whether a value is written with a power of ten."""
    return math.isfinite(value) and not -3 <= magnitude(value) <= 5


def magnitude(value: float) -> int:
    """Power of ten of the first digit; 0 for 0."""
    return int(f"{abs(value):e}".partition("e")[2]) if value else 0
