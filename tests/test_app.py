"""The app without a browser: long signals made short, the folder, the case that the page changes, runs, results."""

import json
import shutil
import time

import numpy as np
import pytest
from app_server import EXAMPLE, serving
from made_estimates import comparison, estimate

pytest.importorskip("starlette", reason="the extra app is not installed")

from estimator.app.outcomes import Outcomes  # noqa: E402
from estimator.app.place import Place  # noqa: E402
from estimator.app.series import Series, gaps, nearest, outliers, spectrum, view  # noqa: E402
from estimator.app.service import Service  # noqa: E402
from estimator.app.workspace import Outdated, Workspace  # noqa: E402
from estimator.cases.case import read_case  # noqa: E402
from estimator.commands.arguments import command_line  # noqa: E402
from estimator.errors import InputError  # noqa: E402
from estimator.estimating.progress import Progress  # noqa: E402
from estimator.estimating.progress_stream import ProgressStream, progress_mapping  # noqa: E402
from estimator.results.result import Validation  # noqa: E402
from estimator.results.signals import read_signals, signals_file  # noqa: E402

# --- long signals --------------------------------------------------------------------------------------------------


def unpacked(content):
    """Return header, times and (low, high) of every signal, as the page reads them."""
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    count, at = header["count"], 4 + length
    assert at % 8 == 0
    times = np.frombuffer(content, "<f8", count, at)
    blocks = np.frombuffer(content, "<f4", offset=at + 8 * count).reshape(-1, count)
    pairs = zip(blocks[::2], blocks[1::2], strict=True) if header["envelope"] else zip(blocks, blocks, strict=True)
    return header, times, dict(zip(header["names"], pairs, strict=True))


def made(n=100_000, seed=1):
    rng = np.random.default_rng(seed)
    return Series(np.arange(n) * 1e-3, {"a": rng.standard_normal(n), "b": np.cumsum(rng.standard_normal(n))})


@pytest.mark.parametrize("place", [0, 1, 777, 99_998, 99_999])
def test_a_view_keeps_a_spike_of_one_sample_wherever_it_is(place):
    series = made()
    signal = series.signals["a"].copy()
    signal[place] = -99.0
    _, _, found = unpacked(view(Series(series.time, {"a": signal}), start=-1, end=1000, buckets=300))
    assert found["a"][0].min() == -99.0 and found["a"][1].max() == np.float32(signal.max())


def test_every_bucket_holds_the_least_and_the_greatest_of_its_samples():
    series = made()
    header, times, found = unpacked(view(series, start=20.0, end=80.0, buckets=500))
    assert header["envelope"] and header["samples"] == 100_000 and len(times) == 500
    edges = np.searchsorted(series.time, [*times, header["to"] + 1e-9])
    for k in range(500):
        part = series.signals["b"][edges[k] : edges[k + 1]]
        assert found["b"][0][k] == np.float32(part.min()) and found["b"][1][k] == np.float32(part.max())


def test_a_short_stretch_is_given_sample_by_sample_with_one_beyond_each_end():
    series = made()
    header, times, found = unpacked(view(series, start=10.0, end=10.005, buckets=500))
    assert not header["envelope"] and times[0] < 10.0 and times[-1] > 10.005 and len(times) == 8
    k = np.searchsorted(series.time, times)
    assert np.array_equal(found["a"][0], series.signals["a"][k].astype(np.float32))


@pytest.mark.parametrize(("start", "end"), [(-9, -5), (500, 600), (5, 5), (9, 3)])
def test_a_view_beyond_the_record_is_no_error(start, end):
    header, times, _ = unpacked(view(made(), start=start, end=end, buckets=0))
    assert 1 <= header["count"] == len(times) <= 6


def test_missing_samples_are_a_gap_in_the_view_and_do_not_hide_their_neighbours():
    series = made(10_000)
    signal = series.signals["a"].copy()
    signal[2_000:6_000] = np.nan
    signal[7_000] = np.nan
    gappy = Series(series.time, {"a": signal})
    _, times, found = unpacked(view(gappy, start=0, end=10, buckets=100))
    assert np.isnan(found["a"][0][(times >= 2.0) & (times < 5.9)]).all() and np.isnan(found["a"][0]).sum() == 40
    assert gaps(gappy, "a") == [(2.0, pytest.approx(5.999)), (7.0, 7.0)]
    assert nearest(gappy, 7.0004) == (7.0, {"a": None})


def test_a_view_of_a_million_samples_takes_some_milliseconds():
    series = made(1_000_000)
    took = []
    for k in range(9):
        began = time.perf_counter()
        view(series, start=100.0 * k, end=1000.0, buckets=1500)
        took.append(time.perf_counter() - began)
    assert sorted(took)[4] < 0.1  # s; 6 ms on a machine that is not busy


@pytest.mark.parametrize("signal", ["step", "ramp", "noise", "counts", "sine", "constant"])
def test_a_usual_signal_has_no_outlier_and_one_that_stands_alone_is_found(signal):
    n = 20_000
    rng, k = np.random.default_rng(3), np.arange(n)
    values = {
        "step": np.where(k > 700, 10.0, 0.0) + 0.01 * rng.standard_normal(n),
        "ramp": k * 1e-3,
        "noise": rng.standard_normal(n),
        "counts": np.round(np.sin(k / 50) * 20 + rng.standard_normal(n)),
        "sine": np.sin(k / 7.0),
        "constant": np.full(n, 3.0),
    }[signal]
    assert outliers(Series(k * 1e-3, {"x": values}), "x") == []
    values[4_321] += 60.0
    assert outliers(Series(k * 1e-3, {"x": values}), "x") == [4.321]


def test_the_spectrum_of_a_residual_has_its_ripple_at_its_frequency_and_amplitude():
    time_, rng = np.arange(20_000) * 1e-3, np.random.default_rng(2)
    residual = 0.5 * np.sin(2 * np.pi * 37.0 * time_) + 0.01 * rng.standard_normal(20_000)
    frequency, amplitude = spectrum(time_, residual)
    k = int(np.argmax(amplitude))
    assert abs(frequency[k] - 37.0) < 0.6 and amplitude[k] == pytest.approx(0.5, rel=0.02) and len(frequency) <= 1001


# --- signals.npz, progress -----------------------------------------------------------------------------------------


def test_signals_read_back_as_they_were_written_and_the_same_bytes_every_time(tmp_path):
    held = comparison(np.full(300, 6.0), name="another <run>")
    one = estimate(validation=Validation((held,), {"i": 0.02}, {"i": 95.0}))
    content = signals_file(one)
    assert content == signals_file(one)
    (tmp_path / "signals.npz").write_bytes(content)
    found = read_signals(tmp_path / "signals.npz")
    assert found.held_out == 1 and [c.name for c in found.comparisons][-1] == "another <run>"
    for c, d in zip((*one.comparisons, held), found.comparisons, strict=True):
        for kind in ("inputs", "measured", "simulated"):
            assert getattr(c, kind).keys() == getattr(d, kind).keys()
            for name, signal in getattr(c, kind).items():
                assert np.array_equal(signal, getattr(d, kind)[name], equal_nan=True)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"x" * 100])
def test_signals_that_are_none_are_told_in_a_sentence(tmp_path, content):
    (tmp_path / "signals.npz").write_bytes(content)
    with pytest.raises(InputError, match="no file of signals"):
        read_signals(tmp_path / "signals.npz")


def test_signals_never_unpickle(tmp_path):
    np.savez(tmp_path / "signals.npz", about=np.array([print], dtype=object))
    with pytest.raises(InputError, match="no file of signals"):
        read_signals(tmp_path / "signals.npz")


def test_progress_is_a_line_of_json_an_event_and_not_too_many(tmp_path):
    now = [0.0]
    with ProgressStream(tmp_path / "p", clock=lambda: now[0]) as stream:
        for k in range(100):
            now[0] = 0.01 * k
            stream(Progress("search" if k < 50 else "polish", k + 1, 200, float("inf") if k == 0 else 2.0, {"R": 3.0}))
    lines = [json.loads(line) for line in (tmp_path / "p").read_text().splitlines()]
    assert 8 <= len(lines) <= 13 and lines[0]["best_cost"] is None and lines[-1]["parameters"] == {"R": 3.0}
    assert [line["phase"] for line in lines] == sorted((line["phase"] for line in lines), reverse=True)
    assert lines[-1]["seconds_left"] > 0 and progress_mapping(Progress("x", 0), seconds=1)["seconds_left"] is None


def test_an_estimation_goes_on_when_nobody_reads_its_progress_any_more(tmp_path):
    import os

    reading, writing = os.pipe()
    with ProgressStream(f"/dev/fd/{writing}") as stream:
        os.close(writing)
        os.close(reading)
        stream(Progress("search", 1))
        stream(Progress("polish", 2))


def test_progress_and_signals_that_cannot_be_written_are_told(tmp_path, capsys):
    from estimator.cli import main

    assert main(["estimate", str(EXAMPLE), "--progress-json", str(tmp_path / "no" / "p")]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert main(["estimate", str(EXAMPLE), "--signals"]) == 2
    assert "--signals needs a folder" in capsys.readouterr().err


# --- the folder and the case ---------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    shutil.copy(EXAMPLE, tmp_path / "step.csv")
    shutil.copy(EXAMPLE, tmp_path / "again.csv")
    return tmp_path


@pytest.fixture
def workspace(folder):
    workspace = Workspace(Place(folder))
    workspace.change(0, {"recordings": [{"file": "step.csv", "role": "fit"}]})
    return workspace


@pytest.mark.smoke
def test_a_folder_lists_what_can_be_used_and_no_results_of_others(folder):
    (folder / "run-2").mkdir()
    (folder / "run-10").mkdir()
    for name in ("run-2", "run-10"):
        (folder / name / "result.json").write_text("{}")
        (folder / name / "parameters.csv").write_text("a,b")
    (folder / ".git").mkdir()
    (folder / ".git" / "x.csv").write_text("")
    (folder / "motor.fmu").write_text("")
    (folder / "a.case.toml").write_text("")
    (folder / "no text \udcff.csv").write_text("")  # bytes that are no UTF-8: no page could name it
    assert Place(folder).listed() == {
        "recordings": ["again.csv", "step.csv"],
        "fmus": ["motor.fmu"],
        "cases": ["a.case.toml"],
        "results": ["run-2", "run-10"],
    }


@pytest.mark.smoke
def test_every_change_is_a_case_file_that_reads_back(workspace, folder):
    rows = [
        {"file": "step.csv", "role": "fit", "window": [0.1, 2.0], "scale": {"i": -1}, "offset": {"i": 0.01}},
        {"file": "again.csv", "role": "validate"},
    ]
    workspace.change(1, {"recordings": rows, "search": {"method": "paper", "seed": 7, "loss": "linear"}})
    case = read_case(folder / "app.case.toml")
    assert case == workspace.case and case.run(0).window == (0.1, 2.0) and dict(case.run(0).scale) == {"i": -1.0}
    assert case.run(1).validate and case.search.seed == 7
    rows[1]["role"] = "off"
    workspace.change(2, {"recordings": rows})
    assert [r["role"] for r in workspace.state()["recordings"]] == ["fit", "off"]
    assert len(read_case(folder / "app.case.toml").recordings) == 1


def test_what_the_page_does_not_show_of_a_case_stays(folder):
    (folder / "own.case.toml").write_text(
        '[outputs]\ni = "current [A]"\nw = { column = "speed [rad/s]", sensor = "mean" }\n'
        '[inputs]\nv = "voltage [V]"\n[parameters]\nK = { min = 0.001, max = 1, nominal = 0.05 }\n'
        '[[recording]]\nfile = "step.csv"\n[expect]\nK = { within = "5 %" }\n'
    )
    workspace = Workspace(Place(folder))
    workspace.open("own.case.toml")
    own = workspace.case
    workspace.change(1, {"mapping": workspace.state()["mapping"], "parameters": workspace.state()["parameters"]})
    assert workspace.case.outputs["w"].sensor == "mean" and workspace.case.expect == own.expect
    assert workspace.case.parameters["K"].nominal == 0.05 and workspace.case.parameters["K"].maximum == 1
    assert (folder / "own.case.toml").read_text().startswith("[outputs]\n")


def test_the_table_of_the_parameters_makes_the_case_that_it_shows(workspace):
    rows = workspace.state()["parameters"]
    assert [r["name"] for r in rows] == ["R", "K", "L", "J", "B"] and not workspace.state()["explicit"]
    rows[0] |= {"min": 0.5, "start": 3.0}
    rows[2] |= {"free": False, "value": 0.013}
    workspace.change(1, {"parameters": rows})
    state = workspace.state()
    assert state["explicit"] and state["problem"] is None and dict(workspace.case.fixed) == {"L": 0.013}
    shown = {r["name"]: r for r in state["parameters"]}
    assert shown["R"]["lower"] == 0.5 and shown["R"]["begin"] == 3.0 and not shown["L"]["free"]
    assert shown["L"]["value"] == 0.013 and [p.name for p in workspace.plan().parameters] == ["R", "K", "J", "B"]
    workspace.change(2, {"parameters": None})
    assert not workspace.state()["explicit"] and not workspace.case.fixed


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"recordings": [{"file": "none.csv", "role": "fit"}]}, "there is no recording 'none.csv'"),
        ({"recordings": [{"file": "step.csv", "role": "best"}]}, "cannot be 'best'"),
        ({"recordings": [{"file": "step.csv", "role": "fit"}] * 2}, "in the list twice"),
        ({"recordings": [{"file": "step.csv", "role": "fit", "window": [2, 1]}]}, "window"),
        ({"recordings": [{"file": "step.csv", "role": "fit", "window": "x"}]}, "two times in s"),
        ({"recordings": [{"file": "step.csv", "role": "fit", "scale": {"i": True}}]}, "scale must be"),
        ({"recordings": "step.csv"}, "recordings must be a list"),
        (
            {"recordings": [{"file": "step.csv", "role": "fit", "reading": 3}]},
            "reading of 'step.csv' must be an object",
        ),
        ({"recordings": [{"file": "step.csv", "role": "fit", "reading": {"test": 3}}]}, "test must be a text, not 3"),
        ({"recordings": [{"file": "step.csv", "role": "fit", "reading": {"counts": -1}}]}, "counts must be above 0"),
        ({"recordings": [{"file": "step.csv", "role": "fit", "reading": {"rate": 0}}]}, "rate must be above 0"),
        (
            {"recordings": [{"file": "step.csv", "role": "fit", "reading": {"units": {"w": "furlong"}}}]},
            "'furlong', given for 'w', is not a known unit",
        ),
        ({"recordings": [{"file": "step.csv", "role": "fit", "reading": {"columns": 3}}]}, "an object of texts"),
        ({"mapping": {"inputs": {"v": 3}, "outputs": {}}}, "inputs must be an object"),
        ({"parameters": [{"name": "R", "free": True, "min": 5, "max": 1}]}, "min must be the smaller"),
        ({"parameters": [{"name": "R", "free": True, "min": "5"}]}, "min must be a number"),
        ({"parameters": [{"name": "Rs", "free": False}]}, "Rs is fixed, but at no value"),
        ({"search": {"method": "guess", "seed": 1, "loss": "linear"}}, "search.method"),
        ({"search": {"method": "cuckoo", "seed": -1, "loss": "linear"}}, "the seed must be"),
        ({"search": 3}, "search must be an object"),
        ({"fmu": "none.fmu"}, "none.fmu"),
        ({"fmu": "dc_motor", "kind": "x"}, "kind cannot be 'x'"),
        (3, "a change must be an object"),
        ({"record": []}, "a case has no part 'record'; did you mean 'recordings'"),
    ],
)
def test_a_change_that_cannot_be_is_told_and_leaves_the_case_as_it_was(workspace, folder, changes, sentence):
    before, text = workspace.case, (folder / "app.case.toml").read_text()
    with pytest.raises(InputError) as told:
        workspace.change(1, changes)
    assert sentence in str(told.value)
    assert workspace.case == before and workspace.revision == 1 and (folder / "app.case.toml").read_text() == text


def example():
    """Return the example's time, voltage, current and speed."""
    rows = [line for line in EXAMPLE.read_text().splitlines() if line[:1].isdigit()]
    return np.array([[float(cell) for cell in row.split(",")] for row in rows]).T


def log_of(path, header, *columns):
    """Write columns as a log."""
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in zip(*columns, strict=True))]) + "\n")


def test_a_file_of_several_tests_is_fitted_together_or_one_of_them_alone(folder):
    t, v, i, w = example()
    test = np.repeat([1, 2], len(t))
    log_of(folder / "log.csv", "test,t [s],v [V],i [A],w [rad/s]", test, *(np.tile(x, 2) for x in (t, v, i, w)))
    service = Service(folder)
    workspace = service.workspace
    workspace.change(0, {"recordings": [{"file": "log.csv", "role": "fit"}]})
    facts = service.recording_facts("log.csv", 1)
    assert facts["tests"] == ["1", "2"] and facts["parts"] == 2 and facts["title"] == "log.csv 2"
    assert workspace.state()["problem"] is None and workspace.state()["observed"] == ["log.csv 1", "log.csv 2"]
    row = workspace.state()["recordings"][0]
    workspace.change(1, {"recordings": [{**row, "reading": {**row["reading"], "test": "2"}}]})
    facts = service.recording_facts("log.csv", 0)
    assert facts["tests"] == ["1", "2"] and facts["parts"] == 1 and facts["title"] == "log.csv 2"
    assert workspace.state()["observed"] == ["log.csv 2"]
    assert read_case(folder / "app.case.toml").run(0).read_as.test == "2"
    assert service.checked("log.csv")["command"] == "fmu-estimator check log.csv --test=2"
    with pytest.raises(InputError, match="log.csv holds no test number 1"):
        service.recording_facts("log.csv", 1)


def test_a_duty_cycle_and_counts_become_volts_and_an_angle_as_on_the_command_line(folder):
    t, v, i, w = example()
    counts = np.round(np.cumsum(w) * (t[1] - t[0]) / (2 * np.pi) * 4096).astype(int)
    log_of(
        folder / "log.csv",
        "t [s],duty [%],battery [V],current [A],encoder [counts]",
        t,
        v / 0.12,
        12 + 0 * t,
        i,
        counts,
    )
    service = Service(folder)
    workspace = service.workspace
    workspace.change(0, {"recordings": [{"file": "log.csv", "role": "fit"}]})
    assert workspace.state()["problem"]
    row = workspace.state()["recordings"][0]
    workspace.change(1, {"recordings": [{**row, "reading": {"supply": "battery", "counts": 4096}}]})
    state = workspace.state()
    assert state["problem"] is None and state["mapping"]["outputs"].keys() == {"i", "angle"}
    observed = workspace.plan().observed[0]
    np.testing.assert_allclose(observed.inputs["v"], v, atol=1e-6)
    np.testing.assert_allclose(observed.outputs["angle"][1:], 2 * np.pi * counts[1:] / 4096, atol=1e-6)
    case = read_case(folder / "app.case.toml")
    assert (case.run(0).read_as.supply, case.run(0).read_as.counts) == ("battery", 4096)


def test_the_json_of_sysid_is_a_recording_of_the_folder_and_other_json_is_none(folder):
    t, v, _, w = example()
    rows = np.column_stack([t, v, np.cumsum(w) * 1e-3 / (2 * np.pi), w / (2 * np.pi)]).tolist()
    (folder / "sysid.json").write_text(json.dumps({"sysid": True, "test": "Simple", "fast-forward": rows}))
    (folder / "settings.json").write_text("{}")
    service = Service(folder)
    assert service.place.listed()["recordings"] == ["again.csv", "step.csv", "sysid.json"]
    assert service.place.receive("more.json", b"{}") == "more.json"
    service.workspace.change(0, {"recordings": [{"file": "sysid.json", "role": "fit"}]})
    assert service.workspace.state()["observed"] == ["sysid.json fast-forward"]


def test_how_a_file_is_read_and_begins_stays_when_the_page_changes_its_role(folder):
    (folder / "own.case.toml").write_text(
        '[[recording]]\nfile = "step.csv"\nbegin = "rest"\nunits = { w = "rpm" }\n[[recording]]\nfile = "again.csv"\n'
    )
    workspace = Workspace(Place(folder))
    workspace.open("own.case.toml")
    rows = workspace.state()["recordings"]
    for revision, role in enumerate(("off", "fit"), start=1):
        workspace.change(revision, {"recordings": [{**rows[0], "role": role}, rows[1]]})
    run = workspace.case.run(0)
    assert run.begin == "rest" and dict(run.read_as.units) == {"w": "rpm"}


def test_a_change_from_an_older_state_is_refused(workspace):
    with pytest.raises(Outdated):
        workspace.change(0, {"recordings": []})


def test_a_restart_goes_on_with_the_case_under_way(workspace, folder):
    workspace.change(1, {"search": {"method": "paper", "seed": 3, "loss": "linear"}})
    assert Workspace(Place(folder)).case.search.seed == 3
    (folder / "app.case.toml").write_text("[broken")
    assert Workspace(Place(folder)).case.recordings == ()


def test_a_case_is_saved_under_a_new_name_only(workspace, folder):
    assert workspace.save("motor") == "motor.case.toml" and read_case(folder / "motor.case.toml").recordings
    with pytest.raises(InputError, match="there already"):
        workspace.save("motor.case.toml")
    workspace.change(1, {"recordings": []})
    assert not (folder / "app.case.toml").exists()
    with pytest.raises(InputError, match="no recording is chosen"):
        workspace.save("other")


def test_a_foreign_model_gets_the_mapping_that_init_guesses(workspace):
    workspace.change(1, {"fmu": "dc_motor_geared"})
    workspace.change(2, {"fmu": "pmsm_dq"})
    assert workspace.case.fmu == "pmsm_dq" and workspace.case.outputs["w"].column == "speed"
    workspace.change(3, {"fmu": "dc_motor"})
    assert workspace.state()["problem"] is None


def test_what_is_implausible_in_a_recording_is_told_by_the_command_check(folder):
    if "check" not in command_line().get_default("flags"):
        pytest.skip("this version has no command check")
    lines = EXAMPLE.read_text().splitlines()
    rows = [line.split(",") for line in lines if line[:1].isdigit()]
    turned = [[row[0], row[1], repr(-float(row[2])), row[3]] for row in rows]
    header = "time [s],voltage [V],current [A],speed [rad/s]"
    (folder / "turned.csv").write_text("\n".join([header, *(",".join(row) for row in turned)]) + "\n")
    with serving(folder, anew=True) as server:
        told = server.get("check", name="turned.csv")
    assert told["command"] == "fmu-estimator check turned.csv"
    (found,) = told["check"]["recordings"]
    assert any("current" in finding["sentence"] for finding in found["implausible"])


# --- runs and results ----------------------------------------------------------------------------------------------


def ended(server, name):
    end = time.monotonic() + 120
    while (run := server.get(f"runs/{name}"))["state"] == "running" and time.monotonic() < end:
        time.sleep(0.2)
    return run


def test_a_run_is_the_command_that_it_shows(folder, monkeypatch):
    from estimator.cli import main

    with serving(folder, anew=True) as server:
        rows = [{"file": "step.csv", "role": "fit"}, {"file": "again.csv", "role": "validate"}]
        server.post("change", {"revision": 0, "changes": {"recordings": rows}})
        assert server.post("runs")["state"] == "running"
        assert "still running" in server.post("runs")["error"]
        run = ended(server, "run-1")
        assert (run["state"], run["verdict"]) == ("done", "ok") and run["history"][-1]["parameters"]["R"] > 3
        found = server.get("result", name="run-1")
        assert [s["held_out"] for s in found["signals"]] == [False, True] and found["signals"][0]["rmse"]["i"] < 0.03
        assert server.get("state")["results"][0]["verdict"] == "ok"
        assert "no run 'x'" in server.get("runs/x")["error"]
        assert "there is no format 'x'" in server.get("export", name="run-1", format="x")["error"]
        assert "is no file of a result" in server.get("file", name="run-1", file="../step.csv")["error"]
    monkeypatch.chdir(folder)
    command = run["command"].replace("-o run-1", "-o again").split()
    assert main([*command[1:], "--quiet"]) == 0
    one, other = (json.loads((folder / name / "result.json").read_text()) for name in ("run-1", "again"))
    assert one["parameters"] == other["parameters"]


def test_what_differs_between_runs_is_told_by_the_command_compare(folder, capsys):
    from estimator.cli import main

    if "compare" not in command_line().get_default("flags"):
        pytest.skip("this version has no command compare")
    for name, more in (("monday", []), ("tuesday", ["--scale", "i=1.05"])):
        assert main(["estimate", str(EXAMPLE), "--window", "0.4:1.4", "-o", str(folder / name), "--quiet", *more]) == 0
    with serving(folder) as server:
        told = server.get("compare", names=json.dumps(["monday", "tuesday"]))
    assert told["command"] == "fmu-estimator compare monday tuesday" and "R" in told["text"]
    assert "DIFFERENT" in told["text"]


def test_a_run_that_cannot_begin_leaves_no_case_file(folder):
    with serving(folder) as server:
        assert "no recording is chosen" in server.post("runs")["error"]
        rows = [{"file": "step.csv", "role": "fit", "scale": {"nothing": 2}}]
        told = server.post("change", {"revision": 0, "changes": {"recordings": rows}})
        assert "nothing" in told["problem"]
        assert "nothing" in server.post("runs")["error"]
    assert not list(folder.glob("run-*"))


@pytest.mark.parametrize("content", ["{", "[]", '{"verdict": "great"}', "\xff"])
def test_a_result_that_is_none_is_told_and_listed_without_a_verdict(folder, content):
    (folder / "odd").mkdir()
    (folder / "odd" / "result.json").write_text(content)
    outcomes = Outcomes(Place(folder))
    with pytest.raises(InputError, match=r"odd/result\.json"):
        outcomes.outcome("odd")
    assert outcomes.summary("odd")["verdict"] is None
    with pytest.raises(InputError, match=r"holds no result\.json"):
        outcomes.outcome("none")


def test_the_app_without_its_extra_says_what_to_install(capsys, monkeypatch):
    import sys

    from estimator.cli import main

    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "estimator.app.server", raising=False)
    assert main(["app"]) == 2
    assert "pip install 'fmu-estimator[app]'" in capsys.readouterr().err


def test_columns_of_each_recording_are_put_on_signals_by_their_own_names(folder):
    t = np.arange(100) * 1e-3
    for name, header in (("one.csv", "time,voltage,speed"), ("two.csv", "Zeit;Spannung in V;Drehzahl in rpm;Nr")):
        rows = np.column_stack([t, t > 0.05, t, *([t] if "Nr" in header else [])])
        mark = ";" if ";" in header else ","
        (folder / name).write_text("\n".join([header, *(mark.join(f"{x:g}" for x in row) for row in rows)]))
    service = Service(folder)
    owns = [
        {c["name"]: c["own"] for c in service.recording_facts(name, 0)["columns"]} for name in ("one.csv", "two.csv")
    ]
    service.close()
    assert owns[0] == {"voltage": "inputs v", "speed": "outputs w"}
    assert owns[1] == {"Spannung": "inputs v", "Drehzahl": "outputs w", "Nr": ""}
