"""Which columns of a recording are a motor's voltage, current, speed, angle and load: by usual names and units."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches

import numpy as np

from estimator.errors import RecordingError, SeveralMotorsError
from estimator.recordings.headers import (
    ASKED,
    ROLE_QUANTITY,
    ROLE_TITLE,
    USUAL_NAMES,
    Header,
    absolute_of,
    assumed_unit,
    is_secondary,
    motors_named,
    parse_header,
    plain,
    rank_in_role,
)
from estimator.recordings.made_columns import SUPPLY, duty_column, stays
from estimator.recordings.recording import Recording

SAME, FEW = 0.02, 0.05  # of the span, of the samples: columns that differ by less are one signal
DRIVE, VOLTS = frozenset({"u", "v", "input"}), frozenset({"volt", "volts"})  # "final_u", "input signal", "sig_volt"
SYMBOL = re.compile(r"[uv]_?[a-z0-9]$")  # a voltage's with an index, "Ud", "u_a": suggested, not taken
# A scope's: its unit alone tells the signal.
CHANNEL = re.compile(r"(c|ch|chan|channel|kanal|ain|analog|probe)_?[0-9a-d]+$|[0-9]+$")


def motor_columns(
    recording: Recording, *, required: Sequence[str] = ("v", "i", "w"), either: Sequence[str] = ()
) -> dict[str, str]:
    """Find which columns are a motor's voltage, current, speed, angle and load, by usual names and units.

    Parameters
    ----------
    recording
        The recording.
    required
        The roles that must be there; an angle will do for the speed.
    either
        Roles of which one is enough, unless a column seems to be meant for another.

    Returns
    -------
    dict
        Role (``v``, ``i``, ``w``, ``angle``, ``load``) → column, only for what is there.

    Raises
    ------
    RecordingError
        A required column is missing, empty or text, its unit does not fit, or two columns that differ have its name.
    """
    found: dict[str, str] = {}
    for role in ROLE_QUANTITY:
        column = None if role == "time" else _of_role(recording, role, wanted=role in (*required, *either))
        if column is not None:
            found[role] = column
    if "w" in either and not {"w", "angle"} & found.keys() and (counts := counting(recording, found.values())):
        raise RecordingError(_lines_of_an_encoder(recording, counts))
    lacking = [role for role in (*required, *either) if role not in found and not (role == "w" and "angle" in found)]
    for role in lacking:
        if unsigned := _without_sign(recording, role):
            raise RecordingError(
                f"{recording.title}: {unsigned!r} is a {ROLE_TITLE[role]} without its sign, and its noise about zero is"
                " all on one side; log it with its sign, or, where it never turns, say so with --column"
                f" {shlex.quote(f'{role}={unsigned}')}"
            )
    meant = {role: _meant(recording, role, found.values(), by_unit=role in either or role == "v") for role in lacking}
    nothing = bool(either) and not {*either, "angle"} & found.keys()
    missing = [role for role in lacking if role in required or meant[role] or nothing]
    if missing:
        raise RecordingError(_missing(recording, missing, meant, nothing=nothing))
    return found


def _of_role(recording: Recording, role: str, *, wanted: bool) -> str | None:
    """Return the column of a role, as the user said or by its usual names; refuse a bad one where it is wanted."""
    quantity = ROLE_QUANTITY[role]
    if role in recording.roles:
        column = recording.roles[role]
        if recording.units.get(column) != "V" and (fault := recording.fault(column, quantity)):
            raise RecordingError(fault)  # a factor may tell what a sensor's volts are
        return column
    ranked = sorted(
        (rank, column)
        for column in [*recording.signals, *recording.unreadable]
        if (rank := rank_in_role(parse_header(recording.headers[column]).name, role)) is not None
        and column not in recording.roles.values()
        and not _counts_rows(recording, column)
        and not (column in recording.unreadable and is_secondary(column))  # a command in words: "stop"
        and not (role == "v" and stays(recording, column))
    )
    faults = {column: recording.fault(column, quantity) for _, column in ranked}
    fitting = [(rank, column) for rank, column in ranked if faults[column] is None]
    good = [
        column
        for *_, column in sorted(fitting, key=lambda r: (r[0], _stands_still(recording, r[1]), is_secondary(r[1])))
    ]
    if role == "v" and not ranked and (told := duty_column(recording, units=("V",))) is not None:
        return told
    if good and role == "i" and (asked := _asked_beside(recording, good[0])) is not None:
        raise RecordingError(_present(recording, good[0], asked))
    if good and wanted and (other := _rival(recording, good)) is not None:
        if _motors(recording, good) and (several := _motors(recording, recording.headers)):
            raise SeveralMotorsError(_several(recording, several), several)
        raise RecordingError(_two(recording, role, good[0], other))
    if ranked and not good and wanted:
        first = ranked[0][1]
        is_rate = recording.units.get(first) == "count/s" and role == "w"
        raise RecordingError(_lines_of_an_encoder(recording, first) if is_rate else faults[first] or "")
    return good[0] if good else None


def _missing(recording: Recording, missing: Sequence[str], meant: Mapping[str, Sequence[str]], *, nothing: bool) -> str:
    """Say that the first role has no column, and which may be meant; `nothing`: no other is there that would do."""
    role = missing[0]
    near = meant[role]
    columns = ", ".join(recording.headers.values())
    if role == "v" and (duty := duty_column(recording)) is not None:
        return (
            f"{recording.title} has no voltage column ({columns}), but {recording.headers[duty]!r} is a duty cycle: say"
            " of which supply, with --supply 12 (volts), --supply 12/255 (volts a count), or --supply and the battery's"
            " column"
        )
    remedy = f"; is it {near[0]!r}?" if near else f"; add one such as {_example(role)!r}, or map it in a case file"
    if role == "v" and not near:
        remedy += ", or estimate with --fix v=VOLTS where it was constant"
    options = " or ".join(f"--column {name}=…" for name in ("i", "w") if name == role or (nothing and role == "i"))
    named = [f"--column {shlex.quote(f'{other}={meant[other][0]}')}" for other in missing if meant[other]]
    column = " ".join(named) if near else options or f"--column {role}=…"
    return f"{recording.title} has no {ROLE_TITLE[role]} column{remedy} ({columns}); say which it is with {column}"


def _words(text: str) -> set[str]:
    return set(plain(text).split("_"))


def _counts_rows(recording: Recording, column: str) -> bool:
    """Return whether a column without a unit counts the rows: an ``n`` that is no speed."""
    samples = recording.signals.get(column)
    return column in recording.assumed_units and samples is not None and _is_counter(recording, column)


def _is_counter(recording: Recording, column: str) -> bool:
    unit = assumed_unit(column)
    written = recording.signals[column] if unit is None else unit.from_si(recording.signals[column])
    known = written[~np.isnan(written)]
    return len(known) > 2 and bool(np.all(np.abs(np.diff(known) - 1) < 1e-6))


def _rival(recording: Recording, columns: Sequence[str]) -> str | None:
    """Return a column that could as well be the signal as the first and is not the same signal once more.

    A command beside a measurement, a filtered signal beside a raw one, one name in two units and a column that does
    nothing are no rivals.
    """
    first, *others = columns
    one = recording.signals[first]
    for other in others:
        two = recording.signals[other]
        known = ~np.isnan(one) & ~np.isnan(two)
        span = float(np.ptp(two[known])) if known.any() else 0.0
        same_name = parse_header(recording.headers[first]).name == parse_header(recording.headers[other]).name
        if span == 0 or same_name or is_secondary(other) or is_secondary(first):
            continue
        if float(np.mean(np.abs(one - two)[known] > SAME * max(span, float(np.ptp(one[known]))))) > FEW:
            return other
    return None


def _stands_still(recording: Recording, column: str) -> bool:
    samples = recording.signals[column]
    return bool(np.nanmin(samples) == np.nanmax(samples))


def _asked_beside(recording: Recording, column: str) -> str | None:
    """Return the column of what a controller asks for, "desired", beside a "current" of the same name and no speed."""
    words = _words(column)
    if "current" not in words or column not in recording.assumed_units:
        return None
    if any(rank_in_role(parse_header(text).name, "w") is not None for text in recording.headers.values()):
        return None
    rest = words - {"current"}
    return next((c for c in recording.signals if (asked := _words(c) & ASKED) and _words(c) - asked == rest), None)


def _present(recording: Recording, column: str, asked: str) -> str:
    """Say that a column may hold amperes, or the present value of what another asks for."""
    text = recording.headers[column]
    return (
        f"{recording.title}: {text!r} stands beside {recording.headers[asked]!r}, so it may be the present value of"
        f" what is asked for, or amperes: say which, with --column {shlex.quote(f'w={text}')}, a speed, or --column"
        f" {shlex.quote(f'i={text}')}"
    )


def _two(recording: Recording, role: str, first: str, other: str) -> str:
    """Say which two columns could be one signal, and how to choose."""
    one, two = recording.headers[first], recording.headers[other]
    return (
        f"{recording.title} has two columns for the {ROLE_TITLE[role]}, {one!r} and {two!r}; say which, with"
        f" --column {shlex.quote(f'{role}={one}')}, or in a case file"
    )


def _motors(recording: Recording, columns: Iterable[str]) -> tuple[str, ...]:
    return motors_named([parse_header(recording.headers[column]).name for column in columns])


def _several(recording: Recording, several: Sequence[str]) -> str:
    """Say which motors a recording holds, and how to choose."""
    choices = ", ".join(f"--motor {motor}" for motor in several)
    return f"{recording.title} holds several motors, {', '.join(several)}; say which: {choices}"


def counting(recording: Recording, taken: Collection[str]) -> str | None:
    """Return a column that seems to hold an encoder's counts, or counts a second."""
    for column, text in recording.headers.items():
        words = set(plain(parse_header(text).name).split("_"))
        counted = recording.units[column] in ("count", "count/s")
        bare = (counted or recording.units[column] == "") and column in recording.signals
        if column not in taken and bare and (counted or "encoder" in words):
            return column
    return None


def _lines_of_an_encoder(recording: Recording, column: str) -> str:
    """Say of a column that holds an encoder's counts, or counts a second, how they become an angle or a speed."""
    text, signal = recording.headers[column], "w" if recording.units[column] == "count/s" else "angle"
    return (
        f"{recording.title}: {text!r} counts the lines of an encoder; say how many make a turn with --counts 4000"
        f' (of quadrature, four a line), or in a case file: {signal} = {{ column = "{text}", counts = 4000 }}'
    )


def _without_sign(recording: Recording, role: str) -> str | None:
    """Return the header of a column that holds the absolute values of a role's signal."""
    for text in recording.headers.values():
        of = absolute_of(parse_header(text).name)
        if of is not None and rank_in_role(parse_header(of).name, role) is not None:
            return text
    return None


def _meant(recording: Recording, role: str, taken: Collection[str], *, by_unit: bool) -> list[str]:
    """Return the headers of columns that nearly have a role's name, or else are in its unit."""
    others = {*taken, *recording.unreadable}
    left = {c: parse_header(h) for c, h in recording.headers.items() if c not in others}
    fitting = [h for h in left.values() if h.unit_text is None or _is_of(h, role)]
    near = [h.text for h in fitting if get_close_matches(plain(h.name), USUAL_NAMES[role], n=1, cutoff=0.75)]
    near = [text for text in near if not _words(parse_header(text).name) & ASKED] or near
    if not near and role == "v":
        near = [h.text for h in fitting if plain(h.name) in SUPPLY]
    if not near and role == "v":
        worded = [
            h.text
            for h in fitting
            if _words(h.name) & DRIVE or _words(h.text) & VOLTS or (h.unit is None and SYMBOL.match(plain(h.name)))
        ]
        worded = [text for text in worded if not _words(text) & SUPPLY]
        near = worded if len(worded) == 1 else []
    if near or not by_unit:
        return near
    in_unit = [h.text for h in left.values() if _is_of(h, role)]
    in_unit = [text for text in in_unit if not is_secondary(parse_header(text).name)] or in_unit
    if role != "v":
        return in_unit
    names = [plain(parse_header(text).name) for text in in_unit]
    return [text for text, name in zip(in_unit, names, strict=True) if CHANNEL.match(name) or SYMBOL.match(name)]


def _is_of(header: Header, role: str) -> bool:
    return header.unit is not None and header.unit.quantity == ROLE_QUANTITY[role]


def _example(role: str) -> str:
    unit = assumed_unit(USUAL_NAMES[role][0])
    return f"{USUAL_NAMES[role][0]} [{unit.si}]" if unit else USUAL_NAMES[role][0]
