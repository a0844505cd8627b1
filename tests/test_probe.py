"""The probe: what an FMU does becomes a finding, and decides how the FMU is driven."""

import json
import time

import pytest
from faulty import faulty_fmu
from foreign_fmus import foreign_fmu

from estimator.cli import main
from estimator.commands.inspection import grouped, probe_sentences
from estimator.fmus import probe as module
from estimator.fmus import probe_stages
from estimator.fmus.fmu import describe
from estimator.fmus.kinds import better_kind
from estimator.fmus.probe import driven, probe
from estimator.fmus.simulate import simulate


def probed(folder, *defines, **options):
    return probe(describe(foreign_fmu(folder, *defines, **options)))


def test_a_good_fmu_is_found_good(tmp_path):
    found = probed(tmp_path)
    assert found.runs and found.restart == "reset" and found.findings == ()
    assert (found.repeats, found.reset, found.apart, found.honours_step) == (True, True, True, True)
    assert set(found.parameters.values()) == {"taken"} and len(found.parameters) == 6
    assert found.steps == 1000 and found.seconds > 0 and found.step_change < 1e-9


def test_parameters_are_set_where_the_stepping_loop_sets_them(tmp_path):
    found = probed(tmp_path, "FORGETS_AT_SETUP")  # some FMUs forget what is set before the experiment is set up
    assert set(found.parameters.values()) == {"taken"} and found.findings == ()


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
    assert sum("of their range" in sentence for sentence in probe_sentences(found)) == 1


def test_instances_that_share_their_state_are_found_out(tmp_path):
    assert "two instances in one process disturb each other" in probed(tmp_path, "SHARED").findings


def test_an_fmu_that_stops_early_is_probed_as_far_as_it_goes(tmp_path):
    found = probed(tmp_path, "STOPS_AT 0.5")
    assert found.runs and found.steps == 500
    assert found.findings[0] == "it runs for 0.5 s only: doStep returned Discard at t = 0.5 s"


TROUBLES = {
    "crashes in a step": ({"DoStep": "abort();"}, "it does not run: it crashed (SIGABRT)"),
    "ends its process": ({"Instantiate": "exit(3);"}, "it does not run: it ended its process (exit status 3)"),
    "gives no instance": ({"Instantiate": "return NULL;"}, "it does not run: instantiate gave no instance"),
    "hangs in a step": ({"DoStep": "pause();"}, "it does not run: it does not come back within 1 s"),
    "hangs in instantiate": ({"Instantiate": "pause();"}, "it does not run: it does not come back within 1 s"),
    "hangs when loaded": (
        {"besides": "__attribute__((constructor)) static void load(void) { pause(); }"},
        "it does not run: it does not come back within 1 s",
    ),
}


BY_DEFAULT = ("crashes in a step", "gives no instance", "hangs in instantiate")  # one of each kind of sentence


@pytest.mark.parametrize(
    ("faults", "sentence"),
    [pytest.param(*t, id=k, marks=() if k in BY_DEFAULT else pytest.mark.full) for k, t in TROUBLES.items()],
)
def test_inspect_answers_whatever_the_fmu_does(tmp_path, capsys, monkeypatch, faults, sentence):
    if "come back" in sentence:
        monkeypatch.setattr(probe_stages, "STAGE_LIMIT", 1.0)
    fmu = faulty_fmu(tmp_path, **faults)
    assert main(["inspect", str(fmu), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["probe"]["runs"] is False and found["probe"]["problem"] == sentence
    assert found["parameters"][0]["name"] == "R"
    assert main(["simulate", str(fmu)]) == 2
    assert capsys.readouterr().err == f"fmu-estimator: faulty.fmu cannot be used: {sentence}\n"


LATER = {
    "hangs in reset": ({"Reset": "for (;;) {}"}, "reset fails: it does not come back within"),
    "hangs in the second step": ({"DoStep": "if (time > 0.5) for (;;) {}"}, "it does not run: it does not come back"),
    "hangs at a fine step": ({"DoStep": "if (h < 9e-4) for (;;) {}"}, "at a ten times finer step it fails: it does"),
    "hangs with another value": (
        {"SetReal": "for (size_t k = 0; k < n; k++) if (references[k] == 4 && values[k] != 0) for (;;) {}"},
        "its parameters could not all be tried: it does not come back within",
    ),
}


@pytest.mark.full
@pytest.mark.parametrize(("faults", "finding"), LATER.values(), ids=LATER)
def test_inspect_answers_within_a_minute_wherever_the_fmu_hangs(tmp_path, capsys, faults, finding):
    fmu = faulty_fmu(tmp_path, **faults)
    began = time.monotonic()
    assert main(["inspect", str(fmu)]) == 0
    assert time.monotonic() - began < 60
    assert finding in capsys.readouterr().out


def test_an_fmu_that_hangs_when_it_is_freed_gets_fresh_processes(tmp_path, monkeypatch):
    monkeypatch.setattr(probe_stages, "STAGE_LIMIT", 2.0)
    found = probe(describe(foreign_fmu(tmp_path, "HANGING_FREE", "IDLE_RESET")), thorough=False)
    assert found.runs and found.restart == "fresh process"
    assert "reinstantiate fails: it does not come back within 2 s" in found.findings


def test_inspect_probes_both_kinds_or_the_one_that_is_chosen(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, "BROKEN_EQUATIONS 0.1", kinds=("co-simulation", "model-exchange"))
    assert main(["inspect", str(fmu), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "co-simulation" and found["probe"] == found["probes"]["co-simulation"]
    assert found["probe"]["runs"] and found["probe"]["findings"] == []
    assert "it runs for 0.099 s only: doStep returned Error" in found["probes"]["model-exchange"]["findings"][0]
    assert main(["inspect", str(fmu), "--kind", "model-exchange"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "What the probe found, for model-exchange: - it loads" in text and "for co-simulation:" not in text
    assert "it is used for model-exchange: as it was chosen" in text
    assert main(["inspect", str(fmu), "--static"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "It offers both kinds; it is used for co-simulation: the FMU then brings its own solver" in text
    assert "choose model-exchange with --kind, or with kind under [fmu]" in text


@pytest.mark.smoke
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


def test_an_output_that_is_no_number_repeats_itself(tmp_path):
    body = "fmi2Status s = ORIGINAL; for (size_t k = 0; k < n; k++) values[k] = 0.0 / 0.0; return s;"
    found = probe(describe(faulty_fmu(tmp_path, GetReal=body)), thorough=False)
    assert found.restart == "reset"
    assert any("an output becomes infinite or not a number" in sentence for sentence in found.findings)


def test_an_output_that_differs_in_every_run_is_named_and_the_others_are_compared(tmp_path):
    angle = describe("dc_motor").variable("angle").value_reference
    clock = "static double t; t += 1e-9 * getpid(); values[k] = t;"
    body = (
        f"fmi2Status s = ORIGINAL; for (size_t k = 0; k < n; k++) if (references[k] == {angle}) {{ {clock} }} return s;"
    )
    found = probe(describe(faulty_fmu(tmp_path, GetReal=body)))
    assert found.repeats is True and found.reset is True
    assert any("differs from run to run; the other outputs repeat" in sentence for sentence in found.findings)


def test_an_fmu_that_does_not_run_is_not_said_to_be_fit_for_use(tmp_path, capsys):
    fmu = faulty_fmu(tmp_path, Instantiate="return NULL;")
    assert main(["inspect", str(fmu)]) == 0
    out = capsys.readouterr().out
    assert "Nothing keeps it from use here." not in out
    assert "What would go wrong:\n  - it does not run: instantiate gave no instance" in out


def test_kinds_that_do_not_agree_are_told_and_the_equations_are_taken(tmp_path, capsys):
    fmu = foreign_fmu(tmp_path, "EULER", kinds=("co-simulation", "model-exchange"))
    better, why = better_kind(describe(fmu), 0.02)
    assert better.kind == "model-exchange" and "% of the outputs' range from its own equations" in why
    assert (
        better_kind(describe(foreign_fmu(tmp_path / "good", kinds=("co-simulation", "model-exchange"))), 0.02)[1] == ""
    )


def test_findings_of_a_validator_are_grouped():
    found = [f"ERROR (line {k}, column 0): attribute 'order' is not allowed." for k in range(9)] + ["another"]
    assert grouped(found) == [f"{found[0]} (and 8 more such)", "another"]
