"""An FMU that this project did not compile: pythonfmu's, whose model is Python and slow."""

import re
import tomllib
from pathlib import Path

import pytest
from motors import CML050, NAMES, step_recording, write_recording

from estimator.api import estimate_parameters
from estimator.cases.case import read_case
from estimator.cli import main
from estimator.estimating.estimate import estimate

builder = pytest.importorskip("pythonfmu.builder")

CASE = """
[fmu]
path = "PythonMotor.fmu"
[inputs]
v = { column = "voltage", fmu = "u" }
[outputs]
i = { column = "current", fmu = "ia" }
w = "speed"
[parameters]
R = { fmu = "Ra", min = 0.5, max = 20 }
K = { fmu = "Kt", min = 0.005, max = 0.5 }
L = { fmu = "La", min = 0.002, max = 0.1 }
J = { fmu = "Jm", min = 1e-6, max = 1e-4 }
B = { fmu = "d", min = 1e-6, max = 1e-2 }
[[recording]]
file = "step.csv"
"""


def test_a_python_fmu_is_estimated_and_its_cost_is_said_before_the_search(tmp_path, monkeypatch):
    builder.FmuBuilder.build_FMU(str(Path(__file__).parent / "foreign" / "python_motor.py"), dest=str(tmp_path))
    write_recording(step_recording(CML050, lead=0.01, duration=0.1, interval=2e-3), tmp_path / "step.csv")
    (tmp_path / "motor.case.toml").write_text(CASE)
    monkeypatch.setattr("estimator.judging.sensitivities.LONG", 0.1)
    said = []
    e = estimate(read_case(tmp_path / "motor.case.toml"), workers=1, tell=said.append)
    assert re.match(
        r"one simulation of this FMU takes [\d.e-]+ s; some 300 of them, by 1 worker, will take about [\d.]+ s, more",
        said[0],
    )
    assert e.notes[0] == said[0]
    assert max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES) < 1e-3


def test_its_cost_is_said_on_every_way_to_an_estimate(tmp_path, monkeypatch, capsys, caplog):
    builder.FmuBuilder.build_FMU(str(Path(__file__).parent / "foreign" / "python_motor.py"), dest=str(tmp_path))
    write_recording(step_recording(CML050, lead=0.01, duration=0.1, interval=2e-3), tmp_path / "step.csv")
    case = tmp_path / "motor.case.toml"
    case.write_text(CASE)
    monkeypatch.setattr("estimator.judging.sensitivities.LONG", 0.0)
    for more in ([], ["--checkpoint", str(tmp_path / "journal")]):
        assert main(["estimate", str(case), "--method", "integral", *more]) == 0
        assert "one simulation of this FMU takes" in capsys.readouterr().err
    estimate_parameters(case, method="integral")
    assert "one simulation of this FMU takes" in caplog.text


def test_init_gives_d_the_part_that_is_left_and_bounds_from_the_recording_though_no_variable_has_a_unit(
    tmp_path, capsys
):
    builder.FmuBuilder.build_FMU(str(Path(__file__).parent / "foreign" / "python_motor.py"), dest=str(tmp_path))
    write_recording(step_recording(CML050, lead=0.01, duration=0.1, interval=2e-3), tmp_path / "step.csv")
    case = tmp_path / "motor.case.toml"
    assert main(["init", str(tmp_path / "PythonMotor.fmu"), str(tmp_path / "step.csv"), "-o", str(case)]) == 0
    assert capsys.readouterr().out == f"{case}\n", "nothing is left to fill in"
    guessed = tomllib.loads(case.read_text())["parameters"]
    assert {name: p["fmu"] for name, p in guessed.items()} == {"R": "Ra", "K": "Kt", "L": "La", "J": "Jm", "B": "d"}
    assert guessed["L"]["min"] == pytest.approx(1e-4 * 2e-3 * CML050.R, rel=0.3)


def test_inspect_runs_it(tmp_path, capsys):
    builder.FmuBuilder.build_FMU(str(Path(__file__).parent / "foreign" / "python_motor.py"), dest=str(tmp_path))
    assert main(["inspect", str(tmp_path / "PythonMotor.fmu")]) == 0
    assert "it takes Ra, La, Kt, Jm, d" in capsys.readouterr().out
