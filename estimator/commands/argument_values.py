"""How the values of the command line's options are read. Knows argparse only."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable

from estimator.errors import SIZES, is_sized


def assignment(text: str) -> tuple[str, float]:
    """Read ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not name.strip() or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as L=0.013")
    return name.strip(), _number(value, of=text)


def start(text: str) -> dict[str, float] | str:
    """Read ``NAME=VALUE,NAME=VALUE``, or a file's name: its absolute path."""
    if os.path.exists(text) or "=" not in text:
        if not os.path.isfile(text):
            raise argparse.ArgumentTypeError(f"there is no file {text!r}; give one, or NAME=VALUE,NAME=VALUE")
        return os.path.abspath(text)
    return dict(assignment(part) for part in text.split(","))


def text_assignment(example: str) -> Callable[[str], tuple[str, str]]:
    """Return what reads ``NAME=TEXT``, such as the example."""

    def read(text: str) -> tuple[str, str]:
        name, _, value = text.partition("=")
        if not name.strip() or not value.strip():
            raise argparse.ArgumentTypeError(f"{text!r} is not NAME=TEXT, such as {example}")
        return name.strip(), value.strip()

    return read


def share(text: str) -> float:
    """Read a probability between 0 and 1, both left out."""
    value = _number(text, of=text)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no probability between 0 and 1, such as 0.01")
    return value


def percentage(text: str) -> float:
    """Read a percentage of zero or more, with or without its sign."""
    value = _number(text.strip().removesuffix("%").strip(), of=text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is below zero; give a percentage such as 2")
    return value


def named_text(text: str) -> tuple[str, str]:
    """Read ``NAME=TEXT``, or a name alone."""
    name, equals, value = text.partition("=")
    if not name.strip() or (equals and not value.strip()):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as 'i gain=1 %'")
    return name.strip(), value.strip()


def bounds(text: str) -> tuple[str, tuple[float, float]]:
    """Read ``NAME=LOWER:UPPER``."""
    name, equals, both = text.partition("=")
    lower_text, colon, upper_text = both.partition(":")
    if not name.strip() or not equals or not colon:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=LOWER:UPPER, such as R=0.1:5")
    lower, upper = _number(lower_text, of=text), _number(upper_text, of=text)
    if lower > upper:
        raise argparse.ArgumentTypeError(f"{text!r} is upside down; write {name}={upper_text}:{lower_text}")
    if lower == upper:
        raise argparse.ArgumentTypeError(f"{text!r} leaves no room; use --fix {name}={lower_text}")
    return name.strip(), (lower, upper)


def window(text: str) -> tuple[float, float]:
    """Read ``FROM:TO``."""
    first, colon, last = text.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"{text!r} is not FROM:TO, such as 0.4:2.0")
    low, high = _number(first, of=text), _number(last, of=text)
    if low >= high:
        raise argparse.ArgumentTypeError(f"{text!r} ends before it begins; write {last}:{first}")
    return low, high


def temperature(text: str) -> float:
    """Read a temperature in degrees Celsius."""
    from estimator.motor.winding import COLDEST, HOTTEST

    value = _number(text, of=text)
    if not COLDEST < value < HOTTEST:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no temperature of a winding; give degrees Celsius, above {COLDEST:g} and below {HOTTEST:g}"
        )
    return value


def case_file(text: str) -> str:
    """Read the name of a case file."""
    if not text.endswith(".case.toml"):
        raise argparse.ArgumentTypeError(f"{text!r}: the name of a case file ends in .case.toml; rename it")
    return text


def level_at(text: str) -> tuple[float, float]:
    """Read ``VOLTAGE@TIME``."""
    level, at, time = text.partition("@")
    if not at:
        raise argparse.ArgumentTypeError(f"{text!r} is not VOLTAGE@TIME, such as 10.5@0.5")
    return _number(level, of=text), _number(time, of=text)


def _number(text: str, *, of: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        where = "" if text == of else f" in {of!r}"
        raise argparse.ArgumentTypeError(f"{text!r}{where} is not a number; write it as 0.013 or 1.3e-2")
    if not is_sized(value):
        raise argparse.ArgumentTypeError(f"{text!r} must be {SIZES}")
    return value


def path(text: str) -> str:
    """Read a name."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f"{text!r} names nothing; give a name")
    return text


def metres(text: str) -> float:
    """Read a length in m, with its unit or without."""
    return positive(text.strip().removesuffix("m").strip() or text)


def positive(text: str) -> float:
    """Read a number above 0."""
    value = _number(text, of=text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not positive; give a number above 0")
    return value


def whole(least: int) -> Callable[[str], int]:
    """Return what reads a whole number of at least `least`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {least}")
        return value

    return read


def names(text: str) -> list[str]:
    """Read names between commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def fmi(text: str) -> int:
    """Read a version of FMI."""
    if text not in ("2", "3"):
        raise argparse.ArgumentTypeError(f"{text!r} is no version of FMI that can be built; use --fmi 2 or --fmi 3")
    return int(text)
