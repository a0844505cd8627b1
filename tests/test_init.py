"""`init` guesses a case file that runs, or says what it could not guess."""

import tomllib
from pathlib import Path

import pytest
from foreign_fmus import foreign_fmu
from motors import CML050, NAMES, all_motors, step_recording, write_recording

from estimator.cases.case import read_case
from estimator.cases.init_case import case_text
from estimator.cli import main
from estimator.estimating.estimate import estimate
from estimator.fmus.fmu import describe
from estimator.recordings.reading import read_recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("init")
    write_recording(step_recording(CML050, lead=0.05, duration=0.4), path / "step.csv")
    foreign_fmu(path)
    return path


def test_a_foreign_motor_is_guessed_and_estimated_without_an_edit(folder, capsys):
    case = folder / "motor.case.toml"
    assert main(["init", str(folder / "foreign.fmu"), str(folder / "step.csv"), "-o", str(case)]) == 0
    assert capsys.readouterr().out == f"{case}\n"
    text = case.read_text()
    assert 'path = "foreign.fmu"' in text and 'file = "step.csv"' in text
    assert tomllib.loads(text)["parameters"]["K"]["fmu"] == ["motor.Ke", "motor.Km"]
    e = estimate(read_case(case))
    assert max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES) < 1e-8


def test_the_bundled_motor_keeps_its_names(folder, capsys):
    assert main(["init", "dc_motor", str(folder / "step.csv")]) == 0
    guessed = tomllib.loads(capsys.readouterr().out)
    assert guessed["fmu"]["path"] == "dc_motor"
    assert guessed["inputs"] == {"v": "voltage"} and guessed["outputs"] == {"i": "current", "w": "speed"}
    assert set(guessed["parameters"]) == set(NAMES) and guessed["fixed"] == {"load": 0.0}


def test_bounds_come_from_the_fmus_limits_and_the_recording_and_without_one_from_starts(folder):
    change = [
        ('(valueReference="0"[^>]*><Real unit="Ohm" start="3.0")', r'\1 min="0.5" max="8"'),
        ('(valueReference="1"[^>]*><Real unit="H") start="0.012"', r'\1 nominal="0.02"'),
        ('(valueReference="4"[^>]*><Real unit="kg.m2") start="1e-05"', r"\1"),
    ]
    fmu = foreign_fmu(folder / "limits", change=change)
    text = case_text(describe(fmu), read_recording(folder / "step.csv"), fmu=str(fmu), folder=folder)
    guessed = tomllib.loads(text)["parameters"]
    assert (guessed["R"]["min"], guessed["R"]["max"]) == (0.5, 8.0)
    assert all(guessed[n]["start"] == pytest.approx(CML050.parameters[n], rel=0.1) for n in NAMES)
    assert "TODO" not in text.split("\n", 2)[2]
    silent = folder / "silent.csv"
    silent.write_text("time [s],voltage [V],current [A],speed [rad/s]\n" + "".join(f"{k},0,0,0\n" for k in range(20)))
    text = case_text(describe(fmu), read_recording(silent), fmu=str(fmu), folder=folder)
    guessed = tomllib.loads(text)["parameters"]
    assert guessed["R"] == {"min": 0.5, "max": 8.0, "start": 3.0, "fmu": "motor.Ra"}
    assert guessed["L"] == {"min": 2e-4, "max": 2.0, "start": 0.02, "fmu": "motor.La"}
    assert guessed["J"] == {"fmu": "motor.Jm"}
    assert [line for line in text.splitlines() if line.startswith("J = ")][0].count("TODO: give min and max") == 1


@pytest.mark.parametrize("motor", all_motors(), ids=lambda m: m.name)
@pytest.mark.parametrize("interval", [1e-4, 1e-3, None])
def test_the_bounds_hold_every_real_motor_and_l_is_no_larger_than_the_currents_rise_allows(motor, interval):
    """At 10 kHz, 1 kHz, and twenty samples a time constant of the speed; coreless ones have 0.002 to 0.2 mH."""
    slow = motor.R * motor.J / (motor.K**2 + motor.R * motor.B)
    step = interval or slow / 20
    if slow < 3 * step or slow > 1e4 * step:
        pytest.skip("too fast or too slow a clock for this motor")
    noise = (0.005 * motor.voltage / motor.R, 0.005 * motor.voltage / motor.K)
    recording = step_recording(motor, lead=20 * step, duration=6 * slow + 20 * step, interval=step, noise=noise)
    guessed = tomllib.loads(case_text(describe("dc_motor"), recording, fmu="dc_motor", folder=Path()))["parameters"]
    for name, value in motor.parameters.items():
        assert guessed[name]["min"] < value < guessed[name]["max"], name
    assert guessed["L"]["max"] < 50 * max(motor.L, motor.R * step), "a slower current rises less from row to row"


def test_of_a_variable_without_a_unit_whose_start_no_such_motor_has_the_fmus_start_says_the_bounds(folder):
    change = [('<Real unit="H" start="0.012"', '<Real start="12"')]
    fmu = foreign_fmu(folder / "bare", change=change)
    text = case_text(describe(fmu), read_recording(folder / "step.csv"), fmu=str(fmu), folder=folder)
    guessed = tomllib.loads(text)["parameters"]["L"]
    assert guessed["start"] == 12.0 and guessed["min"] == 0.12, "12 mH, in an FMU that says no unit"


def test_a_speed_without_a_unit_is_told_what_it_is_taken_for(folder):
    step, taken = (
        read_recording(folder / "step.csv"),
        "[no unit]; taken as rad/s, add gain = 0.1047197551 if it is in rpm",
    )
    for change, told in (([], False), ([('(valueReference="7".*?) unit="rad/s"', r"\1")], True)):
        fmu = foreign_fmu(folder / f"unit{told}", change=change)
        text = case_text(describe(fmu), step, fmu=str(fmu), folder=folder)
        assert (f"# shaft.w {taken}" in text) is told, text


def test_an_angle_stands_for_the_speed_where_no_speed_was_measured(folder):
    encoder = folder / "encoder.csv"
    rows = "".join(f"{k / 1000},{10 * (k > 5)},{k / 100},{k / 10}\n" for k in range(20))
    encoder.write_text("time [s],voltage [V],current [A],angle [rad]\n" + rows)
    change = [('name="shaft.w"', 'name="shaft.phi"'), ('(valueReference="7".*?)unit="rad/s"', r'\1unit="rad"')]
    change += [('<Unit name="rad/s"></Unit>', '<Unit name="rad"></Unit>')]
    fmu = foreign_fmu(folder / "angle", change=change)
    guessed = tomllib.loads(case_text(describe(fmu), read_recording(encoder), fmu=str(fmu), folder=folder))
    assert guessed["outputs"]["angle"] == {"column": "angle", "fmu": "shaft.phi"}


def test_the_speed_drives_the_electrical_part_of_a_motor_alone(folder):
    """The speed was asked for among the outputs, and K then moved no signal."""
    shaft = ('valueReference="7" causality="output" variability="continuous" initial="exact"', 'valueReference="7"')
    change = [(shaft[0], f'{shaft[1]} causality="input" variability="continuous"')]
    change += [('name="motor.Jm"', 'name="p4"'), ('unit="kg.m2"', 'unit="1"'), ('name="kg.m2"', 'name="1"')]
    change += [('name="motor.c"', 'name="p5"'), ('unit="N.m.s/rad"', 'unit="A"')]
    fmu = foreign_fmu(folder / "electrical", change=change)
    text = case_text(describe(fmu), read_recording(folder / "step.csv"), fmu=str(fmu), folder=folder)
    guessed = tomllib.loads(text)
    assert guessed["inputs"]["shaft.w"] == {"column": "speed", "between": "linear"}
    assert set(guessed["outputs"]) == {"i"} and set(guessed["parameters"]) == {"R", "K", "L"}
    assert "nothing looks like it" not in text and "no variable looks like it" not in text


def test_what_could_not_be_guessed_is_marked(folder, capsys):
    change = [('name="motor.Ra"', 'name="motor.p1"'), ('unit="Ohm"', 'unit="1"'), ('name="Ohm"', 'name="1"')]
    odd = foreign_fmu(folder / "odd", change=change)
    strange = folder / "strange.csv"
    strange.write_text("time [s],channel 1,speed [rad/s]\n" + "".join(f"{k / 1000},{k},{k}\n" for k in range(20)))
    assert main(["init", str(odd), str(strange), "-o", str(folder / "odd.case.toml")]) == 0
    assert "to fill in, marked TODO" in capsys.readouterr().out
    text = (folder / "odd.case.toml").read_text()
    marked = [line.split(" = ")[0] for line in text.splitlines()[2:] if "TODO" in line]
    assert marked[:3] == ["# v", "# i", "# R"]
    assert "# Columns of the recording that are not used: channel 1" in text


def test_bounds_of_parameters_that_need_not_be_estimated_are_nothing_to_fill_in(folder, capsys):
    kind = 'causality="parameter" variability="fixed"'
    offset = f'<ScalarVariable name="offset" valueReference="0" {kind}><Real start="0"/></ScalarVariable>'
    fmu = foreign_fmu(folder / "offset", change=[("</ModelVariables>", f"{offset}</ModelVariables>")])
    path = folder / "offset.case.toml"
    assert main(["init", str(fmu), str(folder / "step.csv"), "-o", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    assert "# offset = { start = 0.0 }  # give min and max" in path.read_text()


def test_the_word_of_the_mark_in_a_description_is_nothing_to_fill_in(folder, capsys):
    fmu = foreign_fmu(folder / "remarked", change=[('name="motor.La"', 'name="motor.La" description="TODO: measure"')])
    assert main(["init", str(fmu), str(folder / "step.csv"), "-o", str(folder / "remarked.case.toml")]) == 0
    assert capsys.readouterr().out == f"{folder / 'remarked.case.toml'}\n"


@pytest.mark.parametrize("fmu", ["dc_motor", "foreign.fmu"])
def test_a_recording_in_the_place_of_the_fmu_is_told(fmu, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["init", "step.csv", fmu]) == 2
    sentence = f"{fmu} is an FMU; init takes it first: fmu-estimator init {fmu} step.csv"
    assert capsys.readouterr().err == f"fmu-estimator: {sentence}\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["-o", "x.toml"], "x.toml: the name of a case file ends in .case.toml; give -o x.case.toml"),
        (["-o", "there.case.toml"], "there.case.toml is there already; give another name with -o, or remove it"),
    ],
)
def test_a_name_that_will_not_do_is_told(folder, monkeypatch, capsys, arguments, sentence):
    monkeypatch.chdir(folder)
    (folder / "there.case.toml").write_text("")
    assert main(["init", "foreign.fmu", "step.csv", *arguments]) == 2
    assert capsys.readouterr().err == f"fmu-estimator: {sentence}\n"


NAMESAKES = "time [s],u_in,extra,shaft.w\n" + "".join(f"{k / 1000},{k},{k},{k}\n" for k in range(20))


def test_columns_that_are_called_as_the_variables_come_first(folder):
    namesakes = folder / "namesakes.csv"
    namesakes.write_text(NAMESAKES)
    fmu = folder / "foreign.fmu"
    foreign_fmu(folder)
    text = case_text(describe(fmu), read_recording(namesakes), fmu=str(fmu), folder=folder)
    guessed = tomllib.loads(text)
    assert guessed["inputs"] == {"v": {"column": "u_in", "fmu": "u_in"}}
    assert guessed["outputs"]["w"] == {"column": "shaft.w", "fmu": "shaft.w"}
    assert "# Columns of the recording that are not used: extra" in text


def test_a_load_that_the_recording_has_is_no_zero_and_every_input_of_its_name_is_driven(folder):
    loaded = folder / "loaded.csv"
    rows = "".join(f"{k / 1000},1,2,3,4\n" for k in range(20))
    loaded.write_text("time [s],voltage [V],load,current [A],speed [rad/s]\n" + rows)
    guessed = tomllib.loads(case_text(describe("dc_motor"), read_recording(loaded), fmu="dc_motor", folder=folder))
    assert guessed["inputs"] == {"v": "voltage", "load": "load"} and "fixed" not in guessed


def test_a_file_of_several_tests_is_guessed_by_its_columns(folder, tmp_path, capsys):
    header, *rows = [line for line in (folder / "step.csv").read_text().splitlines() if not line.startswith("#")]
    path = tmp_path / "both.csv"
    path.write_text("\n".join([f"test,{header}", *(f"{k},{row}" for k in (1, 2) for row in rows)]) + "\n")
    assert main(["init", "dc_motor", str(path)]) == 0
    alone = tomllib.loads(capsys.readouterr().out)
    assert main(["init", "dc_motor", str(folder / "step.csv")]) == 0
    usual = tomllib.loads(capsys.readouterr().out)
    assert alone["outputs"] == usual["outputs"] and alone["inputs"] == usual["inputs"]


COUNTED = "micros,U [V],I [mA],encoder [counts]\n" + "".join(
    f"{1000 * k},{6 * (k > 4)},{200 * (k > 4) * (0.1 + 0.9**k):.2f},{2 * max(k - 5, 0) ** 2}\n" for k in range(40)
)


def test_how_the_file_is_read_is_asked_for_and_written_into_the_case(tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_text(COUNTED)
    assert main(["init", "dc_motor", str(log)]) == 0
    told = capsys.readouterr().out
    assert "no column looks like speed ('encoder' counts an encoder: init again with --counts 4000)" in told
    case = tmp_path / "log.case.toml"
    assert main(["init", "dc_motor", str(log), "--counts", "2048", "--unit", "i=A", "-o", str(case)]) == 0
    guessed = tomllib.loads(case.read_text())
    assert guessed["outputs"] == {"i": "I", "angle": "encoder"}
    assert guessed["recording"] == [{"file": "log.csv", "units": {"i": "A"}, "counts": 2048}]
    assert guessed["parameters"]["R"]["min"] < 6 / 200 < guessed["parameters"]["R"]["max"], "of amperes"
    assert read_case(case).run(0).read_as.counts == 2048
    assert guessed["parameters"]["J"]["max"] != pytest.approx(9e-4), "by the angle's slope, not around the FMU's start"
