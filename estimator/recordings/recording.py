"""Measured signals on one clock, and their columns by name. Knows no file format, no model and no FMU.

SI inside, NaN for a missing sample. Sample k is taken at ``t0 + k * step``, or at its own time beside that where the
clock jitters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from estimator.errors import RecordingError, suggestion
from estimator.locked import Locked
from estimator.recordings.headers import assumed_unit, parse_header, plain, quantity_of
from estimator.recordings.units import FloatArray, Unit, examples, parse_unit, unit_of

MIN_SAMPLES = 10


@dataclass(frozen=True, eq=False)
class Recording(Locked):
    """Measured signals on one clock."""

    name: str  # file stem
    path: Path | None
    time: FloatArray  # (n,) s, exactly t0 + k * step if even, read-only
    step: float  # s, sampling interval; the mean one if not even
    signals: Mapping[str, FloatArray]  # column without its unit → (n,) SI, NaN = missing, read-only
    units: Mapping[str, str]  # column → SI unit; "" for a strange column without a unit, "?" for a unit not known
    headers: Mapping[str, str]  # column → header as written, "speed [rpm]"
    assumed_units: tuple[str, ...] = ()  # columns without a unit, taken as SI; "time" too
    unreadable: Mapping[str, str] = field(default_factory=dict)  # columns of text → what is wrong with them
    even: bool = True  # the times are equidistant
    missing_rows: int = 0  # rows that the file lacks, as its times show; their samples are NaN
    made: Mapping[str, str] = field(default_factory=dict)  # column that follows from others → from which
    not_read: tuple[str, ...] = ()  # what of the file's lines is left out, in sentences
    clock: str = "time [s]"  # header of the time, as written
    given_units: tuple[str, ...] = ()  # columns whose unit the user said, not their header; "time" too
    roles: Mapping[str, str] = field(default_factory=dict)  # role → column, as the user said
    motor: str | None = None  # whose rows these are, of a file whose rows are of several
    origin: float = 0.0  # s, what the file's clock shows where `time` is 0; not 0 where it counts from a date

    def __post_init__(self) -> None:
        """Lock arrays and mappings."""
        for array in (self.time, *self.signals.values()):
            array.setflags(write=False)
        super().__post_init__()

    @property
    def title(self) -> str:
        """The file's name, with its folder or its test where the recording's name has it, or the recording's name."""
        if self.path is None or self.name.endswith(self.path.name):
            return self.name
        test = self.name.removeprefix(f"{self.path.stem} ")
        return f"{self.path.name} {test}" if test != self.name else self.path.name

    def between(self, first: int, last: int) -> Recording:
        """Return the samples from one to before another."""
        part = slice(first, last)
        signals = {name: signal[part].copy() for name, signal in self.signals.items()}
        return replace(self, time=self.time[part].copy(), signals=signals)

    def in_unit(self, name: str) -> Recording:
        """Return the recording with a column in the unit that ``speed [rpm]`` says, if its header says none."""
        asked = parse_header(name)
        bare = [c for c, h in self.headers.items() if plain(c) == plain(asked.name) and not parse_header(h).unit_text]
        if asked.unit is None or not bare or bare[0] not in self.signals:
            return self
        column, unit = bare[0], asked.unit
        guessed = assumed_unit(column)
        written = self.signals[column] if guessed is None else guessed.from_si(self.signals[column])
        return replace(
            self,
            signals={**self.signals, column: unit.to_si(written)},
            units={**self.units, column: unit.si},
            headers={**self.headers, column: f"{column} [{asked.unit_text}]"},
            assumed_units=tuple(c for c in self.assumed_units if c != column),
            given_units=(*self.given_units, column),
        )

    def column(self, name: str) -> str:
        """Return the column that is meant by its name, ``speed``, or its header, ``speed [rpm]``.

        Raises
        ------
        RecordingError
            There is no such column, there are several, it holds text, or its unit is not the one asked for.
        """
        asked = parse_header(name)
        if asked.text in self.unreadable or asked.name in self.unreadable:
            raise RecordingError(self.unreadable.get(asked.text) or self.unreadable[asked.name])
        if asked.text in self.signals:
            return asked.text
        written = {" ".join(header.split()): column for column, header in self.headers.items()}
        if asked.text in written:
            return written[asked.text]
        taken = {column: parse_header(header) for column, header in self.headers.items()}
        same = [c for c, header in taken.items() if asked.name in (c, header.name)]
        same = same or [c for c, header in taken.items() if plain(header.name) == plain(asked.name)]
        if asked.unit_text is not None:
            of_unit = [c for c in same if asked.unit and asked.unit == (taken[c].unit or assumed_unit(c))]
            if len(of_unit) == 1:
                return of_unit[0]
            if same and taken[same[0]].unit_text is None:
                raise RecordingError(
                    f"{self.title} has no column {name!r}: {same[0]!r} is written without a unit; put it in the header"
                )
        elif len(same) == 1:
            return same[0]
        elif same:
            several = " or ".join(repr(self.headers[c]) for c in same)
            raise RecordingError(f"{self.title} has more than one column {name!r}; say which: {several}")
        raise RecordingError(f"{self.title} has no column {name!r}{suggestion(name, self.headers.values())}")

    def signal(self, name: str, *, unit: str | None = None) -> FloatArray:
        """Return a column's samples, (n,) SI, NaN = missing, for use where a unit is expected.

        Parameters
        ----------
        name
            The column, as for ``column``.
        unit
            What it is to be used as, such as ``"A"`` (any unit of that quantity will do); by default what a
            column of that name usually holds. A unit that this package does not know is not checked.

        Raises
        ------
        RecordingError
            No such column, its unit does not fit, or it has no samples at all.
        """
        column = self.column(name)
        wanted = parse_unit(unit) if unit else None
        if wrong := self.fault(column, wanted.quantity if wanted else quantity_of(column)):
            raise RecordingError(wrong)
        return self.signals[column]

    def fault(self, column: str, quantity: str | None) -> str | None:
        """Say why a column cannot be used as a quantity (None: any), or return None if it can."""
        if column in self.unreadable:
            return self.unreadable[column]
        header = parse_header(self.headers[column])
        if quantity is not None and header.unit_text is not None and self.units[column]:
            given = parse_unit(self.units[column])
            if given is None or given.quantity != quantity:
                known = "is not a known unit" if given is None else f"is no unit of {quantity}"
                return (
                    f"{self.title}: column {header.text!r}: {header.unit_text!r} {known};"
                    f" use one of {examples(quantity)}{_otherwise(given, quantity)}"
                )
        if np.isnan(self.signals[column]).all():
            return f"{self.title}: column {column!r} is empty; it should hold the measured samples"
        return None


def _otherwise(given: Unit | None, quantity: str) -> str:
    """Return how a way or a speed in metres is taken for the shaft's, or a sensor's volts for what it measures."""
    if given is not None and given.quantity == "voltage":
        return f", or say with --scale how many {unit_of(quantity).si} a volt is"
    if given is not None and (given.quantity, quantity) == ("electrical speed", "angular speed"):
        return ", or say with --unit w=rpm --scale w=0.25 that there are 4 pole pairs"
    if given is not None and (given.quantity, quantity) == ("time", "angular speed"):  # speed_ms
        return ", or say with --unit w=m/s --per-turn 0.16 that it is m/s, of a wheel of 0.16 m a turn"
    if given is None:
        return ", or say with --unit which it is"
    if (given.quantity, quantity) not in (("speed", "angular speed"), ("length", "angle")):
        return ""
    return ", or say with --per-turn how many metres a turn goes"
