"""MAT, Parquet and MDF recordings give what the same CSV gives; truth is the arrays that were written."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from estimator.errors import RecordingError
from estimator.recordings.columns import Signal, on_one_clock
from estimator.recordings.headers import parse_header
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import read_recording
from estimator.recordings.recording import Recording

N = 60
TIME = np.arange(N) * 1e-3  # s
V = np.where(np.arange(N) < 10, 0.0, 10.5)
CURRENT = np.random.default_rng(1).normal(1.0, 0.3, N)
W = np.random.default_rng(2).normal(100.0, 3.0, N)
RPM = W * 30 / np.pi


def check(recording: Recording, *, speed: np.ndarray = W) -> None:
    """Compare a recording with the arrays."""
    found = motor_columns(recording)
    np.testing.assert_allclose(recording.time - recording.time[0], TIME, atol=1e-12)
    np.testing.assert_array_equal(recording.signals[found["v"]], V)
    np.testing.assert_array_equal(recording.signals[found["i"]], CURRENT)
    np.testing.assert_allclose(recording.signals[found["w"]], speed, rtol=1e-14)


VECTORS = {"t": TIME, "v": V, "i": CURRENT, "w": W}
MATRIX = {"data": np.column_stack([TIME, V, CURRENT, RPM]), "names": ["time", "voltage", "current", "speed"]}
LOGGED = {
    "time": TIME,
    "signals": [
        {"values": V, "label": "voltage", "blockName": "m/v"},
        {"values": np.column_stack([CURRENT, W]), "label": "current, speed", "blockName": "m/Mux"},
    ],
}
SERIES = {
    name: {"Time": TIME, "Data": data, "DataInfo": {"Units": unit}}
    for name, data, unit in (("voltage", V, "V"), ("current", CURRENT, "A"), ("speed", RPM, "rpm"))
}
SHAPES = {
    "vectors": VECTORS,
    "columns": {name: x[:, None] for name, x in VECTORS.items()},
    "a structure": {
        "run3": {"time_ms": TIME * 1e3, "voltage": V, "current_mA": CURRENT * 1e3, "speed_rpm": RPM},
        "Ts": 1e-3,
    },
    "vectors with units": {**VECTORS, "w": RPM, "units": {"w": "rpm", "t": "s"}},
    "dSPACE's recorder": {
        "rec_1": {
            "X": {"Name": "time", "Data": TIME},
            "Y": [
                {"Name": 'Model Root/"armature"/voltage/Out1', "Unit": "V", "Data": V},
                {"Name": "Model Root/current\\Out1", "Unit": "A", "Data": CURRENT},
                {"Name": "Model Root/speed/Value", "Unit": "rpm", "Data": RPM},
            ],
            "Description": {"General": {"Version": "1"}},
        }
    },
    "tout": {"tout": TIME, "voltage": V, "current": CURRENT, "speed": W},
    "a matrix": {**MATRIX, "units": ["s", "V", "A", "rpm"]},
    "a matrix lying": {**MATRIX, "data": MATRIX["data"].T, "units": ["s", "V", "A", "rpm"]},
    "structure with time": {"out": LOGGED},
    "time series as structures": SERIES,
    "two columns each": {n: np.column_stack([TIME, x]) for n, x in (("v", V), ("i", CURRENT), ("w", W))},
}


def as_v5(path: Path, content: dict) -> None:
    from scipy.io import savemat

    def cells(value):
        if isinstance(value, dict):
            return {name: cells(item) for name, item in value.items()}
        if isinstance(value, list) and isinstance(value[0], str):
            return np.array(value, dtype=object)
        return np.array([cells(v) for v in value], dtype=object) if isinstance(value, list) else value

    savemat(path, cells(content))


def as_v73(path: Path, content: dict) -> None:
    """Write HDF5 as MATLAB does: transposed, classes as attributes, cells and structure arrays as references."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        stored = file.create_group("#refs#")

        def reference(value):
            name = str(len(stored))
            put(stored, name, value)
            return stored[name].ref

        def put(group, name, value):
            if isinstance(value, dict):
                inner = group.create_group(name)
                inner.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, item in value.items():
                    put(inner, key, item)
            elif isinstance(value, list) and isinstance(value[0], dict):
                inner = group.create_group(name)
                inner.attrs["MATLAB_class"] = np.bytes_("struct")
                for key in value[0]:
                    references = np.array([[reference(v[key])] for v in value], dtype=h5py.ref_dtype)
                    inner.create_dataset(key, data=references)
            elif isinstance(value, list):
                references = np.array([[reference(text)] for text in value], dtype=h5py.ref_dtype)
                group.create_dataset(name, data=references).attrs["MATLAB_class"] = np.bytes_("cell")
            elif isinstance(value, str):
                codes = np.array([[ord(c)] for c in value], dtype=np.uint16)
                group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
            else:
                array = np.atleast_2d(np.asarray(value, dtype=float))
                array = array.T if np.ndim(value) == 1 else array
                group.create_dataset(name, data=array.T).attrs["MATLAB_class"] = np.bytes_("double")

        for name, value in content.items():
            put(file, name, value)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


@pytest.mark.parametrize("write", [as_v5, as_v73])
@pytest.mark.parametrize("shape", SHAPES)
def test_every_usual_shape_of_a_mat_file_is_read(shape: str, write: Callable, tmp_path: Path) -> None:
    write(tmp_path / "run3.mat", SHAPES[shape])
    check(read_recording(tmp_path / "run3.mat"))


@pytest.mark.parametrize("write", [as_v5, as_v73])
def test_signals_of_a_slower_clock_keep_their_own_samples(write: Callable, tmp_path: Path) -> None:
    content = {**SERIES, "speed": {"Time": TIME[::5], "Data": W[::5]}}
    write(tmp_path / "run3.mat", content)
    recording = read_recording(tmp_path / "run3.mat")
    speed = recording.signal("speed")
    np.testing.assert_array_equal(np.flatnonzero(~np.isnan(speed)), np.arange(0, N, 5))
    np.testing.assert_array_equal(speed[::5], W[::5])


MAT_COMPLAINTS = {
    "nothing": (
        {"a": np.eye(3)},
        "run3.mat: there is no time column (column 1, column 2, column 3); one column",
    ),
    "no names": ({"time": TIME[:5], "data": np.ones((7, 3))}, "run3.mat: data has columns without names; give them"),
    "a sample more": (
        {**VECTORS, "v": np.append(V, 10.5)},
        "run3.mat: v has 61 samples and the time t has 60; save vectors of one length",
    ),
    "half as many samples": (
        {**VECTORS, "w": W[::2]},
        "run3.mat: w has 30 samples and the time t has 60; save vectors of one length, or its own time beside it, as"
        " time_w",
    ),
    "a sample less, no time": ({"v": V[1:], "i": CURRENT, "w": W}, "run3.mat: there is no time column"),
    "lengths, no time": (
        {"v": V[1:], "w": W},
        "run3.mat holds no time with signals of its length (v of 59, w of 60); save the vectors",
    ),
    "time back": (
        {**VECTORS, "t": TIME[::-1].copy()},
        "run3.mat sample 2: time does not increase (0.058 s after 0.059 s); each row",
    ),
}


def test_a_speed_that_was_differenced_beside_its_angle_is_left_out(tmp_path: Path) -> None:
    as_v5(tmp_path / "run3.mat", {**VECTORS, "w": W[1:], "angle": np.cumsum(W) * 1e-3})
    assert set(motor_columns(read_recording(tmp_path / "run3.mat"), required=("v", "i"))) == {"v", "i", "angle"}


def test_a_row_of_zeros_that_fills_the_vectors_is_left_out(tmp_path: Path) -> None:
    long = {"t": np.arange(20 * N) * 1e-3, **{name: np.tile(x, 20) for name, x in VECTORS.items() if name != "t"}}
    as_v5(tmp_path / "run3.mat", {name: np.append(x, 0.0) for name, x in long.items()})
    recording = read_recording(tmp_path / "run3.mat")
    np.testing.assert_array_equal(recording.signals["w"], long["w"])
    assert recording.not_read == ("the last row is left out: its time is off the clock of all others",)


@pytest.mark.parametrize("clock", ["time_w", "w_time", "tw", "t2"])
def test_a_vector_of_another_length_is_read_with_a_time_of_its_own(clock: str, tmp_path: Path) -> None:
    as_v5(tmp_path / "run3.mat", {**VECTORS, "w": W[::5], clock: TIME[::5]})
    recording = read_recording(tmp_path / "run3.mat")
    assert set(motor_columns(recording)) == {"v", "i", "w"} and recording.not_read == ()
    np.testing.assert_array_equal(recording.signals["w"][::5], W[::5])
    assert np.isnan(recording.signals["w"]).sum() == N - N // 5


@pytest.mark.parametrize("clock", [{"t": TIME}, {}])
def test_vectors_of_another_length_that_are_left_out_are_told(clock: dict[str, np.ndarray], tmp_path: Path) -> None:
    as_v5(tmp_path / "run3.mat", {"v": V, "i": CURRENT, "w": W, "reference": V[::2], **clock})
    recording = read_recording(tmp_path / "run3.mat", ReadAs(rate=None if clock else 1000))
    assert recording.not_read == ("left out, not as long as the others (60 samples): reference (30)",)


@pytest.mark.parametrize("name", MAT_COMPLAINTS)
def test_a_mat_file_that_does_not_do_is_told_in_a_sentence(name: str, tmp_path: Path) -> None:
    content, sentence = MAT_COMPLAINTS[name]
    as_v5(tmp_path / "run3.mat", content)
    with pytest.raises(RecordingError) as caught:
        read_recording(tmp_path / "run3.mat")
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("run3.mat", b"no such thing" * 50, "run3.mat is no MAT file, or a damaged one ("),
        ("run3.mat", b"\x89HDF\r\n\x1a\n" + b"\0" * 600, "run3.mat is a damaged MAT file of version 7.3 ("),
        ("run3.parquet", b"PAR1" + b"\1" * 100, "run3.parquet is a damaged Parquet file ("),
        ("run3.mf4", b"MDF     4.10    " + b"\0" * 300, "run3.mf4 "),
    ],
)
def test_a_damaged_file_is_told_in_a_sentence(name: str, content: bytes, sentence: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        read_recording(tmp_path / name)
    assert str(caught.value).startswith(sentence) and "\n" not in str(caught.value)


def test_an_hdf5_file_whose_table_of_names_is_damaged_is_told_in_a_sentence(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "run3.mat"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(9.0)
    path.write_bytes(path.read_bytes().replace(b"SNOD", b"SNAD"))
    with pytest.raises(RecordingError, match="damaged MAT file of version 7.3 .*bad symbol table node"):
        read_recording(path)


@pytest.mark.parametrize(
    ("package", "file", "extra"),
    [("h5py", "run3.mat", "mat"), ("pyarrow", "run3.parquet", "parquet"), ("asammdf", "run3.mf4", "mdf")],
)
def test_a_missing_extra_is_told_with_how_to_install_it(
    package: str, file: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    starts = {"mat": b"\x89HDF\r\n\x1a\n", "parquet": b"PAR1", "mdf": b"MDF     4.10"}
    (tmp_path / file).write_bytes(starts[extra] + bytes(700))
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RecordingError, match=rf"{file} is an? .*needs {package}; .*fmu-estimator\[{extra}\]'"):
        read_recording(tmp_path / file)


def parquet(path: Path, columns: dict, *, fields: dict | None = None, pandas: dict | None = None) -> Recording:
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table(columns)
    if fields:
        schema = [f.with_metadata({"unit": fields[f.name]}) if f.name in fields else f for f in table.schema]
        table = table.cast(pyarrow.schema(schema))
    if pandas:
        table = table.replace_schema_metadata({b"pandas": json.dumps(pandas).encode()})
    parquet.write_table(table, path)
    return read_recording(path)


def test_parquet_is_read_by_headers_fields_and_pandas_attributes(tmp_path: Path) -> None:
    import pyarrow

    path = tmp_path / "run3.parquet"
    check(parquet(path, {"time [s]": TIME, "voltage [V]": V, "current [A]": CURRENT, "speed [rpm]": RPM}))
    plain = {"time": TIME, "voltage": V, "current": CURRENT, "speed": RPM}
    check(parquet(path, plain, fields={"speed": "rpm"}))
    check(parquet(path, plain, pandas={"attributes": {"units": {"speed": "rpm"}}}))
    micro = np.round(TIME * 1e6).astype(np.int64)
    stamped = pyarrow.array(micro + 1_700_000_000_000_000, type=pyarrow.timestamp("us"))
    check(parquet(path, {**plain, "time": stamped}, fields={"speed": "rpm"}))
    indexed = {**plain, "speed": W, "__index_level_0__": pyarrow.array(micro, type=pyarrow.duration("us"))}
    del indexed["time"]
    check(parquet(path, indexed, pandas={"index_columns": ["__index_level_0__"]}))


def test_an_infinite_sample_is_told(tmp_path: Path) -> None:
    current = CURRENT.copy()
    current[7] = -np.inf
    columns = {"time [s]": TIME, "voltage [V]": V, "current [A]": current}
    with pytest.raises(RecordingError, match="run3.parquet sample 7: current is -inf, which nothing measures; use NaN"):
        parquet(tmp_path / "run3.parquet", columns).column("current")


@pytest.mark.parametrize("time", [{}, {"time": TIME}])
def test_an_infinite_sample_of_a_mat_file_is_told_by_matlabs_own_count(
    tmp_path: Path, time: dict[str, np.ndarray]
) -> None:
    """Beside a time its signal was left out without a word."""
    from scipy.io import savemat

    speed = W.copy()
    speed[7] = np.inf
    savemat(tmp_path / "run3.mat", {**time, "voltage": V, "current": CURRENT, "speed": speed})
    recording = read_recording(tmp_path / "run3.mat", ReadAs() if time else ReadAs(rate=1000))
    assert recording.column("current") == "current"
    with pytest.raises(RecordingError, match="run3.mat sample 8: speed is inf, which nothing measures; use NaN for a"):
        recording.column("speed")


def test_parquet_nulls_are_missing_samples_and_text_harms_nobody_until_it_is_used(tmp_path: Path) -> None:
    speed = [None if k == 7 else float(w) for k, w in enumerate(W)]
    recording = parquet(
        tmp_path / "run3.parquet", {"time": TIME, "voltage": V, "current": CURRENT, "speed": speed, "note": ["x"] * N}
    )
    assert np.flatnonzero(np.isnan(recording.signal("speed"))).tolist() == [7]
    with pytest.raises(RecordingError, match="run3.parquet: column 'note' holds string, not numbers; export it"):
        recording.signal("note")


def mdf(path: Path, groups: list[dict[str, tuple[np.ndarray, np.ndarray, str]]]) -> Path:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        for group in groups:
            file.append(
                [
                    Signal(samples=values, timestamps=time, name=name, unit=unit, encoding="utf-8")
                    for name, (time, values, unit) in group.items()
                ]
            )
        return Path(file.save(path, overwrite=True))


def test_mdf_is_read_with_its_units(tmp_path: Path) -> None:
    group = {"voltage": (TIME, V, "V"), "current": (TIME, CURRENT, "A"), "speed": (TIME, RPM, "rpm")}
    recording = read_recording(mdf(tmp_path / "run3.mf4", [group]))
    check(recording)
    assert recording.headers["speed"] == "speed [rpm]"


def test_groups_of_an_mdf_file_have_their_own_clocks(tmp_path: Path) -> None:
    groups = [
        {"voltage": (TIME, V, "V"), "current": (TIME, CURRENT, "A")},
        {"speed": (TIME[::4] + 1e-6, RPM[::4], "rpm"), "current": (TIME[::4] + 1e-6, CURRENT[::4], "A")},
    ]
    recording = read_recording(mdf(tmp_path / "run3.mf4", groups))
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_allclose(recording.signal("speed")[::4], W[::4])
    assert np.isnan(recording.signal("speed")).sum() == N - len(W[::4])
    np.testing.assert_array_equal(recording.signal("current group 0"), CURRENT)
    assert {parse_header(h).name for h in recording.headers.values()} >= {"voltage", "current group 1"}


def test_an_mdf_file_without_numbers_is_told(tmp_path: Path) -> None:
    texts = np.array([b"a"] * N)
    path = mdf(tmp_path / "run3.mf4", [{"note": (TIME, texts, "")}])
    with pytest.raises(RecordingError, match="run3.mf4 holds no channel of numbers with a clock; export voltage"):
        read_recording(path)


def test_signals_of_one_sample_each_are_put_on_one_clock(tmp_path: Path) -> None:
    signals = [Signal(name, np.array([x]), np.array([x])) for name, x in (("v", 1.0), ("i", 0.5))]
    time, v, i = on_one_clock(tmp_path / "run3.mf4", signals).columns
    np.testing.assert_array_equal(time, [0.5, 1.0])
    np.testing.assert_array_equal(v, [np.nan, 1.0])
    np.testing.assert_array_equal(i, [0.5, np.nan])


def test_simulinks_tout_is_the_time_of_a_matrix_beside_it(tmp_path: Path) -> None:
    as_v5(tmp_path / "run3.mat", {"tout": TIME, "yout": np.column_stack([V, CURRENT, W])})
    roles = {"v": "yout column 1", "i": "yout column 2", "w": "yout column 3"}
    recording = read_recording(tmp_path / "run3.mat", ReadAs(columns=roles))
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(recording.signals[recording.roles["w"]], W)
