"""FMI 1.0, 2.0 and 3.0, co-simulation and model exchange: the same motor comes out of each."""

import pytest
from foreign_fmus import CASE, foreign_case, foreign_fmu
from motors import CML050, NAMES, step_recording

from estimator.case import read_case
from estimator.estimate import estimate
from estimator.recording import write_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    write_recording(step_recording(CML050, lead=0.01, duration=0.25), path)
    return path


def worst(e):
    return max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES)


def test_fmi_3_co_simulation_is_estimated_to_1e_8(tmp_path, recording):
    text = CASE + "[fixed]\nmode = 1\nenabled = true\n"
    e = estimate(read_case(foreign_case(foreign_fmu(tmp_path, version=3), recording, text=text)))
    assert worst(e) < 1e-8
    assert (e.fmu["fmi_version"], e.fmu["kind"]) == ("3.0", "co-simulation")


def test_fmi_1_co_simulation_is_estimated_to_1e_8(tmp_path, recording):
    e = estimate(read_case(foreign_case(foreign_fmu(tmp_path, version=1), recording)))
    assert worst(e) < 1e-8
    assert e.fmu["fmi_version"] == "1.0"


def test_model_exchange_is_estimated_to_1e_5(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, kinds=("model-exchange",))
    e = estimate(read_case(foreign_case(fmu, recording)))
    assert worst(e) < 1e-5
    assert e.fmu["kind"] == "model-exchange"


def test_an_fmu_that_offers_both_is_stepped_by_itself_unless_the_user_chooses(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, kinds=("co-simulation", "model-exchange"))
    assert read_case(foreign_case(fmu, recording)).kind is None
    chosen = CASE.replace("[inputs]", 'kind = "model-exchange"\n[inputs]')
    assert read_case(foreign_case(fmu, recording, text=chosen)).kind == "model-exchange"
