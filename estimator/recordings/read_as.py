"""How a recording is to be read where its header does not say it, or says it wrong. Knows no file and no samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from estimator.errors import RecordingError, suggestion
from estimator.locked import Locked
from estimator.recordings.headers import ROLE_QUANTITY, Header, parse_header, plain, quantity_of, rank_in_role
from estimator.recordings.units import examples, parse_unit


@dataclass(frozen=True)
class ReadAs(Locked):
    """What a user says of a recording's columns; it wins over their headers.

    Attributes
    ----------
    columns : role (v, i, w, angle, load, time) → the column that it is, by its name, or by its number in a file
        without a header, "2"
    units : column, or role of one → unit, "rpm"
    rate : Hz, of the samples of a file that has no time
    test : which test, of a file that holds several
    motor : which motor, of a file that holds several: the word that its columns have, "left"
    per_turn : m that a turn goes, of a linear speed or way
    counts : of an encoder a turn, of a column that holds counts
    supply : of a duty cycle: volts, volts a count ("12/255"), or the column that holds them
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rate: float | None = None
    test: str | None = None
    motor: str | None = None
    per_turn: float | None = None
    counts: float | None = None
    supply: str | None = None

    @property
    def numbers(self) -> frozenset[str]:
        """Columns that are named by their number, counted from 1, or by a name that is a number."""
        return frozenset(name for name in self.columns.values() if name.isdecimal())

    def with_(self, other: ReadAs) -> ReadAs:
        """Return this with what another says; that wins."""
        said = {f.name: v for f in fields(self) if (v := getattr(other, f.name)) is not None and v != {}}
        merged = {"columns": {**self.columns, **other.columns}, "units": {**self.units, **other.units}}
        return replace(self, **{**said, **merged})

    def headers(self, texts: Sequence[str], *, where: str) -> tuple[list[Header], frozenset[int]]:
        """Return headers with the units that are said here, and which of them have one from here.

        Raises
        ------
        RecordingError
            A unit is none, or there is no such column.
        """
        headers = [parse_header(text) for text in texts]
        for role, name in self.columns.items():
            for j in self._named(name, headers):
                headers[j] = _of_role(headers[j], role)
        given: set[int] = set()
        for name, unit_text in self.units.items():
            unit = parse_unit(unit_text)
            if unit is None:
                quantity = ROLE_QUANTITY.get(name) or quantity_of(name)
                wanted = f"; use one of {examples(quantity)}" if quantity else ""
                raise RecordingError(f"{where}: {unit_text!r}, given for {name!r}, is not a known unit{wanted}")
            found = self._named(name, headers)
            if not found:
                known = [header.name for header in headers]
                raise RecordingError(f"{where}: there is no column {name!r} to give a unit{suggestion(name, known)}")
            for j in found:
                headers[j] = Header(headers[j].text, headers[j].name, unit, unit_text)
            given.update(found)
        return headers, frozenset(given)

    def places(self, headers: Sequence[Header], *, where: str, clock: int | None = None) -> dict[str, int]:
        """Return which header each role of `columns` means; `clock` is that of the time, where it is known.

        Raises
        ------
        RecordingError
            There is no such column, or it is another signal already.
        """
        found: dict[str, int] = {}
        signals = {} if clock is None else {clock: "time"}
        for role, name in self.columns.items():
            there = self._named(role, headers)
            if not there:
                raise RecordingError(f"{where} has no column {name!r}{suggestion(name, [h.text for h in headers])}")
            found[role] = there[0]
            if (other := signals.setdefault(there[0], role)) != role:
                raise RecordingError(
                    f"{where}: column {headers[there[0]].text!r} cannot be {role}, as it is {other}; name another one"
                )
        return found

    def _named(self, name: str, headers: Sequence[Header]) -> list[int]:
        """Return which headers a name means: a column's own, or else a role's."""
        if name in self.columns:
            name = self.columns[name]
        if name.isdecimal() and name not in {h.name for h in headers}:  # counted from 1
            return [int(name) - 1] if 1 <= int(name) <= len(headers) else []
        exact = [j for j, h in enumerate(headers) if name in (h.text, h.name)]
        exact = exact or [j for j, h in enumerate(headers) if plain(name) in (plain(h.text), plain(h.name))]
        if exact or name not in ROLE_QUANTITY:
            return exact
        ranks = {j: rank for j, h in enumerate(headers) if (rank := rank_in_role(h.name, name)) is not None}
        return [j for j, rank in ranks.items() if name != "time" or rank == min(ranks.values())]


def _of_role(header: Header, role: str) -> Header:
    """Return a header whose word is a unit only by chance: `pulse`, which the user says is the voltage."""
    bare = header.unit is not None and plain(header.text) == plain(header.unit_text or "")
    if bare and header.unit is not None and header.unit.quantity not in (ROLE_QUANTITY.get(role), "electrical speed"):
        return Header(header.text, header.text, None, None)
    return header


AS_WRITTEN = ReadAs()
