"""Which of an FMU's variables looks like which quantity of a motor, by name, unit and description. Only guesses."""

from __future__ import annotations

import re

from estimator.cases.si_units import in_si, named
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.variable import Variable
from estimator.motor.names import MOTOR

# Of each role: causalities, SI units, words of the name, words of the description.
_CLUES: dict[str, tuple[tuple[str, ...], tuple[str, ...], str, str]] = {
    "R": (("parameter",), ("Ohm",), r"r|ra|rm|rs|rw|resistance|res", r"resistance|widerstand"),
    "L": (("parameter",), ("H",), r"l|la|lm|ls|lw|inductance|ind", r"inductance|induktivit"),
    "K": (
        ("parameter",),
        ("V.s/rad",),
        r"k|ke|km|kt|kv|ki|ce|cm|k_e|k_m|k_t|psi|kemf|ktau",
        r"torque constant|motor constant|emf|voltage constant|speed constant|flux",
    ),
    "J": (("parameter",), ("kg.m2",), r"j|jm|jr|ja|inertia|theta", r"inertia|trägheit"),
    "B": (
        ("parameter",),
        ("N.m.s/rad",),
        r"b|bm|c|d|f|dm|kd|damping|friction|viscous|mu",
        r"damping|viscous|friction|reibung",
    ),
    "v": (("input",), ("V",), r"v|u|va|ua|vin|uin|u_in|v_in|voltage|volt", r"voltage|spannung"),
    "load": (("input",), ("N.m",), r"load|tl|tau|tau_l|torque|ml|m_l", r"load|torque|moment"),
    "i": (("output", "local"), ("A",), r"i|ia|im|i_a|current", r"current|strom"),
    "angle": (("output", "local"), ("rad",), r"angle|phi|phi_m|theta|pos|position", r"angle|position|winkel"),
    "w": (("output", "local"), ("rad/s",), r"w|wm|omega|w_m|speed|n|phid|velocity", r"speed|velocity|drehzahl"),
}
ROLES = tuple(_CLUES)
UNIT, NAME, WORDS, TOP, OWN = 4, 3, 2, 1, 1  # points for a clue
ENOUGH = 3
VAGUE = {"K": "k", "B": "c|d|f|mu"}  # names that say nothing without a unit or a description
LEAST = 3  # parameters that look like a motor's, to be one


def guess_roles(description: FmuDescription) -> dict[str, tuple[str, ...]]:
    """Return role → variables that look like it, best first; both constants where a motor has two.

    A variable is given to one role only. Nothing where the FMU does not look like a motor: a lone `b` is no friction.
    """
    found = _with_the_last(description, _best(description))
    electrical = {"R", "K", "L"} & set(found)
    return found if electrical and len(set(MOTOR) & set(found)) >= LEAST else {}


def driving_speed(description: FmuDescription) -> str | None:
    """Return the input that looks like the shaft's speed, as of a motor's electrical part alone; None: none does."""
    in_units = [v for v in description.variables if v.is_real and v.unit]
    rated = [(_points(in_si(v), "w", causalities=("input",)), v.name) for v in in_units]
    points, name = max(rated, key=lambda pair: pair[0], default=(0, ""))
    return name if points >= ENOUGH else None


def _with_the_last(description: FmuDescription, found: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Give a motor's last part to a name that alone says nothing: `d`, the only such one left beside R, K, L and J."""
    missing = [role for role in MOTOR if role not in found]
    taken = {name for names in found.values() for name in names}
    left = [v for v in description.variables if v.causality == "parameter" and v.is_real and v.name not in taken]
    if len(missing) != 1 or missing[0] not in VAGUE:
        return found
    named = [v.name for v in left if not v.unit and re.fullmatch(VAGUE[missing[0]], v.name.lower().rpartition(".")[2])]
    return {**found, missing[0]: (named[0],)} if len(named) == 1 else found


def _best(description: FmuDescription) -> dict[str, tuple[str, ...]]:
    scored: list[tuple[int, int, str, Variable]] = []
    for order, variable in enumerate(description.variables):
        if not variable.is_real:
            continue
        for role in ROLES:
            points = _points(in_si(variable), role)
            if points >= ENOUGH:
                scored.append((-points, order, role, variable))
    found: dict[str, tuple[str, ...]] = {}
    best: dict[str, int] = {}
    taken: set[str] = set()
    for minus, _, role, variable in sorted(scored, key=lambda s: s[:2]):
        if variable.name in taken:
            continue
        second = role == "K" and len(found.get(role, ())) == 1 and minus <= best[role] + UNIT
        if role not in found or second:
            found[role] = (*found.get(role, ()), variable.name)
            best.setdefault(role, minus)
            taken.add(variable.name)
    return {role: found[role] for role in ROLES if role in found}


def _points(variable: Variable, role: str, *, causalities: tuple[str, ...] | None = None) -> int:
    usual, units, names, words = _CLUES[role]
    if variable.causality not in (causalities or usual):
        return 0
    unit = named(variable.unit)
    if unit and unit not in units:
        return 0
    points = UNIT if unit in units else 0
    last = re.split(r"[.\[\]]", variable.name.lower().rstrip("]"))[-1]
    vague = not variable.unit and re.fullmatch(VAGUE.get(role, "(?!)"), last)
    points += NAME if re.fullmatch(names, last) and not vague else 0
    points += WORDS if re.search(words, variable.description.lower()) or re.search(words, last) else 0
    return points + (OWN if points and variable.causality == "output" else 0)
