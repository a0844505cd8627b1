"""Columns that follow from others: one motor of several, duty × supply, a wheel's way, encoder counts. Knows no file.

What a file logs is often not what a motor's model has: a duty cycle beside the battery's voltage, the speed of a wheel
in m/s, counts of an encoder. What is made is always reported.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from estimator.errors import RecordingError, suggestion
from estimator.recordings.headers import ASKED, motors_named, parse_header, plain, rank_in_role
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import Recording
from estimator.recordings.turns import OVERFLOW, counted_on
from estimator.recordings.units import FloatArray

DUTY = frozenset({"duty", "pwm", "dutycycle"})
SUPPLY = frozenset({"battery", "batt", "vbat", "vbatt", "bat", "supply", "vbus", "bus", "vs", "vcc", "vin", "vsupply"})
LEAST_PART, LEFT = 0.05, 0.5  # of the largest duty cycle; of the largest voltage: a supply's, though nothing is driven
FEW_LEVELS = 4  # fewer are no encoder's
FULL = 1.0 + 1e-9  # of a duty cycle without a unit: up to here it is a part of the supply


def with_made_columns(recording: Recording, read_as: ReadAs) -> Recording:
    """Return a recording with what follows from its columns and from what the user says.

    Raises
    ------
    RecordingError
        There is no such motor or supply, or nothing that a number of counts or metres a turn fits.
    """
    recording = _one_motor(recording, read_as.motor)
    if read_as.per_turn is not None:
        recording = _turned(recording, read_as.per_turn)
    if read_as.counts is not None:
        recording = _counted(recording, read_as.counts)
    return _driven(recording, read_as.supply)


def with_constant_voltage(recording: Recording, volts: float) -> Recording:
    """Return a recording with a voltage that is in none of its columns, V.

    Raises
    ------
    RecordingError
        It has a voltage.
    """
    logged = recording.roles.get("v") or next(iter(_voltages(recording, ())), None)
    if logged is not None:
        raise RecordingError(
            f"{recording.title} has a voltage, {recording.headers.get(logged, logged)!r}; leave --fix v out, or the"
            " column out of the file"
        )
    name = f"{volts:g} V"
    made = _with(recording, name, np.full(len(recording.time), volts), "V", f"{name}, constant, as you said")
    return replace(made, roles={**made.roles, "v": name}, given_units=(*made.given_units, name))


def motors(recording: Recording) -> tuple[str, ...]:
    """Return the motors whose signals lie side by side: ``("left", "right")``; empty for one."""
    return motors_named([parse_header(header).name for header in recording.headers.values()])


def _one_motor(recording: Recording, motor: str | None) -> Recording:
    """Return the columns of one motor, and those that are no motor's."""
    if motor is None or recording.motor is not None:
        return recording
    known = motors(recording)
    if not known:
        raise RecordingError(f"{recording.title} holds one motor, no {motor!r}; leave the motor out")
    if plain(motor) not in known:
        raise RecordingError(f"{recording.title} has no motor {motor!r}{suggestion(motor, known)}")
    others = set(known) - {plain(motor)}

    def is_its(column: str) -> bool:
        return not others & set(plain(parse_header(recording.headers[column]).name).split("_"))

    return replace(
        recording,
        name=f"{recording.name} {motor}",
        signals={c: y for c, y in recording.signals.items() if is_its(c)},
        units={c: u for c, u in recording.units.items() if is_its(c)},
        headers={c: h for c, h in recording.headers.items() if is_its(c)},
        unreadable={c: w for c, w in recording.unreadable.items() if is_its(c)},
    )


def _turned(recording: Recording, per_turn: float) -> Recording:
    """Return linear speeds and ways as angular ones."""
    linear = {"m/s": "rad/s", "m": "rad"}
    columns = [c for c in recording.signals if recording.units[c] in linear]
    if not columns:
        raise RecordingError(f"{recording.title} has no column in m/s or m, which --per-turn is for; leave it out")
    for column in columns:
        turned = recording.signals[column] * (2 * math.pi / per_turn)
        unit = linear[recording.units[column]]
        recording = _with(recording, column, turned, unit, f"{recording.headers[column]}, {per_turn:g} m a turn")
    return recording


def _counted(recording: Recording, counts: float) -> Recording:
    """Return an encoder's counts as an angle, and counts a second as a speed."""
    rates = [c for c in recording.signals if recording.units[c] == "count/s"]
    columns = [c for c in recording.signals if is_counts(recording, c)]
    if not columns and not rates:
        columns = [c for c in recording.signals if recording.roles.get("angle") == c]
    if not columns and not rates:
        known = ", ".join(recording.headers.values())
        raise RecordingError(f"{recording.title} has no column of counts ({known}); say which, with --column angle=…")
    for column in (*columns, *rates):
        counted, bits = (recording.signals[column], None) if column in rates else counted_on(recording.signals[column])
        unit = "rad/s" if column in rates else "rad"
        source = f"{recording.headers[column]}, {counts:g} counts a turn" + (
            f", {OVERFLOW.format(bits)}" if bits else ""
        )
        recording = _with(recording, column, counted * (2 * math.pi / counts), unit, source)
    if "angle" not in recording.roles and len(columns) == 1:
        recording = replace(recording, roles={**recording.roles, "angle": columns[0]})
    if "w" not in recording.roles and len(rates) == 1 and not _speeds(recording):
        recording = replace(recording, roles={**recording.roles, "w": rates[0]})
    return recording


def _speeds(recording: Recording) -> list[str]:
    """Return the columns that have a speed's name."""
    return [c for c, text in recording.headers.items() if rank_in_role(parse_header(text).name, "w") is not None]


def is_counts(recording: Recording, column: str) -> bool:
    """Return whether a column seems to hold an encoder's counts."""
    words = set(plain(parse_header(recording.headers[column]).name).split("_"))
    bare = recording.units[column] in ("", "count")
    if column in recording.signals and len(np.unique(recording.signals[column])) < FEW_LEVELS:
        return False  # a pulse generator's signal
    return bare and (
        recording.units[column] == "count" or bool(words & {"encoder", "enc", "ticks", "counts", "pulses"})
    )


def duty_column(recording: Recording, *, units: Collection[str] = ("", "1", "count", "?")) -> str | None:
    """Return the column of a duty cycle, a measured one before a commanded one; None if there is none.

    Parameters
    ----------
    units : of what is looked for: in "V", "duty_V", it is a voltage
    """
    found = [c for c in recording.signals if DUTY & _words(recording, c) and recording.units[c] in units]
    return min(
        found, key=lambda c: bool((ASKED | {"command", "commanded", "cmd"}) & _words(recording, c)), default=None
    )


def _driven(recording: Recording, supply: str | None) -> Recording:
    """Return a recording with the voltage that a duty cycle and its supply make, where none was logged."""
    duty = recording.roles.get("v") if supply is not None else None
    duty = duty or duty_column(recording)
    if duty is None or (supply is None and "v" in recording.roles):
        if supply is not None:
            known = ", ".join(recording.headers.values())
            raise RecordingError(
                f"{recording.title} has no duty cycle ({known}); say which column it is, with --column v=…"
            )
        return recording
    supplies = [
        c
        for c in recording.signals
        if c != duty and _is_voltage(recording, c) and (SUPPLY & _words(recording, c) or stays(recording, c))
    ]
    if supply is None and (_voltages(recording, supplies) or len(supplies) != 1):
        return recording  # what is missing is said where the voltage is looked for
    volts, source = _supply(recording, supply or supplies[0])
    part = recording.signals[duty]
    bare = recording.units[duty] != "1" and "/" not in (supply or "")
    if bare and float(np.nanmax(np.abs(part), initial=0.0)) > FULL:
        if supply is None:
            return recording
        full = float(np.nanmax(np.abs(part)))
        raise RecordingError(
            f"{recording.title}: {recording.headers[duty]!r} goes up to {full:g}, so it is no part of the supply: say"
            f" how many of it are all, with --supply {supply}/{_full_scale(full):g}"
        )
    name = f"{duty} × {source}"
    made = _with(recording, name, part * volts, "V", f"{recording.headers[duty]} × {source}")
    return replace(made, roles={**made.roles, "v": name})


def _full_scale(largest: float) -> float:
    return next((full for full in (100.0, 255.0, 1000.0, 1023.0, 4095.0, 65535.0) if largest <= full), largest)


def _supply(recording: Recording, text: str) -> tuple[FloatArray | float, str]:
    """Return the volts of a whole duty cycle, or of a count, and what they are called."""
    name, slash, counts = text.rpartition("/") if "/" in text else (text, "", "1")
    try:
        full = float(counts)
        volts: FloatArray | float = float(name)
    except ValueError:
        try:
            full = float(counts)
        except ValueError:
            raise RecordingError(
                f"--supply {text}: {counts!r} is not a number; write 12, 12/255 or battery/255"
            ) from None
        volts = recording.signals[recording.column(name)]
        name = recording.headers[recording.column(name)]
    if not 0 < full < math.inf:
        raise RecordingError(f"--supply {text}: {counts!r} is not above 0; write 12, 12/255 or battery/255")
    if isinstance(volts, float) and not 0 < abs(volts) < math.inf:
        raise RecordingError(f"--supply {text}: a supply has volts; write 12, 12/255 or battery/255")
    return volts / full, f"{name}{slash}{counts if slash else ''}" + (" V" if isinstance(volts, float) else "")


def _voltages(recording: Recording, supplies: Sequence[str]) -> list[str]:
    """Return the columns that are a motor's voltage and not its supply's."""
    return [
        c
        for c, header in recording.headers.items()
        if c not in supplies
        and rank_in_role(parse_header(header).name, "v") is not None
        and _is_voltage(recording, c)
        and not DUTY & _words(recording, c)
    ]


def _is_voltage(recording: Recording, column: str) -> bool:
    name = parse_header(recording.headers[column]).name
    return recording.units.get(column) in ("V", "") and rank_in_role(name, "i") is None


def stays(recording: Recording, column: str) -> bool:
    """Return whether a voltage is there though the duty cycle beside it goes to 0: then it is the supply's."""
    duty = duty_column(recording)
    named = rank_in_role(parse_header(recording.headers[column]).name, "v") is not None
    if duty is None or duty == column or not named or column not in recording.signals:
        return False
    part, volts = np.abs(recording.signals[duty]), recording.signals[column]
    least, largest = np.nanmin(volts, initial=np.inf), np.nanmax(volts, initial=0.0)
    return bool(np.nanmin(part) <= LEAST_PART * np.nanmax(part) > 0 and least > LEFT * largest > 0)


def _words(recording: Recording, column: str) -> frozenset[str]:
    return frozenset(plain(parse_header(recording.headers[column]).name).split("_"))


def _with(recording: Recording, column: str, samples: FloatArray, unit: str, source: str) -> Recording:
    """Return a recording with a column that was made."""
    return replace(
        recording,
        signals={**recording.signals, column: samples},
        units={**recording.units, column: unit},
        headers={**recording.headers, column: recording.headers.get(column, column)},
        made={**recording.made, column: source},
        assumed_units=tuple(c for c in recording.assumed_units if c != column),
    )
