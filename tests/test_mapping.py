"""An FMU whose names, units and types differ is estimated through the case file's mapping."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from foreign_fmus import CASE, foreign_case, foreign_fmu
from motors import CML050, NAMES, held_response, step_recording, write_recording

import fmu_build
from estimator.cases.case import case_for_recording, read_case
from estimator.cases.roles import guess_roles
from estimator.cases.si_units import in_si_units
from estimator.cases.written_case import write_case
from estimator.cli import main
from estimator.commands.options import with_options
from estimator.errors import InputError
from estimator.estimating.estimate import estimate
from estimator.fmus.fmu import describe
from estimator.plans.parameters import Box
from estimator.plans.planning import plan_case
from estimator.plans.space import reduced_space, steady_state

pytestmark = pytest.mark.usefixtures("shared_workers", "compiled_quickly")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    write_recording(step_recording(CML050, lead=0.1, duration=0.5), path)
    return path


@pytest.fixture(scope="module")
def plain_fmu(tmp_path_factory):
    return foreign_fmu(tmp_path_factory.mktemp("plain"))


def worst(e, names=NAMES):
    """Return the largest relative error."""
    return max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in names)


def test_foreign_names_fixed_parameters_and_a_local_current_are_estimated_to_1e_8(plain_fmu, recording):
    e = estimate(read_case(foreign_case(plain_fmu, recording)))
    assert worst(e) < 1e-8
    assert e.parameters["K"].unit == "V.s/rad" and e.parameters["L"].unit == "H"
    assert set(e.rmse) == {"i", "w"}


def test_units_of_the_fmu_are_converted_both_ways(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, "WORKSHOP_UNITS")
    own = {v.name: (v.unit, v.start) for v in describe(fmu).variables}
    assert own["motor.La"] == ("mH", 12.0) and own["shaft.w"][0] == "rpm"
    e = estimate(read_case(foreign_case(fmu, recording)))
    assert worst(e) < 1e-8
    assert {n: e.parameters[n].unit for n in "LJ"} == {"L": "H", "J": "kg.m2"}
    assert e.comparisons[0].units == {"v": "V", "i": "A", "w": "rad/s"}
    assert max(e.rmse.values()) < 1e-6


BASELESS = ('<BaseUnit kg="1" m="2" factor="1e-7"/>', "")


def test_a_unit_that_is_not_defined_in_base_units_is_read_as_it_is_written(tmp_path):
    fmu = foreign_fmu(tmp_path, "WORKSHOP_UNITS", change=[BASELESS])
    inertia = {v.name: v for v in in_si_units(describe(fmu)).variables}["motor.Jm"]
    assert (inertia.unit, inertia.start) == ("kg.m2", pytest.approx(1e-5, rel=1e-12))


def test_units_that_an_fmu_says_in_its_own_words_are_of_the_roles_they_are_of_in_ours(tmp_path):
    change = [("N.m.s/rad", "N*m/(rad/s)"), ("N.m/A", "Nm/A"), ('"Ohm"', '"ohm"'), ("motor.c", "motor.fric2")]
    roles = guess_roles(describe(foreign_fmu(tmp_path, change=change)))
    assert {n: roles[n] for n in "RKB"} == {"R": ("motor.Ra",), "K": ("motor.Ke", "motor.Km"), "B": ("motor.fric2",)}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ((' unit="(Ohm|A)"', ""), "foreign.fmu says no unit of R, i: taken as SI, here and in what is derived from it"),
        (('"kg.m2"', '"slug.ft2"'), "says units that are not known, 'slug.ft2' of J: its numbers are taken as SI"),
        (("rad", "rad"), ""),
    ],
)
def test_a_unit_that_the_fmu_does_not_say_is_told(tmp_path, recording, change, sentence):
    case = read_case(foreign_case(foreign_fmu(tmp_path, change=[change]), recording))
    told = [note for note in plan_case(case, describe(case.fmu)).notes if "unit" in note]
    assert sentence in "; ".join(told) if sentence else not told


@pytest.mark.parametrize("declared", [True, pytest.param(False, marks=pytest.mark.full)])
def test_an_output_in_degrees_is_compared_with_radians(tmp_path, recording, declared):
    fmu = foreign_fmu(tmp_path, "DEGREES", change=[('unit="rad/s"', 'unit="deg/s"' if declared else "")])
    gain = "" if declared else f", gain = {np.pi / 180!r}"
    text = CASE.replace('fmu = "shaft.w" }}', f'fmu = "shaft.w"{gain} }}}}')
    assert worst(estimate(read_case(foreign_case(fmu, recording, text=text)))) < 1e-8


def test_an_output_that_counts_the_other_way_is_told_before_the_search_and_turned_by_a_gain(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, "REVERSED")
    refused = estimate(read_case(foreign_case(fmu, recording)))
    assert refused.verdict == "refused" and "search" not in refused.simulations_by_phase
    assert "foreign.fmu counts i the other way than the recording: say gain = -1 of i under" in refused.reasons[0]
    turned = CASE.replace('fmu = "motor.ia" ', 'fmu = "motor.ia", gain = -1 ')
    assert worst(estimate(read_case(foreign_case(fmu, recording, text=turned)))) < 1e-8


@pytest.mark.parametrize("name", ["i", "w"])
def test_a_gain_that_turns_an_output_against_the_recording_is_told_before_the_search(tmp_path, recording, name):
    """It went on to a search, and to ten reasons that did not name it (7 s)."""
    columns = {"i": '{ column = "current" }', "w": '{ column = "speed" }'}
    columns[name] = columns[name].replace(" }", ", gain = -1 }")
    case = tmp_path / "turned.case.toml"
    outputs = "\n".join(f"{n} = {column}" for n, column in columns.items())
    case.write_text(f'[outputs]\n{outputs}\n[[recording]]\nfile = "{recording.as_posix()}"\n')
    refused = estimate(read_case(case))
    assert refused.verdict == "refused" and refused.simulations_by_phase == {"probe": 1}
    assert f"the gain -1 of {name} turns it against the recording: dc_motor.fmu counts {name} as" in refused.reasons[0]


def test_a_ratio_that_is_held_is_told_without_a_unit(recording):
    told = plan_case(case_for_recording(recording, fmu="dc_motor_geared"), describe("dc_motor_geared")).notes
    assert "gear = 5, stiffness = 2 N.m/rad" in "; ".join(told)


def test_an_input_that_no_column_drives_is_told_with_its_value(tmp_path, recording):
    change = ('causality="parameter" variability="fixed"><Real unit="Ohm"', 'causality="input"><Real unit="Ohm"')
    fmu = foreign_fmu(tmp_path, change=[change])
    text = re.sub(r"(?m)^R = .*\n", "", CASE)
    told = plan_case(read_case(foreign_case(fmu, recording, text=text)), describe(fmu)).notes
    assert "inputs that no column drives are held at the FMU's own value: motor.Ra = 3 Ohm" in "; ".join(told)
    told = plan_case(read_case(foreign_case(fmu, recording)), describe(fmu)).notes
    assert "inputs" not in "; ".join(told)


def test_roles_shorten_the_search_on_foreign_names(plain_fmu, recording):
    dimensions = []
    for text in (CASE, CASE.replace("R = {{ fmu", "Ra = {{ min = 0.1, max = 30, fmu")):
        plan = plan_case(read_case(foreign_case(plain_fmu, recording, text=text)), describe(plain_fmu))
        space = reduced_space(plan, Box.of(plan.parameters), steady_state(plan))
        dimensions.append(None if space is None else space.box.dimension)
    assert dimensions == [3, None]


def test_a_parameter_that_starts_at_zero_is_bounded_by_its_usual_size(recording):
    """Within 1e6 N.m, what the FMU allows, a friction of 1 N.m was at its lower bound, and tried at -0.1 N.m."""
    case = dataclasses.replace(case_for_recording(recording), fmu="dc_motor_drive")
    friction = next(p for p in plan_case(case, describe("dc_motor_drive")).parameters if p.name == "friction")
    assert (friction.lower, friction.upper) == (0.0, pytest.approx(1e4 * 0.01))


def test_without_roles_all_free_parameters_are_searched(plain_fmu, recording):
    text = CASE.replace("R = {{ fmu", "Ra = {{ min = 0.1, max = 30, fmu").replace("K = {{ fmu", "k = {{ fmu")
    e = estimate(read_case(foreign_case(plain_fmu, recording, text=text)))
    found = {**{n: e.parameters[n].value for n in ("L", "J", "B")}, "R": e.parameters["Ra"].value}
    assert max(abs(found[n] / CML050.parameters[n] - 1) for n in found) < 1e-6


def test_a_factor_leads_from_the_parameter_to_the_variable(plain_fmu, recording):
    text = CASE.replace('["motor.Ke", "motor.Km"]', '{{ "motor.Ke" = 0.5, "motor.Km" = 0.5 }}')
    e = estimate(read_case(foreign_case(plain_fmu, recording, text=text)))
    assert e.parameters["K"].value == pytest.approx(2 * CML050.K, rel=1e-6)


def test_an_fmu_without_a_motor_constant_is_estimated_in_what_it_has(plain_fmu, recording):
    text = CASE.replace('K = {{ fmu = ["motor.Ke", "motor.Km"] }}\n', "")
    text += f'[fixed]\n"motor.Ke" = {CML050.K}\n"motor.Km" = {CML050.K}\n'
    e = estimate(read_case(foreign_case(plain_fmu, recording, text=text)))
    assert worst(e, "RLJB") < 1e-8


@pytest.mark.parametrize("value", ['"none"', *(pytest.param(v, marks=pytest.mark.full) for v in ("0", "false"))])
def test_an_enumeration_is_set_by_item_number_or_truth(plain_fmu, tmp_path, value):
    smooth = dataclasses.replace(CML050, B=0.0)
    write_recording(step_recording(smooth, lead=0.1, duration=0.4), tmp_path / "smooth.csv")
    text = CASE.replace('B = {{ fmu = "motor.c" }}\n', "") + f"[fixed]\nfriction = {value}\nenabled = true\n"
    e = estimate(read_case(foreign_case(plain_fmu, tmp_path / "smooth.csv", text=text)))
    assert e.parameters["friction"].value == 0
    assert worst(e, "RKLJ") < 1e-6


def test_a_parameter_that_moves_nothing_is_named_before_the_search(plain_fmu, recording):
    text = CASE + "[fixed]\nfriction = 0\n"
    e = estimate(read_case(foreign_case(plain_fmu, recording, text=text)))
    assert e.verdict == "refused"
    assert e.reasons == (
        "parameter 'B' moves no measured signal (i, w), so it cannot be estimated; fix it with --fix B=VALUE, or"
        " measure what it moves",
    )
    assert e.simulations < 40


def test_a_start_value_is_a_parameter_like_any_other(tmp_path):
    motor = CML050
    still = step_recording(motor, lead=0.1, duration=0.6)
    path = tmp_path / "late.csv"
    keep = still.time > 0.105 - 1e-9  # begins while the motor already turns
    columns = {"voltage [V]": still.signals["voltage"], "current [A]": still.signals["current"]}
    columns["speed [rad/s]"] = still.signals["speed"]
    rows = np.column_stack([still.time, *columns.values()])[keep]
    np.savetxt(path, rows, delimiter=",", header=",".join(["time [s]", *columns]), comments="", fmt="%.17g")
    text = CASE.replace("[[recording]]", 'i0 = {{ min = 0, max = 5, start = 1, fmu = "motor.ia" }}\n[[recording]]')
    text = text.replace("[[recording]]", 'w0 = {{ min = 0, max = 300, start = 1, fmu = "shaft.w" }}\n[[recording]]')
    e = estimate(read_case(foreign_case(foreign_fmu(tmp_path), path, text=text)))
    assert e.parameters["i0"].value == pytest.approx(columns["current [A]"][keep][0], rel=1e-6)
    assert e.parameters["w0"].value == pytest.approx(columns["speed [rad/s]"][keep][0], rel=1e-6)
    assert worst(e) < 1e-6


def test_a_case_with_a_mapping_reads_back_as_it_was_written(plain_fmu, recording):
    text = CASE.replace('["motor.Ke", "motor.Km"]', '{{ "motor.Ke" = 0.5, "motor.Km" = 2.0 }}')
    text = text.replace("[inputs]", 'kind = "co-simulation"\n[inputs]') + '[fixed]\nfriction = "viscous"\n'
    case = read_case(foreign_case(plain_fmu, recording, text=text))
    again = plain_fmu.with_name("again.case.toml")
    write_case(case, again)
    assert read_case(again) == case


def test_a_fixed_parameter_reaches_its_variables_through_their_factors(plain_fmu, recording):
    text = CASE.replace('["motor.Ke", "motor.Km"]', '{{ "motor.Ke" = 0.5, "motor.Km" = 0.5 }}')
    case = read_case(foreign_case(plain_fmu, recording, text=text))
    e = estimate(with_options(case, fix=[("K", 2 * CML050.K)]))
    assert e.parameters["motor.Ke"].value == e.parameters["motor.Km"].value == CML050.K
    assert worst(e, "RLJB") < 1e-6


def test_a_fixed_value_is_si_and_its_range_too(tmp_path, recording):
    change = [('(<Real unit="mH")', r'\1 min="1" max="100"')]
    case = read_case(foreign_case(foreign_fmu(tmp_path, "WORKSHOP_UNITS", change=change), recording))
    assert worst(estimate(with_options(case, fix=[("L", CML050.L)])), "RKJB") < 1e-6
    with pytest.raises(
        InputError, match=r"^--fix L=0.2, which sets motor.La to 0.2, is outside the range 0.001 to 0.1"
    ):
        with_options(case, fix=[("L", 0.2)])


@pytest.mark.parametrize(
    ("fixed", "sentence"),
    [
        ("friction = 7", "[fixed] friction of foreign.fmu has no item of the value 7 (none = 0, viscous = 1)"),
        ('"motor.La" = 1e3', "[fixed] motor.La = 1000 is outside the range any to 0.5 that foreign.fmu allows"),
    ],
)
def test_a_fixed_value_that_the_fmu_does_not_allow_is_named(tmp_path, recording, fixed, sentence):
    change = [('(valueReference="1"[^>]*><Real unit="H")', r'\1 max="0.5"')]
    text = CASE.replace('L = {{ fmu = "motor.La" }}\n', "") + f"[fixed]\n{fixed}\n"
    with pytest.raises(InputError) as caught:
        estimate(read_case(foreign_case(foreign_fmu(tmp_path, change=change), recording, text=text)))
    assert str(caught.value) == sentence


def test_a_recorded_input_is_not_replaced_by_a_fixed_value(plain_fmu, recording):
    sentence = "the input 'v' is fixed, but step.csv has it in the column 'voltage'; leave the fixed value out"
    with pytest.raises(InputError, match=sentence):
        estimate(with_options(case_for_recording(recording), fix=[("v", 3.0)]))
    case = read_case(foreign_case(plain_fmu, recording))
    with pytest.raises(InputError, match=sentence):
        estimate(with_options(case, fix=[("u_in", 3.0)]))


def test_a_fixed_voltage_needs_no_column(tmp_path):
    motor, n = CML050, 400
    shown = held_response(motor, np.full(n, 5.0), step=1e-3)
    path = tmp_path / "on.csv"
    rows = np.column_stack([np.arange(n) * 1e-3, shown])
    np.savetxt(path, rows, delimiter=",", header="time [s],current [A],speed [rad/s]", comments="", fmt="%.17g")
    e = estimate(with_options(case_for_recording(path), fix=[("v", 5.0)]))
    assert worst(e) < 1e-6


def test_a_bare_recording_with_a_foreign_fmu_is_told_of_init(plain_fmu, recording, capsys, tmp_path):
    assert main(["estimate", str(recording), "--fmu", str(plain_fmu)]) == 2
    command = capsys.readouterr().err.partition("let one be guessed with ")[2].split()
    assert command[:2] == ["fmu-estimator", "init"]
    command[-1] = str(tmp_path / "motor.case.toml")
    assert main(command[1:]) == 0 and main(["estimate", command[-1], "--json"]) == 0


def test_an_fmu_without_outputs_is_said_to_have_none(recording, capsys, tmp_path):
    change = [('name="u_in"', 'name="v"'), ('causality="output"', 'causality="local"')]
    fmu = foreign_fmu(tmp_path, change=[*change, ("<Outputs>.*</Outputs>", "")])
    assert main(["estimate", str(recording), "--fmu", str(fmu)]) == 2
    assert "foreign.fmu has no output 'i' (there is none); a case file says which" in capsys.readouterr().err


def test_an_fmu_without_inputs_is_said_to_be_none_that_a_voltage_can_drive(recording, capsys, tmp_path):
    ball = tmp_path / "ball.fmu"
    fmu_build.build(Path(__file__).parent / "models" / "bouncing.c", output=ball)
    assert main(["estimate", str(recording), "--fmu", str(ball)]) == 2
    assert "ball.fmu has no inputs, so no voltage can drive it; export it with the voltage" in capsys.readouterr().err


WRONG = {
    "no such variable": ('"motor.Ra"', '"motor.R"', "foreign.fmu has no parameter 'motor.R'; did you mean 'motor.Ra'?"),
    "no such output": ('"shaft.w"', '"shaft.v"', "foreign.fmu has no output 'shaft.v'; did you mean 'shaft.w'?"),
    "no such input": ('"u_in"', '"u"', "foreign.fmu has no input 'u'"),
    "calculated": ('"motor.c"', '"motor.power"', "the local 'motor.power' of foreign.fmu is calculated"),
    "no such item": ("[[rec", '[fixed]\nfriction = "dry"\n[[rec', "friction of foreign.fmu has no item 'dry'"),
    "half a boolean": ("[[rec", "[fixed]\nenabled = 0.5\n[[rec", "enabled is Boolean in foreign.fmu; 0.5 is no whole"),
    "text for a number": ("[[rec", '[fixed]\nfriction = "1x"\n[[rec', "friction of foreign.fmu has no item '1x'"),
    "estimated integer": ('fmu = "motor.c"', 'fmu = "friction"', "'friction' of foreign.fmu is Enumeration; only real"),
    "kind not offered": ("[inputs]", 'kind = "model-exchange"\n[inputs]', "offers no model-exchange, only co-simul"),
    "no factor": ('["motor.Ke", "motor.Km"]', "{{ }}", "parameters.K.fmu is empty; write { Ke = 1, Km = 1 }"),
    "a column twice": (
        "[outputs]",
        '[outputs]\nn = {{ column = "speed", fmu = "shaft.w" }}',
        "is compared with n and w,",
    ),
    "gain 0": ('fmu = "motor.ia"', 'fmu = "motor.ia", gain = 0', "outputs.i.gain is 0, which leaves nothing"),
    "factor 0": ('["motor.Ke", "motor.Km"]', '{{ "motor.Ke" = 0 }}', "parameters.K.fmu.motor.Ke is 0"),
}


@pytest.mark.parametrize(("old", "new", "sentence"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_in_a_mapping_is_said_in_one_sentence(plain_fmu, recording, old, new, sentence):
    with pytest.raises(InputError) as caught:
        estimate(read_case(foreign_case(plain_fmu, recording, text=CASE.replace(old, new))))
    assert sentence in str(caught.value) and "\n" not in str(caught.value)
