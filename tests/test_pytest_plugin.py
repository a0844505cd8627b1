"""Case files as tests: what passes, what fails and what is said then, through pytest itself (pytester)."""

import shutil
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import estimator.batches.batch_folder  # noqa: F401
from estimator.batches.case_worker import CaseWorker
from estimator.cases.case import case_for_recording
from estimator.results.export import result_files

pytest_plugins = ["pytester"]

EXAMPLE = Path(__file__).parent.parent / "examples" / "cml050_step.csv"
# The entry point is blocked and the module named, so that it makes no difference whether the package is installed.
PLUGIN = (
    *("-p", "no:fmu-estimator", "-p", "estimator.pytest_plugin", "-W", "error"),
    *("-p", "no:hypothesispytest", "-p", "no:anyio"),  # others, which take time to load
)
RECORDING = '[[recording]]\nfile = "motor.csv"\n'
MET = '[expect]\nR = { value = 3.1363, within = "5 %" }\nK = { min = 0.04, max = 0.06 }\n'


@pytest.fixture(scope="module")
def loaded():
    """Import all that an estimate and its figure need: pytester forgets what was imported inside, and numpy minds."""
    with CaseWorker() as case_worker:
        result_files(case_worker.estimate(case_for_recording(EXAMPLE)))


@pytest.fixture
def project(loaded, pytester, monkeypatch):
    """Return a maker of a folder with recordings and one case file, and a runner of pytest in it."""
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE.parent.parent))
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    monkeypatch.delenv("PYTEST_XDIST_TESTRUNUID", raising=False)
    shutil.copy(EXAMPLE, pytester.path / "motor.csv")

    def run(*arguments, case=None, subprocess=False):
        if case is not None:
            (pytester.path / "line.case.toml").write_text(case)
        runner = pytester.runpytest_subprocess if subprocess else pytester.runpytest_inprocess
        return runner(*PLUGIN, *arguments)

    run.path = pytester.path
    return run


def test_every_expectation_is_a_test(project):
    result = project("-v", case=RECORDING + MET + "[nameplate]\nvoltage = 10.5\nKt = { min = 0.04 }\n")
    result.assert_outcomes(passed=4)
    result.stdout.fnmatch_lines(
        [f"line.case.toml::{name} PASSED*" for name in ("verdict", "R", "K", "nameplate_Kt")], consecutive=True
    )


def test_a_failure_shows_measured_expected_error_and_the_figure(project):
    result = project("-q", case=RECORDING + "[expect]\nR = { value = 3.5, within = 0.1 }\nrmse = { i = 1e-6 }\n")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines(
        ["R not met: measured 3.1* ± 0.0* Ohm, expected 3.5 Ohm within 0.1 Ohm", "see *figure.png"]
    )
    result.stdout.fnmatch_lines(["FAILED line.case.toml::rmse_of_i - rmse of i not met: measured 0.0*"])
    result.stdout.no_fnmatch_line("*Traceback*")
    figure = next(line for line in result.outlines if line.startswith("see ")).removeprefix("see ")
    assert Path(figure).read_bytes().startswith(b"\x89PNG")


def test_an_interval_that_crosses_a_limit_is_undecided(project):
    case = RECORDING + "[expect]\nconfidence = 0.95\nR = { min = 3.13, max = 3.1300001 }\n"
    result = project("-q", "-p", "no:cacheprovider", case=case)
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        ["R undecided: measured 3.1*; its 0.95 interval is 3.* to 3.* Ohm, which crosses a limit"]
    )


@pytest.mark.parametrize(("expect", "outcome"), [('verdict = "refused"', "passed"), ("", "failed")])
def test_a_recording_may_have_to_be_refused(expect, outcome, project):
    rows = "".join(f"{k / 1000},0,0,0\n" for k in range(300))
    (project.path / "motor.csv").write_text("time [s],voltage [V],current [A],speed [rad/s]\n" + rows)
    result = project("-q", "-p", "no:cacheprovider", case=f"{RECORDING}[expect]\n{expect}\n")
    result.assert_outcomes(**{outcome: 1})
    if outcome == "failed":
        result.stdout.fnmatch_lines(
            ["verdict not met: the verdict is refused (the voltage is zero*expected ok or doubtful"]
        )


def test_a_mistake_in_a_case_file_is_one_sentence(project):
    (project.path / "good.case.toml").write_text(RECORDING)
    result = project("-q", "--continue-on-collection-errors", case=RECORDING + "[expect]\nR = { vlaue = 1 }\n")
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(
        ["line.case.toml line 4: there is no key 'vlaue' in expect.R; did you mean 'value'? (*)"]
    )
    result.stdout.no_fnmatch_line("*Traceback*")


def test_a_case_that_cannot_be_estimated_fails_and_the_next_goes_on(project):
    (project.path / "a.case.toml").write_text('[[recording]]\nfile = "bad.csv"\n[expect]\nR = { value = 1 }\n')
    (project.path / "bad.csv").write_text("time [s],voltage [V]\n0,1\n")
    result = project("-q", case=RECORDING + MET)
    result.assert_outcomes(passed=3, failed=2)
    result.stdout.fnmatch_lines(["a has no estimate: bad.csv*"])


def test_tests_can_be_selected_and_reported_as_ever(project):
    project.path.joinpath("line.case.toml").write_text(RECORDING + MET + "rmse = { i = 1e-6, w = 1e-6 }\n")
    result = project("-q", "-p", "no:cacheprovider", "-x", "--junitxml=out.xml")
    result.assert_outcomes(passed=3, failed=1)
    cases = ET.parse(project.path / "out.xml").getroot().findall(".//testcase")
    assert [case.get("name") for case in cases] == ["verdict", "R", "K", "rmse_of_i"]
    assert cases[3].find("failure").text.startswith("rmse of i not met: measured 0.0")
    project("-q", "-k", "line and verdict").assert_outcomes(passed=1, deselected=4)


def test_a_case_is_estimated_once_whatever_it_feeds(project, monkeypatch):
    done, original = [], CaseWorker.estimate

    def counted(self, case, **how):
        done.append(case.name)
        return original(self, case, **how)

    monkeypatch.setattr(CaseWorker, "estimate", counted)
    (project.path / "test_own.py").write_text(
        "from estimator.cases.case import read_case\n"
        "def test_path(estimate):\n    assert estimate('line.case.toml').parameters['R'].value > 3\n"
        "def test_case(estimate):\n"
        "    assert estimate(read_case(__file__.replace('test_own.py', 'line.case.toml'))).verdict == 'ok'\n"
    )
    project("-q", case=RECORDING + MET).assert_outcomes(passed=5)
    assert done == ["line"]


def test_the_fixture_wants_one_case(project):
    shutil.copy(EXAMPLE, project.path / "motor_2.csv")
    (project.path / "many.toml").write_text('[[recording]]\nfile = "motor*.csv"\n')
    (project.path / "test_own.py").write_text(
        "import pytest\ndef test_many(estimate):\n"
        "    with pytest.raises(ValueError, match='many.toml means 2 cases; take them one by one'):\n"
        "        estimate('many.toml')\n"
    )
    project("-q").assert_outcomes(passed=1)


CONFTEST = """
import os, pathlib
if "PYTEST_XDIST_WORKER" in os.environ:
    from estimator.batches import case_worker
    done = pathlib.Path(__file__).parent / "done"
    done.mkdir(exist_ok=True)
    original = case_worker.CaseWorker.estimate
    def counted(self, case, **kwargs):
        with open(done / f"{case.name}-{os.getpid()}", "a") as file:
            file.write("x")
        return original(self, case, **kwargs)
    case_worker.CaseWorker.estimate = counted
"""


def estimates_of(folder):
    """Return {case name: [estimates made, one number a process]}."""
    made = {}
    for file in sorted((folder / "done").iterdir()):
        made.setdefault(file.name.rsplit("-", 1)[0], []).append(len(file.read_text()))
    return made


@pytest.mark.parametrize("dist", ["load", pytest.param("loadscope", marks=pytest.mark.full)])
def test_a_case_stays_on_one_worker_of_xdist(dist, project):
    pytest.importorskip("xdist")
    for k in (1, 2):
        shutil.copy(EXAMPLE, project.path / f"motor_{k}.csv")
    (project.path / "conftest.py").write_text(CONFTEST)
    (project.path / "test_plain.py").write_text(
        "import pytest\n@pytest.mark.parametrize('k', range(8))\ndef test(k): pass\n"
    )
    case = '[[recording]]\nfile = "motor_*.csv"\n' + MET + "standard_error = { R = 1 }\n"
    result = project("-q", "-n", "2", "--dist", dist, case=case)
    result.assert_outcomes(passed=2 * 4 + 8)
    assert estimates_of(project.path) == {f"line[motor_{k}]": [1] for k in (1, 2)}


@pytest.mark.full
def test_a_crash_under_xdist_is_reported_and_the_rest_runs(project):
    pytest.importorskip("xdist")
    (project.path / "test_crash.py").write_text("import os\ndef test_crash(): os._exit(1)\n")
    result = project("-q", "-n", "2", case=RECORDING + MET, subprocess=True)
    result.assert_outcomes(passed=3, failed=1)
    result.stdout.fnmatch_lines(["*crashed while running*test_crash*"])


def test_cases_of_others_can_be_run_on_other_recordings_and_fmus(project):
    folder = project.path / "monday"
    folder.mkdir()
    (project.path / "motor.csv").rename(folder / "motor.csv")
    project("-q", case=RECORDING + MET).assert_outcomes(errors=1)
    project("-q", "--recordings", "monday").assert_outcomes(passed=3)
    result = project("-q", "--recordings", "monday", "--fmu", "no_such.fmu")
    result.assert_outcomes(failed=3)
    result.stdout.fnmatch_lines(["line has no estimate: *no_such.fmu*"])


def test_a_project_without_case_files_pays_nothing(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE.parent.parent))
    pytester.makepyfile(
        "import sys\ndef test():\n"
        "    mine = {m for m in sys.modules if m.split('.')[0] in ('estimator', 'numpy')}\n"
        "    assert mine == {'estimator', 'estimator.pytest_plugin'}\n"
    )
    arguments = [sys.executable, "-m", "pytest", *PLUGIN, "-q", "-p", "no:xdist"]
    pytester.run(*arguments).assert_outcomes(passed=1)


def test_without_case_files_xdist_deals_out_tests_as_ever():
    xdist = pytest.importorskip("xdist.scheduler")
    from estimator.pytest_xdist import CaseScheduling, SchedulerChoice

    class Config:
        option = None

        def getvalue(self, name):
            return ["popen"] if name == "tx" else None

        getoption = getvalue

    def log(*words):
        pass

    log.loadsched = log.loadscopesched = log
    for nodeid, kind in (("test_a.py::test_b", xdist.LoadScheduling), ("x.case.toml::R", CaseScheduling)):
        choice = SchedulerChoice(Config(), log, suffix=".case.toml")
        node = object()
        choice.add_node(node)
        choice.add_node_collection(node, [nodeid])
        assert choice.collection_is_completed
        with pytest.raises(Exception):  # noqa: B017 - the node is none
            choice.schedule()
        assert type(choice._chosen) is kind
