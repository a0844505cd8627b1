"""Objects in MAT files: time series, Simulink's Dataset in memory and on disk, timetables, iddata."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest

from estimator.errors import RecordingError
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.reading import read_recording

N, STEP = 200, 0.005
T = np.arange(N) * STEP
VOLTAGE, SPEED = np.where(T < 0.1, 0.0, 6.0), 120 * (1 - np.exp(-np.maximum(T - 0.1, 0) / 0.05))
NOTHING = np.zeros((0, 0))


def saved(path, content, version):
    with warnings.catch_warnings():  # mat-io sets an option of pandas that is deprecated
        warnings.simplefilter("ignore")
        from matio import save_to_mat

        save_to_mat(str(path), content, version=version)
    return path


def made(classname, **properties):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from matio.utils.matclass import MatlabOpaque

    return MatlabOpaque(properties, classname)


def time_series(name, data, unit="", *, times=None, clock="seconds"):
    info = {"Units": np.array([clock]), "Time_": NOTHING}
    if times is None:
        info |= {"Increment_": np.array([[STEP]]), "Start_": np.array([[0.0]])}
    return made(
        "timeseries",
        Name=np.array([name]),
        DataInfo=made("tsdata.datametadata", Units=np.array([unit])),
        TimeInfo=made("tsdata.timemetadata", **info),
        Data_=data,
        Time_=NOTHING if times is None else times,
    )


def cells(*items):
    cell = np.empty((1, len(items)), dtype=object)
    for k, item in enumerate(items):
        cell[0, k] = item
    return cell


def structure(**fields):
    record = np.empty((1, 1), dtype=[(name, object) for name in fields])
    for name, value in fields.items():
        record[0, 0][name] = value
    return record


def dataset(*elements):
    storage = made("Simulink.SimulationData.Storage.RamDatasetStorage", any=structure(Elements=cells(*elements)))
    return made("Simulink.SimulationData.Dataset", any=structure(Name=np.array(["logsout"]), Storage=storage))


def signal(values, name="", block="bench/Serial Receive"):
    place = made("Simulink.SimulationData.BlockPath", path=cells(np.array([block])))
    return made("Simulink.SimulationData.Signal", Name=np.array([name]), BlockPath=place, Values=values)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_time_series_are_read_by_their_names_and_units(version, tmp_path):
    content = {
        "u": time_series("voltage", VOLTAGE[:, None], "V"),
        "w": time_series("speed", SPEED.reshape(1, 1, N), "rad/s"),  # Simulink's way: time in the last dimension
        "i": time_series("", 2.0 * VOLTAGE, "mA", times=1e3 * T, clock="milliseconds"),  # called as its variable
    }
    recording = read_recording(saved(tmp_path / "run3.mat", content, version))
    assert motor_columns(recording) == {"v": "voltage", "i": "i", "w": "speed"}
    assert recording.time == pytest.approx(T)
    assert recording.signals["voltage"] == pytest.approx(VOLTAGE)
    assert recording.signals["speed"] == pytest.approx(SPEED)
    assert recording.signals["i"] == pytest.approx(2e-3 * VOLTAGE)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_a_dataset_of_simulink_is_read_by_the_names_of_signals_or_blocks(version, tmp_path):
    logged = dataset(
        signal(time_series("", VOLTAGE), "voltage"),
        signal(time_series("", SPEED), block="bench/shaft/speed of//by shaft"),
    )
    recording = read_recording(saved(tmp_path / "run3.mat", {"data": logged}, version))
    assert recording.signals["voltage"] == pytest.approx(VOLTAGE)
    assert recording.signals["speed of/by shaft"] == pytest.approx(SPEED)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_arrays_of_a_simulation_output_are_read_over_its_times(version, tmp_path):
    data = structure(
        tout=T[:, None], voltage=VOLTAGE[:, None], y=np.column_stack([SPEED, VOLTAGE]), count=np.ones((1, 3))
    )
    output = made("Simulink.SimulationOutput", Data=data)
    recording = read_recording(saved(tmp_path / "run3.mat", {"out": output}, version))
    assert set(recording.signals) == {"voltage", "y 1", "y 2"}
    assert recording.time == pytest.approx(T)
    assert recording.signals["voltage"] == pytest.approx(VOLTAGE)
    assert recording.signals["y 1"] == pytest.approx(SPEED)


def test_a_signal_that_is_called_by_its_unit_is_the_speed(tmp_path):
    logged = dataset(signal(time_series("voltage", VOLTAGE)), signal(time_series("", SPEED), block="bench/rad//s"))
    recording = read_recording(saved(tmp_path / "run3.mat", {"data": logged}, "v7"))
    assert motor_columns(recording, required=("v", "w")) == {"v": "voltage", "w": "speed"}


def streamed(name, number, kind, unit=""):
    values = structure(
        ElementType=np.array(["timeseries"]),
        TimeUnits=structure(Class=np.array(["char"]), Value=np.array(["seconds"])),
        DataUnits=structure(Class=np.array(["char"]), Value=np.array([unit])),
        DataR2=np.array([[float(number)]]),
        CompressedTime=np.array([[0.0, STEP, float(N)]]),
        SignalAttributes=structure(ClassName=np.array([kind])),
    )
    return structure(ElementType=np.array(["signal"]), Name=np.array([name]), Values=values)


def test_a_dataset_whose_samples_lie_in_signal_streams_is_read(tmp_path):
    import h5py

    elements = (streamed("speed", 0, "single", "rpm"), streamed("voltage", 1, "int16"), streamed("other", 2, "none"))
    path = saved(tmp_path / "run3.mat", {"data": dataset(*elements)}, "v7.3")
    samples = (SPEED.astype("<f4"), VOLTAGE.astype("<i2"), np.zeros(3))
    with h5py.File(path, "a") as file:
        for k, values in enumerate(samples):
            file[f"#sigstream#/{k}/#data#"] = np.frombuffer(values.tobytes(), dtype=np.uint8)
        file["#sigstream#/#nRecords#"] = np.array([3])
    recording = read_recording(path)
    assert set(recording.signals) == {"speed", "voltage"}
    assert recording.signals["voltage"] == pytest.approx(VOLTAGE)
    assert recording.signals["speed"] == pytest.approx(SPEED * 2 * np.pi / 60, rel=1e-6)
    assert recording.time == pytest.approx(T)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_a_timetable_is_read_over_its_row_times(version, tmp_path):
    import pandas as pd

    table = pd.DataFrame({"voltage": VOLTAGE, "speed": SPEED}, index=pd.to_timedelta(T, unit="s"))
    recording = read_recording(saved(tmp_path / "run3.mat", {"log": table}, version))
    assert recording.time == pytest.approx(T, abs=1e-9)
    assert recording.signals["speed"] == pytest.approx(SPEED)


def test_an_experiment_of_iddata_is_read_with_its_names_and_units():
    from estimator.recordings.matlab_objects import _Context, _signals

    experiment = structure(
        OutputData=cells(SPEED[:, None]),
        OutputName=cells(np.array(["Angular Velocity"])),
        OutputUnit=cells(np.array(["rad/s"])),
        InputData=cells(VOLTAGE[:, None]),
        InputName=cells(np.array(["Input Voltage"])),
        InputUnit=cells(np.array(["V"])),
        Ts=cells(np.array([[STEP]])),
        Tstart=cells(np.array([[0.0]])),
        TimeUnit=np.array(["seconds"]),
    )
    found = {s.header: s for s in _signals(experiment, _Context({}, "data"))}
    assert set(found) == {"Input Voltage [V]", "Angular Velocity [rad/s]"}
    assert found["Angular Velocity [rad/s]"].values == pytest.approx(SPEED)
    assert found["Input Voltage [V]"].time == pytest.approx(T)


def test_without_mat_io_an_object_is_told_with_how_to_install_it(tmp_path, monkeypatch):
    path = saved(tmp_path / "run3.mat", {"u": time_series("voltage", VOLTAGE)}, "v7.3")
    monkeypatch.setitem(sys.modules, "matio", None)
    with pytest.raises(RecordingError, match=r"run3.mat holds an object \(timeseries\), which needs mat-io; "):
        read_recording(path)


def test_an_object_without_a_signal_is_told(tmp_path):
    path = saved(tmp_path / "run3.mat", {"G": made("idtf", Name=np.array(["plant"]))}, "v7.3")
    with pytest.raises(RecordingError, match=r"run3.mat holds an object \(idtf\), and in it no signal with a clock"):
        read_recording(path)


def test_an_object_that_mat_io_cannot_read_is_told(tmp_path):
    import h5py

    with h5py.File(tmp_path / "run3.mat", "w", userblock_size=512) as file:
        item = file.create_dataset("ts", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32))
        item.attrs["MATLAB_class"] = np.bytes_("timeseries")
        item.attrs["MATLAB_object_decode"] = np.int32(3)
    with pytest.raises(RecordingError, match=r"the objects of run3.mat cannot be read \(.*\); save vectors instead"):
        read_recording(tmp_path / "run3.mat")


def test_a_response_in_objects_is_read_beside_a_stimulus_in_vectors(tmp_path):
    content = {"t": T[:, None], "u": VOLTAGE[:, None], "w": time_series("speed", SPEED, "rad/s")}
    recording = read_recording(saved(tmp_path / "run3.mat", content, "v7.3"))
    assert motor_columns(recording, required=("v", "w")) == {"v": "u", "w": "speed"}
    assert recording.signals["speed"] == pytest.approx(SPEED)


def test_vectors_beside_an_object_that_is_no_signal_are_read(tmp_path):
    content = {"t": T[:, None], "u": VOLTAGE[:, None], "G": made("idtf", Name=np.array(["plant"]))}
    assert set(read_recording(saved(tmp_path / "run3.mat", content, "v7.3")).signals) == {"u"}


@pytest.mark.parametrize("key", ["signal", "values", "Data"])
def test_structures_of_a_time_and_a_signal_are_read_by_their_names(key, tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "run3.mat", {"run": {"voltage": {"time": T, key: VOLTAGE}, "speed": {"time": T, key: SPEED}}})
    recording = read_recording(tmp_path / "run3.mat")
    assert recording.signals["voltage"] == pytest.approx(VOLTAGE)
    assert recording.signals["speed"] == pytest.approx(SPEED)


def test_vectors_without_a_time_are_read_at_a_rate(tmp_path):
    from scipy.io import savemat

    from estimator.recordings.read_as import ReadAs

    savemat(tmp_path / "run3.mat", {"u": VOLTAGE, "y": SPEED})
    with pytest.raises(RecordingError, match="run3.mat: there is no time column .* or --rate HZ that there is none"):
        read_recording(tmp_path / "run3.mat")
    recording = read_recording(tmp_path / "run3.mat", read_as=ReadAs(columns={"w": "y"}, rate=200.0))
    assert recording.time == pytest.approx(T)
    assert recording.signals["y"] == pytest.approx(SPEED)


def test_a_matrix_without_names_is_read_by_the_numbers_of_its_columns(tmp_path):
    from scipy.io import savemat

    from estimator.recordings.read_as import ReadAs

    savemat(tmp_path / "run3.mat", {"data": np.column_stack([T, VOLTAGE, SPEED])})
    said = ReadAs(columns={"time": "1", "v": "2", "w": "3"})
    recording = read_recording(tmp_path / "run3.mat", read_as=said)
    assert recording.signals["column 3"] == pytest.approx(SPEED)
