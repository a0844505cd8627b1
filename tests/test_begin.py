"""How a simulation begins: a motor as the data show, another FMU as it and the case give its states, or as is said."""

import numpy as np
import pytest
from foreign_fmus import foreign_case, foreign_fmu
from motors import CML050

from estimator.cases.case import read_case
from estimator.cases.written_case import write_case
from estimator.errors import CaseError
from estimator.estimating.estimate import estimate
from estimator.fmus.fmu import describe
from estimator.fmus.simulate import simulate
from estimator.plans.planning import plan_case

# The same motor, by names that are no motor's: to the program it is an FMU like any other.
STRANGE = """
[fmu]
path = "{fmu}"
[inputs]
drive = {{ column = "drive", fmu = "u_in" }}
[outputs]
shown = {{ column = "shown", fmu = "shaft.w" }}
[parameters]
first = {{ min = 0.5, max = 20, fmu = "motor.Ra" }}
inertia = {{ min = 1e-6, max = 1e-4, fmu = "motor.Jm" }}
[[recording]]
file = "{recording}"
"""


@pytest.fixture(scope="module")
def strange(tmp_path_factory):
    """Return an FMU and a recording whose input is 6 in the first row, where the outputs begin at zero."""
    folder = tmp_path_factory.mktemp("begin")
    fmu = foreign_fmu(folder)
    times = 1e-3 * np.arange(300)
    drive = np.where(times < 0.15, 6.0, 9.0)
    values = {"motor.Ra": 2.0, "motor.Jm": 2e-5}
    speed = simulate(str(fmu), parameters=values, inputs={"u_in": drive}, times=times)["shaft.w"]
    speed += 1e-3 * np.ptp(speed) * np.random.default_rng(1).standard_normal(len(times))
    recording = folder / "run.csv"
    rows = np.column_stack([times, drive, speed])
    np.savetxt(recording, rows, delimiter=",", header="time [s],drive,shown", comments="")
    return fmu, recording


def planned(fmu, recording, text):
    return plan_case(read_case(foreign_case(fmu, recording, text=text)), describe(fmu))


def test_an_fmu_that_is_no_motor_begins_as_it_is_given_whatever_its_input_is_in_the_first_row(strange):
    fmu, recording = strange
    assert planned(fmu, recording, STRANGE).observed[0].lead == 0
    found = estimate(read_case(foreign_case(fmu, recording, text=STRANGE)))
    for name, truth in (("first", 2.0), ("inertia", 2e-5)):
        p = found.parameters[name]
        assert abs(p.value - truth) < 4 * p.standard_error and p.standard_error < 0.02 * truth


@pytest.mark.parametrize(("begin", "leads"), [("rest", False), ("given", False), ("settled", True)])
def test_the_case_says_how_a_simulation_begins(strange, begin, leads):
    observed = planned(*strange, f'{STRANGE}begin = "{begin}"\n').observed[0]
    assert (observed.lead > 0) == leads


def test_a_motor_that_runs_already_is_run_in_and_that_is_told(tmp_path):
    times, before = 1e-3 * np.arange(200), 500
    volts = np.where(times < 0.1, 6.0, 9.0)
    long = {"v": np.r_[np.full(before, 6.0), volts]}
    shown = simulate("dc_motor", parameters=CML050.parameters, inputs=long, times=1e-3 * np.arange(before + 200))
    rows = np.column_stack([times, volts, shown["i"][before:], shown["w"][before:]])
    recording = tmp_path / "running.csv"
    np.savetxt(recording, rows, delimiter=",", header="time [s],voltage [V],current [A],speed [rad/s]", comments="")
    case = tmp_path / "running.case.toml"
    for begin, runs_in in (("", True), ('begin = "rest"', False), ('begin = "given"', False)):
        case.write_text(f'[[recording]]\nfile = "running.csv"\n{begin}\n')
        plan = plan_case(read_case(case), describe("dc_motor"))
        assert (plan.observed[0].lead > 0) == runs_in
        assert any("its simulation is run in at the first row's inputs" in note for note in plan.notes) == runs_in


def test_a_motor_whose_speed_is_zero_begins_at_rest_though_its_current_rises_in_the_first_row(tmp_path):
    times = 1e-3 * np.arange(400)
    volts = np.where(times < 0.2, 6.0, 9.0)
    shown = simulate("dc_motor", parameters=CML050.parameters, inputs={"v": volts}, times=times)
    current = np.r_[shown["i"][1:], shown["i"][-1]]  # sampled at the end of each row
    assert current[0] > 0.2 * np.ptp(current) > 0
    current += 0.005 * np.random.default_rng(1).standard_normal(len(times))
    rows = np.column_stack([times, volts, current, shown["w"]])
    recording = tmp_path / "on.csv"
    np.savetxt(recording, rows, delimiter=",", header="time [s],voltage [V],current [A],speed [rad/s]", comments="")
    case = tmp_path / "on.case.toml"
    case.write_text('[[recording]]\nfile = "on.csv"\n')
    observed = plan_case(read_case(case), describe("dc_motor")).observed[0]
    assert observed.lead == 0 and not observed.excitation.running


def test_another_beginning_is_refused_with_those_that_there_are(strange):
    with pytest.raises(CaseError, match=r'begin.*"rest".*"settled".*"given"|begin.*rest, settled, given'):
        planned(*strange, f'{STRANGE}begin = "running"\n')


def test_a_beginning_survives_writing_the_case(strange, tmp_path):
    case = read_case(foreign_case(*strange, text=f'{STRANGE}begin = "settled"\n'))
    write_case(case, tmp_path / "again.case.toml")
    assert read_case(tmp_path / "again.case.toml").runs[0].begin == "settled"


@pytest.mark.parametrize("way", ["held", pytest.param("on a line", marks=pytest.mark.full)])
def test_how_an_input_goes_from_row_to_row_is_seen_where_the_case_does_not_say_it(strange, tmp_path, way):
    fmu, _ = strange
    fine = 1e-3 * np.arange(750)
    rows = 6 + 3 * np.sin(40 * fine[::10])
    drive = np.interp(fine, fine[::10], rows) if way == "on a line" else np.repeat(rows, 10)
    values = {"motor.Ra": 2.0, "motor.Jm": 2e-5}
    speed = simulate(str(fmu), parameters=values, inputs={"u_in": drive}, times=fine)["shaft.w"][::10]
    speed += 1e-3 * np.ptp(speed) * np.random.default_rng(1).standard_normal(len(speed))
    run = tmp_path / "run.csv"
    table = np.column_stack([fine[::10], rows, speed])
    np.savetxt(run, table, delimiter=",", header="time [s],drive,shown", comments="")
    found = estimate(read_case(foreign_case(fmu, run, text=STRANGE)))
    assert f"between the rows: drive {way}, which explains the recording better" in found.notes
    for name, truth in (("first", 2.0), ("inertia", 2e-5)):
        assert abs(found.parameters[name].value - truth) < 4.5 * found.parameters[name].standard_error
    between = {"on a line": "linear", "held": "held"}[way]
    said = STRANGE.replace('fmu = "u_in" }}', f'fmu = "u_in", between = "{between}" }}}}')
    plain = estimate(read_case(foreign_case(fmu, run, text=said)))
    assert not any("between the rows" in note for note in plain.notes)
    for name in ("first", "inertia"):
        assert plain.parameters[name].value == pytest.approx(found.parameters[name].value, rel=1e-6)
