"""What a column's header says: name, unit, usual part in a motor. Knows no files and no samples."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from estimator.recordings.units import Unit, parse_unit, unit_of


@dataclass(frozen=True)
class Header:
    """One header, taken apart."""

    text: str  # as written: "speed [rpm]"
    name: str  # "speed"
    unit: Unit | None  # None: not written, or not known
    unit_text: str | None  # "rpm"; None: not written


ROLE_QUANTITY = {
    "time": "time",
    "v": "voltage",
    "i": "current",
    "w": "angular speed",
    "angle": "angle",
    "load": "torque",
}
ROLE_TITLE = {
    "time": "time",
    "v": "voltage",
    "i": "current",
    "w": "speed",
    "angle": "angle",
    "load": "load torque",
}
LONGEST = 200  # characters: a longer text is no name
# Usual names per role, best first, as `plain` gives them. A measured voltage goes before a commanded one.
_NAMES = {
    "time": "time t zeit temps tiempo tempo t_now timestamp time_stamp elapsed_time seconds second sec s ms us x_axis"
    " x_value millis micros elapsed uhrzeit zeitstempel datetime date_time epoch tout hora heure время 时间 時間",
    "v": "voltage armature_voltage motor_voltage terminal_voltage measured_voltage v u u_a v_a ua va"
    " u_m v_m um vm v_mot u_mot v_motor u_motor uin vin u_in v_in volts volt spannung ankerspannung"
    " motor_v motor_volts motorspannung tension tensione tensao tensão tensión voltaje applied_voltage input_voltage"
    " напряжение 电压 電圧 電壓 电枢电压"
    " supply_voltage v_supply v_cmd u_cmd voltage_command command_voltage commanded_voltage"
    " command cmd vout v_out uout u_out",
    "i": "current armature_current motor_current measured_current i i_a ia i_m im i_mot i_motor amps amp"
    " ampere amperes strom ankerstrom motorstrom courant corriente corrente ток 电流 電流 电枢电流 ma"
    " motor_ma motor_amps",
    "w": "speed angular_speed angular_velocity motor_speed shaft_speed rotor_speed measured_speed omega ω w"
    " w_m wm omega_m ω_m velocity motor_velocity speed_rpm rpm drehzahl winkelgeschwindigkeit geschwindigkeit vitesse"
    " velocidad velocidade velocita n n_m vel ang_vel angvel motor_vel enc_vel"
    " motor_rpm shaft_rpm rotor_rpm wheel_rpm encoder_rpm enc_rpm measured_rpm actual_rpm"
    " current_speed current_velocity current_rpm current_omega"
    " скорость частота_вращения 转速 轉速 回転数 回転速度 角速度 速度",
    "angle": "angle theta θ phi φ position motor_angle shaft_angle rotor_angle encoder_angle angular_position"
    " motor_position theta_m winkel drehwinkel pos current_angle current_position current_pos 角度 转角 位置",
    "load": "load load_torque torque_load external_torque t_l tl tau_l m_l lastmoment",
}
# Names whose usual unit is another than SI: a guess that is worth making, reported, and overruled by a unit.
_USUAL_UNITS = dict.fromkeys(("n", "n_m", "drehzahl", "转速", "轉速", "回転数", "回転速度"), "rpm") | {
    "millis": "ms",
    "micros": "us",
}
USUAL_NAMES = {role: tuple(names.split()) for role, names in _NAMES.items()}
_ROLE_OF = {name: role for role, names in USUAL_NAMES.items() for name in names}
# Words that tell the part of a longer name: "shaft speed raw". Setpoints and limits have another part.
_TELLING = {
    role: frozenset(name for name in names if len(name) > 3 and "_" not in name) for role, names in USUAL_NAMES.items()
}
_OTHER_PART = frozenset(
    (
        "setpoint",
        "set",
        "target",
        "reference",
        "ref",
        "desired",
        "command",
        "cmd",
        "limit",
        "max",
        "min",
        "error",
        "offset",
        "bias",
        "noise",
        "estimated",
    )
)
# Words behind which "current" says that the value is the present one: "current wheel speed", "current_pwm".
_PRESENT = frozenset(
    [
        "speed",
        "velocity",
        "rpm",
        "omega",
        "position",
        "pos",
        "angle",
        "theta",
        "pwm",
        "duty",
        "torque",
        "power",
        "state",
        "error",
        "time",
        "temperature",
        "setpoint",
        "voltage",
        "volts",
    ]
)
# Words of what a controller asks for.
ASKED = frozenset(["desired", "target", "setpoint", "reference", "ref", "wanted", "goal"])
# Words of a signal that stands behind another of the same kind: what was commanded, supplied, or made of it.
_SECONDARY_WORDS = "command cmd com commanded supply battery bat vbat filtered filt smoothed smooth lpf avg average raw"
_SECONDARY = frozenset(_SECONDARY_WORDS.split())
# Words of a signal that was measured, where what was asked for stands beside it: "i_meas", "w_act".
_MEASURED = frozenset(["meas", "measured", "act", "actual", "fb", "feedback", "sensed"])
# Usual names of two words, written as one: "Imot", "motorspeed". Shorter ones would be anything.
_GLUED = {
    name.replace("_", ""): name
    for name in _ROLE_OF
    if "_" in name and len(name) > 4 and not _SECONDARY & frozenset(name.split("_"))
}
# Words that tell one motor of several; those of one line stand beside each other.
_SIDES = tuple(
    frozenset(words.split())
    for words in (
        "left right",
        "l r",
        "front rear back",
        "fl fr rl rr bl br",
        "1 2 3 4 5 6",
        "m1 m2 m3 m4 m5 m6",
        "motor1 motor2 motor3 motor4 motor5 motor6",
    )
)
_SIDE = frozenset(word for side in _SIDES for word in side)
_NEVER_SUFFIX = frozenset({"min", "s", "m", "K", "N", "H", "W", "1", "-", "g", "inc", "turn", "count", "rev"})
# Units that need two cases, behind a name that is all in one: current_ma, TIME_MS.
_IN_ONE_CASE = {unit.lower(): unit for unit in ("mV", "uV", "kV", "mA", "uA", "ms", "us")}
_WIDE = str.maketrans("（）［］／", "()[]/")  # as Chinese and Japanese headers have them
_IN = re.compile(r"(?P<name>.+?) in (?P<unit>.+)")
_BRACKETS = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))", re.DOTALL)

_WITHIN = re.compile(r"(?P<name>[^\[\]()]+?)\s*[\[(](?P<unit>[^\[\]()]*)[\])](?P<rest>[^\[\]()]+)")  # "i (A) left"
_ABSOLUTE = re.compile(r"(?:abs ?\( ?([^()|]+?) ?\)|\| ?([^()|]+?) ?\|)", re.IGNORECASE)  # "abs(i)", "|i|"
_OF_TIME = re.compile(r"(?<=\w)\([tk]\)")
_FACTOR = re.compile(r"\s*[x×*/]\s*\d")


@lru_cache(maxsize=4096)
def plain(name: str) -> str:
    """Return the form in which names are compared: ``"Armature Voltage"`` → ``"armature_voltage"``; no accents."""
    name = "".join(c for c in unicodedata.normalize("NFD", name) if not unicodedata.combining(c))
    name = re.sub(r"(?<=[a-z]{3})(?=[A-Z][a-z]{2})", "_", name)  # leftSpeed
    return re.sub(r"[\s_.,:;/\-]+", "_", name.casefold()).strip("_")


def _without_side(key: str) -> str:
    """Return a plain name without the word that tells one motor of several: ``"v_left"`` → ``"v"``."""
    words = key.split("_")
    sides = [word for word in words if word in _SIDE]
    return "_".join(word for word in words if word not in _SIDE) if len(sides) == 1 and len(words) > 1 else key


def motors_named(names: Sequence[str]) -> tuple[str, ...]:
    """Return which motors have signals of the same name side by side: ``("left", "right")``; empty for one motor."""
    beside: dict[str, set[str]] = {}
    for name in names:
        key = plain(name)
        if (rest := _without_side(key)) != key and rest:
            beside.setdefault(rest, set()).update(_SIDE & set(key.split("_")))
    found = {word for words in beside.values() if len(words) > 1 for word in words}
    sides = [sorted(found & side) for side in _SIDES]
    most: list[str] = max(sides, key=len)
    return tuple(most)


def _usual(key: str) -> str:
    """Return a plain name in its usual spelling: ``"imot"`` → ``"i_mot"``, ``"i_meas"`` → ``"i"``."""
    if key in _ROLE_OF:
        return key
    bare = "_".join(word for word in key.split("_") if word not in _MEASURED)
    return bare if bare in _ROLE_OF else _GLUED.get(key, key)


def role_of(name: str) -> str | None:
    """Return the role whose usual name this is: ``"U_a"`` → ``"v"``."""
    key = _usual(plain(name))
    return _ROLE_OF.get(key) or _ROLE_OF.get(_without_side(key))


def is_secondary(name: str) -> bool:
    """Return whether a name says that the signal stands behind another of its kind: ``"v_cmd"``, ``"speed_filt"``."""
    return bool(_SECONDARY & frozenset(plain(name).split("_")))


def absolute_of(name: str) -> str | None:
    """Return the name of which a name says the absolute value: ``"abs(i)"``, ``"|i|"`` → ``"i"``; None for others."""
    found = _ABSOLUTE.fullmatch(name)
    return None if found is None else found[1] or found[2]


def rank_in_role(name: str, role: str) -> int | None:
    """Return how usual a name is for a role (0 is the most usual), or None if it is not."""
    key = _usual(plain(name))
    names = USUAL_NAMES[role]
    if key not in _ROLE_OF:
        key = _without_side(key)
    if key in names:
        return names.index(key)
    words = frozenset(key.split("_"))
    if role == "i" and "current" in words and words & _PRESENT:
        return None
    raw_volts = role == "v" and "raw" in words  # of some sensor, as its converter reads them
    if key not in _ROLE_OF and words & _TELLING[role] and not words & _OTHER_PART and not raw_volts:
        return len(names)
    return None


def quantity_of(name: str) -> str | None:
    """Return the quantity that a usual name stands for: ``"omega"`` → ``"angular speed"``."""
    role = role_of(name)
    return None if role is None else ROLE_QUANTITY[role]


def assumed_unit(name: str) -> Unit | None:
    """Return the unit that a usual name without a unit is taken to be in: rpm for ``"n"``, else the SI unit."""
    quantity = quantity_of(name)
    return None if quantity is None else parse_unit(assumed_unit_text(name) or "") or unit_of(quantity)


def assumed_unit_text(name: str) -> str | None:
    """Return how the unit is written that a usual name without a unit is taken to be in: ``"rpm"`` for ``"n"``."""
    quantity = quantity_of(name)
    key = _usual(plain(name))
    return (
        None
        if quantity is None
        else _USUAL_UNITS.get(key) or _USUAL_UNITS.get(_without_side(key), unit_of(quantity).si)
    )


@lru_cache(maxsize=4096)
def parse_header(text: str) -> Header:
    """Take a header apart: ``speed [rpm]``, ``speed (rpm)``, ``speed in rpm``, ``speed_rpm``, ``speed/rpm``.

    What stands in brackets at the end is a unit, known or not; further on it is one if it is known, and ``(A) x10`` is
    one that nobody knows. After ``_``, ``/`` or a space it is one only if it is known and the name stays sensible
    without it: ``U_a`` and ``w_min`` are names, ``motor_rpm`` is both.
    """
    text = " ".join(text.translate(_WIDE).split())
    if len(text) > LONGEST:
        return Header(text, text, None, None)
    if (whole := _OF_TIME.sub("", text)) != text:
        return replace(parse_header(whole), text=text)  # "u(t) [V]"
    brackets = _BRACKETS.fullmatch(text)
    if brackets and not _ABSOLUTE.fullmatch(text):
        inside = (brackets["square"] if brackets["square"] is not None else brackets["round"]).strip()
        name = brackets["name"].strip().removesuffix("/").strip()
        if not inside:
            return Header(text, name or text, None, None)
        return Header(text, name or inside, parse_unit(inside), inside)
    within = _WITHIN.fullmatch(text)
    if within and (unit := parse_unit(within["unit"])):
        if _FACTOR.match(within["rest"]):
            return Header(text, within["name"], None, f"{within['unit']}{within['rest']}")
        return Header(text, f"{within['name']} {within['rest'].strip(' *:;,')}".strip(), unit, within["unit"])
    worded = _IN.fullmatch(text)
    if worded and (unit := parse_unit(worded["unit"])):
        return Header(text, worded["name"], unit, worded["unit"])
    bare = parse_unit(text, symbols_only=True) if len(text) > 1 else None
    bare = bare if bare and quantity_of(text) in (None, bare.quantity) else None  # "um" is a voltage
    if unit := bare or _in_one_case(text, text):
        return Header(text, text, unit, text)  # "rpm", "amps", "ticks_per_sec": the unit is the name
    for place in re.finditer(r"[_/ ]", text):
        name, suffix = text[: place.start()].strip(), text[place.end() :].strip()
        unit = parse_unit(suffix, symbols_only=suffix != "%")
        unit = unit or _small(name, suffix) or _in_one_case(text, suffix, name)
        if name and unit and quantity_of(name) != unit.quantity == quantity_of(text):
            return Header(text, text, unit, suffix)  # "motor_rpm": without its unit the name says nothing, or another
        if name and unit and _is_suffix(name, place[0], suffix, unit):
            return Header(text, name, unit, suffix)
    return Header(text, text, None, None)


def _small(name: str, suffix: str) -> Unit | None:
    """Return the unit of ``voltage_v`` and ``current_a``: a small letter behind a word that says the quantity."""
    if len(suffix) != 1 or len(plain(name)) < 3:
        return None
    unit = parse_unit(suffix)
    return unit if unit and unit.quantity in _quantities(name) else None


def _in_one_case(text: str, suffix: str, name: str = "") -> Unit | None:
    """Return the unit of ``current_ma`` and ``TIME_MS``, of whose quantity the name, or all of it, is."""
    unit = parse_unit(_IN_ONE_CASE.get(suffix.lower(), "")) if text.islower() or text.isupper() else None
    return unit if unit and unit.quantity in {quantity_of(text), quantity_of(name), *_quantities(name)} else None


def _quantities(name: str) -> set[str]:
    """Return the quantities that a longer name may stand for: ``"motor speed left"`` → an angular speed."""
    return {quantity for role, quantity in ROLE_QUANTITY.items() if rank_in_role(name, role) is not None}


def _is_suffix(name: str, separator: str, suffix: str, unit: Unit) -> bool:
    quantity = quantity_of(name)
    if unit.quantity in {quantity, *_quantities(name)} or (len(suffix) == 1 and _small(name, suffix) is not None):
        return True
    if unit.quantity == "count rate":
        return True  # "encoder counts/s"
    if separator == " " or suffix in _NEVER_SUFFIX:
        return False
    # "current_V" is a current in volts, to be complained of; "U_A" is an armature voltage.
    return quantity is None or len(name) > 2


def are_units(cells: Sequence[str]) -> bool:
    """Whether cells are units; one may be none that is known where a unit of time and another are."""
    bare = [cell for own in cells if (cell := own.strip("[]() "))]
    numbers = [cell for cell in bare if cell[0].isdigit() and not any(map(str.isalpha, cell))]
    if numbers or not bare:
        return False
    known = [unit for cell in bare if cell != "-" and (unit := parse_unit(cell)) is not None]
    strange = len(bare) - len(known) - bare.count("-")
    is_timed = any(unit.quantity == "time" for unit in known)
    return not strange or (strange == 1 and is_timed and len(known) > 1)
