"""Headers as people and programs write them."""

import pytest

from estimator.recordings.headers import (
    ROLE_QUANTITY,
    assumed_unit_text,
    parse_header,
    quantity_of,
    rank_in_role,
    role_of,
)
from estimator.recordings.units import parse_unit


@pytest.mark.parametrize(
    ("text", "name", "si"),
    [
        ("speed [rpm]", "speed", "rad/s"),
        ("speed (rpm)", "speed", "rad/s"),
        ("speed[rpm]", "speed", "rad/s"),
        ("  speed   [ rpm ] ", "speed", "rad/s"),
        ("speed_rpm", "speed", "rad/s"),
        ("speed/rpm", "speed", "rad/s"),
        ("speed rpm", "speed", "rad/s"),
        ("speed_rad/s", "speed", "rad/s"),
        ("speed_rad_per_s", "speed", "rad/s"),
        ("n/(1/min)", "n", "rad/s"),
        ("n/min-1", "n", "rad/s"),
        ("rpm", "rpm", "rad/s"),
        ("time_ms", "time", "s"),
        ("t_s", "t", "s"),
        ("t/s", "t", "s"),
        ("U/V", "U", "V"),
        ("I_mA", "I", "A"),
        ("I_A", "I", "A"),
        ("current mA", "current", "A"),
        ("motor_current_ma", "motor_current", "A"),
        ("i_ma", "i", "A"),
        ("voltage_mv", "voltage", "V"),
        ("CURRENT_UA", "CURRENT", "A"),
        ("TIME_MS", "TIME", "s"),
        ("theta_deg", "theta", "rad"),
        ("bus_voltage_mV", "bus_voltage", "V"),
        ("armature voltage [V]", "armature voltage", "V"),
        ("speed [rpm] [rad/s]", "speed [rpm]", "rad/s"),
        ("current_V", "current", "V"),  # wrong, and to be said
        ("[V]", "V", "V"),
    ],
)
def test_name_and_unit_are_told_apart(text: str, name: str, si: str) -> None:
    header = parse_header(text)
    assert (header.name, header.unit.si if header.unit else None) == (name, si)


@pytest.mark.parametrize(
    "text",
    [
        "U_a",
        "U_A",
        "u_m",
        "w_m",
        "w_min",
        "n_m",
        "i_a",
        "v",
        "speed",
        "channel A",
        "gear/box",
        "ω",
        "x_1",
        "ua",
        "um",
        "u_ma",
    ],
)
def test_a_name_without_a_unit_stays_whole(text: str) -> None:
    header = parse_header(text)
    assert (header.name, header.unit, header.unit_text) == (text, None, None)


def test_an_unknown_unit_in_brackets_is_kept_as_text() -> None:
    header = parse_header("speed [furlong/fortnight]")
    assert (header.name, header.unit, header.unit_text) == ("speed", None, "furlong/fortnight")


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("Current (mA)*", "Current", "mA"),
        ("Voltage (V) left", "Voltage left", "V"),
        ("speed (motor 1) rpm", "speed (motor 1)", "rpm"),
        ("motor speed left rpm", "motor speed left", "rpm"),
        ("Drehzahl in Upm", "Drehzahl", "Upm"),
        ("Speed_%", "Speed", "%"),
    ],
)
def test_a_unit_further_on_in_a_header_is_one(text: str, name: str, unit: str) -> None:
    header = parse_header(text)
    assert (header.name, header.unit_text) == (name, unit) and header.unit == parse_unit(unit) is not None


@pytest.mark.parametrize("text", ["Current (A) x10", "Current [A] *100", "Current (A)/10"])
def test_a_factor_behind_a_unit_makes_it_none_that_is_known(text: str) -> None:
    header = parse_header(text)
    assert header.name == "Current" and header.unit is None and header.unit_text


def test_empty_brackets_say_nothing() -> None:
    header = parse_header("speed []")
    assert (header.name, header.unit, header.unit_text) == ("speed", None, None)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("voltage", "v"),
        ("Armature Voltage", "v"),
        ("U_a", "v"),
        ("u", "v"),
        ("command", "v"),
        ("I", "i"),
        ("I_a", "i"),
        ("amps", "i"),
        ("Omega", "w"),
        ("Ω", "w"),
        ("n", "w"),
        ("Velocity", "w"),
        ("theta", "angle"),
        ("position", "angle"),
        ("load torque", "load"),
        ("i_meas", "i"),
        ("Omega actual", "w"),
        ("v_fb", "v"),
        ("i_ref", None),
        ("meas", None),
        ("Time", "time"),
        ("Date/Time", "time"),
        ("Date", None),
        ("temperature", None),
    ],
)
def test_usual_names_have_a_role(name: str, role: str | None) -> None:
    assert role_of(name) == role


def test_a_measured_voltage_goes_before_a_commanded_one() -> None:
    measured, commanded = rank_in_role("voltage", "v"), rank_in_role("command", "v")
    assert measured is not None and commanded is not None
    assert measured < commanded


def test_a_telling_word_in_a_longer_name_gives_the_role_but_a_setpoint_has_none() -> None:
    assert rank_in_role("left wheel speed", "w") is not None
    assert rank_in_role("speed setpoint", "w") is None
    assert rank_in_role("temperature", "w") is None
    assert quantity_of("left wheel speed") is None


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Imot", "i"),
        ("U_Motor", "v"),
        ("umot", "v"),
        ("motorspeed", "w"),
        ("enc_vel", "w"),
        ("vcmd", None),
        ("nm", None),
    ],
)
def test_usual_names_are_known_when_two_words_are_written_as_one(name, role):
    assert role_of(name) == role
    assert role is None or rank_in_role(name, role) is not None


@pytest.mark.parametrize(
    ("text", "role", "unit"),
    [
        ("motor_rpm", "w", "rpm"),
        ("Motor RPM", "w", "RPM"),
        ("Encoder RPM", "w", "RPM"),
        ("left_rpm", "w", "rpm"),
        ("motor_mA", "i", "mA"),
        ("motor_ma", "i", "ma"),
        ("ma", "i", "ma"),
        ("motor_V", "v", "V"),
        ("elapsed (s)", "time", "s"),
    ],
)
def test_of_a_part_of_the_motor_the_unit_tells_the_signal(text, role, unit):
    header = parse_header(text)
    assert role_of(header.name) == role and header.unit_text == unit
    assert header.unit is not None and header.unit.quantity == ROLE_QUANTITY[role]


@pytest.mark.parametrize("text", ["target_rpm", "Motor A", "bus_V"])
def test_what_another_word_tells_is_no_signal(text):
    assert role_of(parse_header(text).name) is None


@pytest.mark.parametrize(("text", "unit"), [("millis", "ms"), ("micros", "us"), ("t", "s")])
def test_a_microcontrollers_clock_counts_in_its_own_unit(text, unit):
    assert role_of(text) == "time" and assumed_unit_text(text) == unit


@pytest.mark.parametrize(("text", "unit"), [("n", "rpm"), ("n_actual", "rpm"), ("n_left", "rpm"), ("w_left", "rad/s")])
def test_the_usual_unit_of_a_name_is_that_of_one_motor_of_several_and_of_what_is_measured_too(text, unit):
    assert role_of(text) == "w" and assumed_unit_text(text) == unit


@pytest.mark.parametrize(("text", "role"), [("tensión", "v"), ("Tensão", "v"), ("velocità", "w"), ("Ω", "w")])
def test_accents_are_no_other_names(text, role):
    assert role_of(text) == role
