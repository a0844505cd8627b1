"""`simulate` on FMUs of other tools: SI units whatever the FMU's own are, the probe's findings, exit status 2."""

import numpy as np
import pytest
from foreign_fmus import foreign_fmu

from estimator.api import simulate_fmu
from estimator.cli import main
from estimator.commands.drive import instants
from estimator.recordings.reading import read_recording

DRIVE = ["--voltage-step", "10.5@0.01", "--stop", "0.05", "--set", "motor.La=0.02", "--set", "motor.Jm=2e-5"]


def test_values_are_si_whatever_units_the_fmu_has(tmp_path):
    for name, defines in (("plain", ()), ("workshop", ("WORKSHOP_UNITS",))):
        fmu = foreign_fmu(tmp_path / name, *defines)
        assert main(["simulate", str(fmu), *DRIVE, "-o", str(tmp_path / f"{name}.csv")]) == 0
    header = (tmp_path / "workshop.csv").read_text().splitlines()[0]
    assert header == "time [s],u_in [V],shaft.w [rad/s]"
    plain, workshop = (read_recording(tmp_path / f"{n}.csv").signals["shaft.w"] for n in ("plain", "workshop"))
    assert np.max(plain) > 100 and np.max(np.abs(plain - workshop)) < 1e-9


def test_from_python_values_are_in_the_units_of_the_fmu(tmp_path):
    times, fmu = np.arange(50) * 1e-3, foreign_fmu(tmp_path, "WORKSHOP_UNITS")
    own = simulate_fmu(fmu, times=times, parameters={"motor.La": 20.0}, inputs={"u_in": np.full(50, 10.5)})
    plain = foreign_fmu(tmp_path / "plain")
    si = simulate_fmu(plain, times=times, parameters={"motor.La": 0.02}, inputs={"u_in": np.full(50, 10.5)})
    assert np.allclose(own["shaft.w"], si["shaft.w"] * 30 / np.pi, rtol=1e-12, atol=0)


def test_an_fmu_that_answers_error_ends_with_status_2(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, "STOPS_AT 0.02", change=[('stopTime="1"', 'stopTime="0.02"')])
    assert main(["simulate", str(fmu)]) == 2
    assert capsys.readouterr().err == (
        "fmu-estimator: foreign.fmu failed: doStep returned Discard at t = 0.02 s; the FMU's own stop time is 0.02 s"
        " and it goes no further; use a shorter recording, or export the FMU with a later stop time\n"
    )


def test_an_fmu_of_another_start_time_is_begun_there(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, "STARTS_AT 5.0", change=[('startTime="0" stopTime="1"', 'startTime="5" stopTime="6"')])
    assert main(["simulate", str(fmu), *DRIVE]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("0.0,")


@pytest.mark.parametrize("step", [1e-3, 2.5e-4, 3e-3, 1e-6, 0.1])
def test_instants_are_the_floats_that_are_written_shortest(step):
    shown = [repr(t) for t in instants(stop=3000 * step, step=step).tolist()]
    assert len(shown) == 3001 and max(len(text.split("e")[0]) for text in shown) <= 8


def test_more_samples_than_any_table_holds_are_refused_at_once(capsys):
    assert main(["simulate", "dc_motor", "--stop", "1e9"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "1e+09 s in steps of 0.001 s are 1e+12 samples" in told and "give a longer --step" in told


def signals(causality, count):
    row = '<ScalarVariable name="{0}{1}" valueReference="{2}" causality="{0}" variability="continuous"><Real{3}/>'
    reference, start = (7, "") if causality == "output" else (6, ' start="0"')
    rows = (row.format(causality, k, reference, start) + "</ScalarVariable>" for k in range(count))
    return [("</ModelVariables>", "".join(rows) + "</ModelVariables>")]


def test_more_outputs_than_are_read_at_once_are_all_shown(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, change=signals("output", 150))
    assert main(["simulate", str(fmu), *DRIVE]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split(",")[2:] == ["shaft.w [rad/s]", *(f"output{k}" for k in range(150))]
    last = rows[-1].split(",")[2:]
    assert len(set(last)) == 1 and float(last[0]) > 100


def test_more_inputs_than_are_set_at_once_are_told(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, change=signals("input", 65))
    settings = [option for k in range(65) for option in ("--set", f"input{k}=1")]
    assert main(["simulate", str(fmu), *settings]) == 2
    assert capsys.readouterr().err == "fmu-estimator: 65 inputs at once are more than 64; leave some out\n"
