"""The probe: what an FMU does becomes a finding, and decides how the FMU is driven."""

import json
import time

import pytest
from faulty import faulty_fmu
from foreign_fmus import foreign_fmu

from estimator import probe as module
from estimator.cli import main
from estimator.fmu import describe
from estimator.probe import driven, probe
from estimator.simulate import simulate


def probed(folder, *defines, **options):
    return probe(describe(foreign_fmu(folder, *defines, **options)))


def test_a_good_fmu_is_found_good(tmp_path):
    found = probed(tmp_path)
    assert found.runs and found.restart == "reset" and found.findings == ()
    assert (found.repeats, found.reset, found.apart, found.honours_step) == (True, True, True, True)
    assert set(found.parameters.values()) == {"taken"} and len(found.parameters) == 6
    assert found.steps == 1000 and found.seconds > 0 and found.step_change < 1e-9


RESTARTS = {
    "reset does nothing": (("IDLE_RESET",), "re-instantiate", ()),
    "reset fails": (("FAILING_RESET",), "re-instantiate", ("reset fails: reset returned Error",)),
    "reset crashes": (("CRASHING_RESET",), "re-instantiate", ("reset fails: it crashed (SIGABRT)",)),
    "shared state": (("SHARED", "IDLE_RESET"), "fresh process", ()),
    "once per process": (
        ("ONCE", "IDLE_RESET"),
        "fresh process",
        ("reinstantiate fails: instantiate gave no instance",),
    ),
}


@pytest.mark.parametrize(("defines", "restart", "findings"), RESTARTS.values(), ids=RESTARTS)
def test_what_is_found_decides_how_the_fmu_is_driven(tmp_path, defines, restart, findings):
    found = probe(describe(foreign_fmu(tmp_path, *defines)), thorough=False)
    assert found.restart == restart
    assert found.findings[: len(findings)] == findings
    assert "since reset does not lead back to the beginning" in found.findings[-1]


def test_a_bundled_model_is_trusted_and_another_is_probed_once(tmp_path, monkeypatch):
    assert driven(describe("dc_motor")).probe_simulations == 0
    description = describe(foreign_fmu(tmp_path, "IDLE_RESET"))
    first = driven(description)
    assert first.restart == "re-instantiate" and first.probe_simulations > 0
    monkeypatch.setattr(module, "probe", None)
    assert driven(description) == first


def test_an_fmu_that_ignores_its_step_is_found_out(tmp_path):
    found = probed(tmp_path, "OWN_STEP")
    assert found.honours_step is False
    assert found.findings == ("it ignores the step that it is given: 0.0001 s and 0.001 s give the same samples",)


def test_an_fmu_of_one_step_size_is_found_out(tmp_path):
    found = probed(tmp_path, "ONLY_STEP")
    assert found.findings == ("it refuses a step finer than 0.001 s: doStep returned Discard at t = 0 s",)


def test_euler_inside_is_seen_in_the_step(tmp_path):
    found = probed(tmp_path, "EULER")
    assert found.step_change == pytest.approx(0.03, rel=0.2)
    assert "its outputs change by 3 % of their range from a step of 0.001 s to 0.0001 s" in found.findings[0]


def test_instances_that_share_their_state_are_found_out(tmp_path):
    assert "two instances in one process disturb each other" in probed(tmp_path, "SHARED").findings


def test_an_fmu_that_stops_early_is_probed_as_far_as_it_goes(tmp_path):
    found = probed(tmp_path, "STOPS_AT 0.5")
    assert found.runs and found.steps == 500
    assert found.findings[0] == "it runs for 0.5 s only: doStep returned Discard at t = 0.5 s"


TROUBLES = {
    "hangs in a step": ({"DoStep": "for (;;) {}"}, "it does not run: it does not come back within 8 s"),
    "crashes in a step": ({"DoStep": "abort();"}, "it does not run: it crashed (SIGABRT)"),
    "ends its process": ({"Instantiate": "exit(3);"}, "it does not run: it ended its process (exit status 3)"),
    "gives no instance": ({"Instantiate": "return NULL;"}, "it does not run: instantiate gave no instance"),
}


@pytest.mark.parametrize(("faults", "sentence"), TROUBLES.values(), ids=TROUBLES)
def test_inspect_answers_whatever_the_fmu_does(tmp_path, capsys, faults, sentence):
    fmu = faulty_fmu(tmp_path, **faults)
    began = time.monotonic()
    assert main(["inspect", str(fmu), "--json"]) == 0
    assert time.monotonic() - began < 60
    found = json.loads(capsys.readouterr().out)
    assert found["probe"]["runs"] is False and found["probe"]["problem"] == sentence
    assert found["parameters"][0]["name"] == "R"


def test_inspect_tells_what_the_probe_found_and_guesses_roles(tmp_path, capsys):
    assert main(["inspect", str(foreign_fmu(tmp_path, "IDLE_RESET"))]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "K motor.Ke, motor.Km" in text and "w shaft.w" in text
    assert "it takes motor.Ra, motor.La, motor.Ke, motor.Km, motor.Jm, motor.c" in text
    assert "for every simulation a new instance is made" in text


def test_a_process_of_its_own_for_every_simulation_gives_the_same(tmp_path):
    import numpy as np

    times = np.arange(200) * 1e-3
    inputs = {"u_in": np.where(times > 0.01, 10.0, 0.0)}
    good = simulate(str(foreign_fmu(tmp_path / "good")), parameters={"motor.Ra": 2.0}, inputs=inputs, times=times)
    once = describe(foreign_fmu(tmp_path / "once", "ONCE", "IDLE_RESET"))
    again = simulate(driven(once), parameters={"motor.Ra": 2.0}, inputs=inputs, times=times)
    assert np.array_equal(good["shaft.w"], again["shaft.w"])
