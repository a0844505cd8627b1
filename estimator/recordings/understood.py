"""What was read of a recording: which column is which signal, in which unit, and who said so. Knows no FMU."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any, Literal

from estimator.recordings.headers import ROLE_QUANTITY, assumed_unit_text, parse_header, quantity_of
from estimator.recordings.recording import Recording
from estimator.recordings.units import examples, parse_unit, unit_of


@dataclass(frozen=True)
class Understood:
    """One signal as it was read.

    Attributes
    ----------
    signal : its name here, "w"
    column : its header as written, "speed [rpm]"
    unit : that the samples were taken to be in, "rpm"; "" for none
    unit_from : "header"; "user", who overruled it; "name", taken as usual for a column of that name; "made", as
        it follows from other columns; or "nobody"
    since : of a clock that counts from a date: when the first row was, "2026-11-21 12:03:07 UTC"
    """

    signal: str
    column: str
    unit: str
    unit_from: Literal["header", "user", "name", "nobody", "made"]
    since: str = ""

    @property
    def is_guess(self) -> bool:
        """Whether nobody said the unit."""
        return self.unit_from in ("name", "nobody")

    def text(self) -> str:
        """Return it as one reads it: ``w ← n (no unit: taken as rpm)``."""
        if self.since:
            return f"{replace(self, since='').text()}, from the first row on, at {self.since}"
        if self.unit_from == "name":
            return f"{self.signal} ← {self.column} (no unit: taken as {self.unit})"
        if self.unit_from == "nobody":
            return f"{self.signal} ← {self.column} (no unit)"
        return f"{self.signal} ← {self.column}" + (" (unit as you said)" if self.unit_from == "user" else "")

    def mapping(self) -> dict[str, Any]:
        """Return it for JSON, `since` where there is such a date."""
        return {name: value for name, value in asdict(self).items() if name != "since" or value}


def understood(recording: Recording, columns: Mapping[str, str]) -> tuple[Understood, ...]:
    """Return how columns of a recording, signal → column, were read, and its time last."""
    found = [_of(recording, signal, recording.headers[column], column) for signal, column in columns.items()]
    clock = _of(recording, "time", recording.clock, "time")
    return (*found, replace(clock, since=_since(recording.origin)) if recording.origin else clock)


def not_used(recording: Recording, columns: Collection[str]) -> tuple[str, ...]:
    """Return the headers of columns that are no signal and that none was made of."""
    sources = [part for c in columns for part in recording.made.get(c, "").split(" × ")]
    return tuple(
        h
        for c, h in recording.headers.items()
        if c not in columns and not any(part == h or part.startswith(f"{h}/") for part in sources)
    )


def _since(origin: float) -> str:
    """Return a clock's time as a date, counted from 1970; as seconds where that is none."""
    try:
        return f"{datetime.fromtimestamp(origin, tz=UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return f"{origin:.6g} s"


def how_to_overrule(read: Understood) -> str:
    """Return the option by which another unit is said: ``--unit w=deg/s``."""
    unit = parse_unit(read.unit)
    others = [] if unit is None else [text for text in examples(unit.quantity).split(", ") if text != read.unit]
    return f"--unit {read.signal}={others[0] if others else '…'}"


def _of(recording: Recording, signal: str, text: str, column: str) -> Understood:
    if column in recording.made:
        return Understood(signal, recording.made[column], recording.units[column], "made")
    header = parse_header(text)
    by_chance = header.name == text and recording.units.get(column) == ""  # a name such as pulse, of a voltage
    if header.unit_text is not None and not by_chance:
        return Understood(signal, text, header.unit_text, "user" if column in recording.given_units else "header")
    quantity = ROLE_QUANTITY.get(signal)
    is_its_name = quantity is None or quantity_of(header.name) == quantity  # a "current" may be said to be the speed
    usual = assumed_unit_text(header.name) if is_its_name else None
    usual = usual or (unit_of(quantity).si if quantity is not None else None)
    if usual is None:
        return Understood(signal, text, "", "nobody")
    return Understood(signal, text, usual, "name")
