"""Case files: what the contract says, every complaint with its line, and a round trip (strict_toml.py included)."""

import copy
import operator
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimator.cases.case import (
    METHODS,
    Case,
    Chebyshev1,
    Expectation,
    OutputSpec,
    ParameterSpec,
    SearchSpec,
    case_for_recording,
    read_case,
)
from estimator.cases.case_signals import RunSpec
from estimator.cases.written_case import write_case
from estimator.errors import CaseError, InputError
from estimator.recordings.filters import Coefficients, LowPass

FULL = """\
[fmu]
path = "dc_motor"
step = 1e-3

[inputs]
v = "voltage [V]"

[outputs]
i = "current [A]"
w = { column = "speed [rpm]", sensor = "mean", filter = { chebyshev1 = { order = 3, ripple = 0.5, cutoff = 50 } } }

[parameters]
R = { min = 0.01, max = 5, nominal = 3.1, start = 3.0 }
K = { min = 0.005, max = 0.1, fmu = ["Ke", "Km"] }

[fixed]
load = 0.0

[[recording]]
file = "step_10V5.csv"

[search]
method = "paper"
seed = 7
nests = 40
iterations = 25

[expect]
R = { value = 3.1363, within = "1 %" }
K = { value = 0.0488, within = 0.001 }
"""
RECORDING = '[[recording]]\nfile = "step_10V5.csv"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "step_10V5.csv").write_text("time,voltage\n")
    (tmp_path / "own.fmu").write_bytes(b"PK")
    return tmp_path


def case_of(folder: Path, text: str) -> Case:
    path = folder / "motor.case.toml"
    path.write_bytes(text.encode())
    return read_case(path)


def test_the_contract_s_example_is_read(folder: Path) -> None:
    assert case_of(folder, FULL) == Case(
        fmu="dc_motor",
        step=0.001,
        inputs={"v": "voltage [V]"},
        outputs={
            "i": OutputSpec("current [A]"),
            "w": OutputSpec("speed [rpm]", sensor="mean", filter=Chebyshev1(order=3, ripple=0.5, cutoff=50.0)),
        },
        parameters={
            "R": ParameterSpec("R", minimum=0.01, maximum=5.0, nominal=3.1, start=3.0, fmu=("R",)),
            "K": ParameterSpec("K", minimum=0.005, maximum=0.1, fmu=("Ke", "Km")),
        },
        fixed={"load": 0.0},
        recordings=(folder / "step_10V5.csv",),
        search=SearchSpec(method="paper", seed=7, nests=40, iterations=25),
        expect={
            "R": Expectation("R", value=3.1363, fraction=0.01),
            "K": Expectation("K", value=0.0488, absolute=0.001),
        },
    )


def test_all_but_the_recording_has_a_default(folder: Path) -> None:
    case = case_of(folder, RECORDING)
    assert case == Case(recordings=(folder / "step_10V5.csv",))
    assert case == case_for_recording(folder / "step_10V5.csv")
    assert (case.fmu, case.step, case.search) == ("dc_motor", None, SearchSpec("cuckoo", 1, None, None))
    assert case.path == folder / "motor.case.toml"


def test_a_bare_recording_may_go_with_another_fmu(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    case = case_for_recording(Path("step_10V5.csv"), fmu="own.fmu")
    assert (case.fmu, case.recordings) == ("own.fmu", (folder / "step_10V5.csv",))


@pytest.mark.parametrize(
    "text",
    [
        '[parameters.R]\nmin = 1\nfmu = "Ra"\n',
        'parameters.R.min = 1\nparameters.R.fmu = "Ra"\n',
        'parameters = { R = { min = 1, fmu = ["Ra"] } }\n',
        '\ufeff[parameters]\r\n"R" = { min = 1.0, fmu = "Ra" }\r\n',
    ],
)
def test_tables_may_be_written_in_any_way(text: str, folder: Path) -> None:
    case = case_of(folder, text + RECORDING)
    assert dict(case.parameters) == {"R": ParameterSpec("R", minimum=1.0, fmu=("Ra",))}


def test_paths_are_relative_to_the_file(folder: Path) -> None:
    (folder / "sub").mkdir()
    path = folder / "sub" / "a.case.toml"
    path.write_text('[fmu]\npath = "../own.fmu"\n[[recording]]\nfile = "../step_10V5.csv"\n')
    case = read_case(path)
    assert (case.fmu, case.recordings) == (str(folder / "own.fmu"), (folder / "step_10V5.csv",))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_has_its_name(method: str, folder: Path) -> None:
    assert case_of(folder, RECORDING + f'[search]\nmethod = "{method}"\n').search.method == method


@pytest.mark.parametrize(
    ("within", "tolerance"), [('"1 %"', 0.02), ('"0.5%"', 0.01), ('"1e1 %"', 0.2), ("0.3", 0.3), ("1", 1.0)]
)
def test_a_tolerance_is_a_share_or_a_number(within: str, tolerance: float, folder: Path) -> None:
    case = case_of(folder, RECORDING + f"[expect]\nR = {{ value = -2.0, within = {within} }}\n")
    assert case.expect["R"].tolerance(-2.0) == pytest.approx(tolerance, rel=1e-15)


def test_an_expectation_may_lean_on_the_nominal_value(folder: Path) -> None:
    case = case_of(folder, RECORDING + '[parameters]\nR = { nominal = 3 }\n[expect]\nR = { within = "1 %" }\n')
    assert case.expect["R"] == Expectation("R", value=None, fraction=0.01)
    assert Expectation("R", value=3.0).tolerance(3.0) is None


COMPLAINTS = {
    "unknown table": (RECORDING + "[serach]\n", "line 3: there is no key 'serach'; did you mean 'search'? (fmu, inp"),
    "unknown list": (RECORDING + "[[recordings]]\n", "line 3: there is no key 'recordings'; did you mean 'recording'?"),
    "unknown table in a table": (RECORDING + "[ftm.x]\n", "line 3: there is no key 'ftm'; did you mean 'fmu'?"),
    "unknown key": (
        RECORDING + "\n[search]\nseed = 1\nsede = 2\n",
        "line 6: there is no key 'sede' in search; did you mean 'seed'? (method, seed, nests, iterations, loss,",
    ),
    "unknown key of a parameter": (
        FULL.replace("max = 0.1", "mx = 0.1"),
        "line 14: there is no key 'mx' in parameters.K; did you mean 'max'? (min, max, nominal, start, fmu, per",
    ),
    "unknown key in a table of its own": (
        RECORDING + "[parameters.R]\nmin = 1\n# fine\nmaxi = 2\n",
        "line 6: there is no key 'maxi' in parameters.R; did you mean 'max'?",
    ),
    "unknown key of the FMU": ('[fmu]\npth = "x"\n' + RECORDING, "line 2: there is no key 'pth' in fmu; did you mean"),
    "unknown key of an output": (
        '[outputs]\nw = { column = "w", sensr = "mean" }\n' + RECORDING,
        "line 2: there is no key 'sensr' in outputs.w; did you mean 'sensor'? (column, fmu, integral, sensor, counts,",
    ),
    "unknown filter": (
        '[outputs]\nw = { column = "w", filter = { chebyshev3 = {} } }\n' + RECORDING,
        "line 2: there is no key 'chebyshev3' in outputs.w.filter; did you mean 'chebyshev2'?",
    ),
    "unknown key of a filter": (
        '[outputs]\nw = { column = "w", filter = { chebyshev1 = { ordr = 3 } } }\n' + RECORDING,
        "line 2: there is no key 'ordr' in outputs.w.filter.chebyshev1; did you mean 'order'?",
    ),
    "unknown key of a recording": (
        RECORDING + '[[recording]]\nfiel = "x"\n',
        "line 4: there is no key 'fiel' in recording; did you mean 'file'? (file, window, scale,",
    ),
    "unknown key of an expectation": (
        RECORDING + "[expect]\nR = { value = 1, witin = 2 }\n",
        "line 4: there is no key 'witin' in expect.R; did you mean 'within'?",
    ),
    "no recording": ("[search]\nseed = 2\n", "motor.case.toml: no recording is given; add [[recording]] with file = "),
    "empty file": ("", "motor.case.toml: no recording is given; add [[recording]] with file = "),
    "no recording in the list": ("recording = []\n", "line 1: no recording is given; add [[recording]] with file"),
    "single brackets": (
        '[recording]\nfile = "x"\n',
        'line 1: recording must be written [[recording]], in double brackets, with file = "…"',
    ),
    "recording without file": (RECORDING + "\n[[recording]]\n", 'line 4: recording has no file; add file = "…"'),
    "recording twice": (
        RECORDING + '[[recording]]\nfile = "./step_10V5.csv"\n',
        "line 4: the recording './step_10V5.csv' is given twice; leave one out",
    ),
    "recording missing": (
        RECORDING + '\n[[recording]]\nfile = "step_11V.csv"\n',
        "line 5: there is no recording 'step_11V.csv'; paths are relative to the case file's folder",
    ),
    "recording a folder": (
        '[[recording]]\nfile = "."\n',
        "line 2: the recording '.' is not a file; give a file's path",
    ),
    "recording with a null": ('[[recording]]\nfile = "a\\u0000"\n', r"line 2: there is no recording 'a\x00'; paths"),
    "recording no text": ("[[recording]]\nfile = 3\n", "line 2: recording.file must be a text in quotes, not 3"),
    "recording blank": ('[[recording]]\nfile = " "\n', "line 2: recording.file is empty; it should be a text in quo"),
    "FMU missing": ('[fmu]\npath = "x.fmu"\n' + RECORDING, "line 2: there is no FMU 'x.fmu'; paths are relative to"),
    "FMU no table": ('fmu = "dc_motor"\n' + RECORDING, "line 1: fmu must be a table, not the text 'dc_motor'"),
    "FMU an array": ("fmu = [1]\n" + RECORDING, "line 1: fmu must be a table, not an array"),
    "step zero": ("[fmu]\nstep = 0\n" + RECORDING, "line 2: fmu.step must be above 0, not 0"),
    "step negative": ("[fmu]\nstep = -1e-3\n" + RECORDING, "line 2: fmu.step must be above 0, not -0.001"),
    "step text": ('[fmu]\nstep = "1 ms"\n' + RECORDING, "line 2: fmu.step must be a number, not the text '1 ms'"),
    "step infinite": ("[fmu]\nstep = inf\n" + RECORDING, "line 2: fmu.step must be a finite number, not inf"),
    "step nan": ("[fmu]\nstep = nan\n" + RECORDING, "line 2: fmu.step must be a finite number, not nan"),
    "step huge": (f"[fmu]\nstep = 1{'0' * 400}\n" + RECORDING, "line 2: fmu.step must be a finite number, not inf"),
    "a size that squares to nothing": (
        RECORDING + "[parameters]\nB = { min = 1e-308, max = 2e-308 }\n",
        "line 4: parameters.B.min must be 0, or of a size from 1e-150 to 1e+150, not 1e-308",
    ),
    "a size that squares to infinity": (
        RECORDING + "[parameters]\nR = { nominal = 1e300 }\n",
        "line 4: parameters.R.nominal must be 0, or of a size from 1e-150 to 1e+150, not 1e+300",
    ),
    "a window without end": (RECORDING + f"window = [0, 1{'0' * 400}]\n", "line 3: recording.window must be two times"),
    "a window of texts": (RECORDING + 'window = ["0", "1"]\n', "line 3: recording.window must be two times in s"),
    "a start without end": (
        RECORDING + f"[search]\nstarts = {{ R = 1{'0' * 400} }}\n",
        "line 4: search.starts must be files, or values such as",
    ),
    "digits without end": (f"[fmu]\nstep = 1{'0' * 5000}\n" + RECORDING, "is not valid TOML"),
    "step a boolean": ("[fmu]\nstep = true\n" + RECORDING, "line 2: fmu.step must be a number, not true"),
    "input no text": ("[inputs]\nv = 3\n" + RECORDING, "line 2: inputs.v must be a text in quotes, not 3"),
    "output no text": (
        "[outputs]\ni = 3\n" + RECORDING,
        'line 2: outputs.i must be the text "column" or { column = "…" }, not 3',
    ),
    "output without column": (
        '[outputs]\ni = { sensor = "mean" }\n' + RECORDING,
        'line 2: outputs.i has no column; add column = "…"',
    ),
    "two filters": (
        '[outputs]\nw = { column = "w", filter = { bessel = {}, elliptic = {} } }\n' + RECORDING,
        "line 2: outputs.w.filter needs one filter, such as { butterworth = { order = 2, cutoff = 50 } }",
    ),
    "a filter that lacks a key": (
        '[outputs]\nw = { column = "w", both = { elliptic = { order = 3, cutoff = 5, ripple = 1 } } }\n' + RECORDING,
        "line 2: outputs.w.both.elliptic has no attenuation; write { order = 3, ripple = 0.5, attenuation = 40, cutoff",
    ),
    "unstable coefficients": (
        '[outputs]\nw = { column = "w", filter = { coefficients = { b = [1], a = [1, -2] } } }\n' + RECORDING,
        "line 2: outputs.w.filter.coefficients.a: the filter's coefficients a make it unstable; take a stable filter's",
    ),
    "coefficients that are none": (
        '[outputs]\nw = { column = "w", filter = { coefficients = { b = 1, a = [1] } } }\n' + RECORDING,
        "line 2: outputs.w.filter.coefficients.b must be a list of numbers, such as [0.1, 0.1]",
    ),
    "a delay that is neither": (
        '[outputs]\nw = { column = "w", delay = "fre" }\n' + RECORDING,
        'line 2: outputs.w.delay must be a number, or "free" to estimate it',
    ),
    "an average of none": (
        '[outputs]\nw = { column = "w", average = 0 }\n' + RECORDING,
        "line 2: outputs.w.average must be 1 to 256, not 0",
    ),
    "a filter of more coefficients than can be used": (
        f'[outputs]\nw = {{ column = "w", filter = {{ coefficients = {{ b = {[1.0] * 64}, a = [64] }} }} }}\n'
        + RECORDING,
        "line 2: outputs.w.filter.coefficients.b has 64 coefficients, of which 33 at most can be used; a running mean",
    ),
    "an input between": (
        '[inputs]\nv = { column = "v", between = "cubic" }\n' + RECORDING,
        "line 2: inputs.v.between cannot be 'cubic' (found, held, linear, linear between jumps)",
    ),
    "a window of one": (RECORDING + "window = [1]\n", "line 3: recording.window must be two times in s, such as [0.4"),
    "a window that goes back": (
        RECORDING + "window = [2, 1]\n",
        "line 3: recording.window ends before it begins;",
    ),
    "a scale without a number": (RECORDING + 'scale = { i = "x" }\n', "line 3: recording.scale.i must be a number"),
    "held out or not": (RECORDING + "validate = 1\n", "line 3: recording.validate must be true or false"),
    "nothing to fit to": (RECORDING + "validate = true\n", "every recording is held out to validate on; leave one to"),
    "its own or not": (
        "[parameters]\nR = { per_recording = 1 }\n" + RECORDING,
        "line 2: parameters.R.per_recording must be true or false",
    ),
    "an unknown loss": (
        RECORDING + '[search]\nloss = "hubert"\n',
        "loss cannot be 'hubert'; did you mean 'huber'",
    ),
    "unknown sensor": (
        '[outputs]\ni = { column = "i", sensor = "men" }\n' + RECORDING,
        "line 2: outputs.i.sensor cannot be 'men'; did you mean 'mean'? (auto, identity, mean)",
    ),
    "filter without cutoff": (
        FULL.replace(", cutoff = 50", ""),
        "line 10: outputs.w.filter.chebyshev1 has no cutoff; write { order = 3, ripple = 0.5, cutoff = 50 }",
    ),
    "filter of no order": (FULL.replace("order = 3", "order = 0"), "chebyshev1.order must be 1 to 20, not 0"),
    "filter of half an order": (FULL.replace("order = 3", "order = 1.5"), "order must be a whole number, not 1.5"),
    "filter without ripple": (FULL.replace("ripple = 0.5", "ripple = 0"), "chebyshev1.ripple must be above 0, not 0"),
    "bounds upside down": (
        FULL.replace("min = 0.01", "min = 50"),
        "line 13: parameters.R has min 50 and max 5; min must be the smaller one",
    ),
    "bounds that leave nothing": (FULL.replace("min = 0.01", "min = 5"), "parameters.R has min 5 and max 5; min must"),
    "start too low": (
        FULL.replace("start = 3.0", "start = 0.001"),
        "line 13: parameters.R starts at 0.001, below its min 0.01; start within the bounds",
    ),
    "start too high": (
        FULL.replace("start = 3.0", "start = 6"),
        "line 13: parameters.R starts at 6, above its max 5; start within the bounds",
    ),
    "parameter a number": (
        RECORDING + "[parameters]\nR = 3\n",
        "line 4: parameters.R must be a table, not 3",
    ),
    "bound a boolean": (
        RECORDING + "[parameters]\nR = { min = false }\n",
        "parameters.R.min must be a number, not false",
    ),
    "bound an array": (
        RECORDING + "[parameters]\nR = { min = [1] }\n",
        "parameters.R.min must be a number, not an arr",
    ),
    "nominal a table": (RECORDING + "[parameters]\nR = { nominal = {} }\n", "R.nominal must be a number, not a table"),
    "no destination": (
        RECORDING + "[parameters]\nK = { fmu = [] }\n",
        'line 4: parameters.K.fmu must be a name such as "Ke", or names such as ["Ke", "Km"]',
    ),
    "destination a number": (RECORDING + "[parameters]\nK = { fmu = 3 }\n", "parameters.K.fmu must be a name such as"),
    "fixed a text": (RECORDING + '[fixed]\nL = "0.013"\n', "line 4: fixed.L must be a number, not the text '0.013'"),
    "estimated and fixed": (
        FULL.replace("load = 0.0", "load = 0.0\nR = 3"),
        "line 18: 'R' is given by parameters.R and by [fixed]; leave one out",
    ),
    "estimated elsewhere and fixed": (
        FULL.replace("load = 0.0", "load = 0.0\nK = 3"),
        "line 18: 'K' is both estimated (parameters.K) and fixed; leave one out",
    ),
    "destination fixed": (
        FULL.replace("load = 0.0", "Km = 3"),
        "line 17: 'Km' is given by parameters.K and by [fixed]; leave one out",
    ),
    "input fixed": (FULL.replace("load = 0.0", "v = 3"), "line 17: 'v' is given by [inputs] and by [fixed]; leave one"),
    "two parameters for one variable": (
        FULL.replace('"Km"]', '"R"]'),
        "line 14: 'R' is given by parameters.R and by parameters.K; leave one out",
    ),
    "unknown method": (
        RECORDING + '[search]\nmethod = "cukoo"\n',
        "line 4: search.method cannot be 'cukoo'; did you mean 'cuckoo'? (cuckoo, paper, original, integral, steig",
    ),
    "negative seed": (RECORDING + "[search]\nseed = -1\n", "line 4: search.seed must be at least 0, not -1"),
    "half a seed": (RECORDING + "[search]\nseed = 1.5\n", "line 4: search.seed must be a whole number, not 1.5"),
    "seed a boolean": (RECORDING + "[search]\nseed = true\n", "line 4: search.seed must be a whole number, not true"),
    "too many nests": (
        RECORDING + "[search]\nnests = 100000000000\n",
        "line 4: search.nests must be 2 to 1000000, not 100000000000",
    ),
    "one nest": (RECORDING + "[search]\nnests = 1\n", "line 4: search.nests must be 2 to 1000000, not 1"),
    "no iterations": (
        RECORDING + "[search]\niterations = 0\n",
        "line 4: search.iterations must be 1 to 1000000, not 0",
    ),
    "within a text": (
        RECORDING + '[expect]\nR = { value = 1, within = "one percent" }\n',
        "line 4: expect.R: within is 'one percent'; write within = \"1 %\" or a number",
    ),
    "within nothing": (RECORDING + '[expect]\nR = { value = 1, within = "0 %" }\n', "within is '0 %'; write within"),
    "within a negative number": (
        RECORDING + "[expect]\nR = { value = 1, within = -1 }\n",
        "within must be above 0, not -1",
    ),
    "nothing expected": (
        RECORDING + '[expect]\nR = { within = "1 %" }\n',
        "line 4: expect.R has no value; add value = …, or a nominal to parameters.R",
    ),
    "expectation a number": (RECORDING + "[expect]\nR = 3\n", "line 4: expect.R must be a table, not 3"),
    "syntax": ("[fmu]\npath = dc_motor\n", "line 2 is not valid TOML: invalid value"),
    "syntax at the end": (RECORDING + "[fmu", "line 3 is not valid TOML: "),
    "key twice": (RECORDING + "[search]\nseed = 1\nseed = 2\n", "line 5 is not valid TOML: cannot overwrite a value"),
    "table twice": (RECORDING + "[fmu]\n[fmu]\n", "line 4 is not valid TOML: cannot declare fmu twice"),
    "too deep": ("x = " + "[" * 100000, "is not valid TOML: "),
}


def test_a_recording_where_a_case_file_is_meant_is_told(tmp_path):
    (tmp_path / "run3.csv").write_text("time [s],voltage [V]\n0,0\n")
    with pytest.raises(
        CaseError, match=r"^run3.csv line 1 is not valid TOML: .*; a case file is meant, whose name ends"
    ):
        read_case(tmp_path / "run3.csv")


@pytest.mark.parametrize("name", COMPLAINTS)
def test_what_is_wrong_is_said_in_one_sentence_with_file_and_line(name: str, folder: Path) -> None:
    text, sentence = COMPLAINTS[name]
    with pytest.raises(CaseError) as caught:
        case_of(folder, text)
    assert str(caught.value).startswith("motor.case.toml")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_case_file_that_cannot_be_read_is_said(folder: Path) -> None:
    with pytest.raises(
        CaseError, match=r"^there is no case file .*x\.case\.toml; give the path of a \.case\.toml file$"
    ):
        read_case(folder / "x.case.toml")
    with pytest.raises(CaseError, match=r" is a folder; give a \.case\.toml file$"):
        read_case(folder)
    with pytest.raises(CaseError, match=r"cannot be read \(Not a directory\); make it readable$"):
        read_case(folder / "own.fmu" / "x")
    (folder / "y.case.toml").write_bytes(b"# fine\n# \xff\n")
    with pytest.raises(CaseError, match=r"^y\.case\.toml line 2 is not UTF-8 text; save the case file as UTF-8$"):
        read_case(folder / "y.case.toml")


@pytest.mark.parametrize("again", [copy.deepcopy, lambda case: pickle.loads(pickle.dumps(case))])
def test_a_case_travels_to_other_processes(again: Callable[[Case], Case], folder: Path) -> None:
    case = case_of(folder, FULL)
    assert again(case) == case
    assert again(case).path == case.path


def test_a_case_is_locked(folder: Path) -> None:
    with pytest.raises(TypeError):
        case_of(folder, FULL).fixed["L"] = 1.0  # type: ignore[index]


POSITIVE = st.floats(min_value=1e-150, max_value=1e150)
FINITE = st.just(0.0) | POSITIVE | POSITIVE.map(operator.neg)
NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=6)
TEXTS = NAMES.filter(lambda text: bool(text.strip()))
ORDERS = st.integers(1, 20)
FILTERS = st.one_of(
    st.none(),
    st.builds(Chebyshev1, order=ORDERS, ripple=POSITIVE, cutoff=POSITIVE),
    st.builds(LowPass, family=st.sampled_from(["butterworth", "bessel"]), order=ORDERS, cutoff=POSITIVE),
    st.builds(LowPass, family=st.just("chebyshev2"), order=ORDERS, cutoff=POSITIVE, attenuation=POSITIVE),
    st.builds(
        LowPass, family=st.just("elliptic"), order=ORDERS, cutoff=POSITIVE, ripple=POSITIVE, attenuation=POSITIVE
    ),
    st.builds(Coefficients, b=st.lists(POSITIVE, min_size=1, max_size=3).map(tuple), a=st.just((1.0, -0.5))),
)
VALUES = st.none() | st.just("free") | FINITE
OUTPUTS = st.builds(
    OutputSpec,
    column=TEXTS,
    sensor=st.sampled_from(["auto", "identity", "mean"]),
    filter=FILTERS,
    both=FILTERS,
    counts=st.none() | st.integers(1, 10**6),
    average=st.none() | st.integers(1, 64),
    gain=st.none() | st.just("free") | POSITIVE,
    offset=VALUES,
    delay=VALUES,
    quantum=st.none() | POSITIVE,
)
RUNS = st.builds(
    RunSpec,
    window=st.none() | st.lists(FINITE, min_size=2, max_size=2, unique=True).map(lambda ends: tuple(sorted(ends))),
    scale=st.dictionaries(NAMES, FINITE, max_size=2),
    offset=st.dictionaries(NAMES, FINITE, max_size=2),
    delay=VALUES,
    temperature=st.none() | st.integers(-1999, 4999).map(lambda tenths: tenths / 10),
)


@st.composite
def parameters(draw: st.DrawFn) -> dict[str, ParameterSpec]:
    names = draw(st.lists(NAMES, unique=True, max_size=4))
    specs = {}
    for k, name in enumerate(names):
        low, start, high = sorted(draw(st.lists(FINITE, min_size=3, max_size=3, unique=True)))
        specs[name] = ParameterSpec(
            name,
            minimum=draw(st.sampled_from([low, None])),
            maximum=draw(st.sampled_from([high, None])),
            nominal=draw(st.none() | FINITE),
            start=draw(st.sampled_from([start, None])),
            fmu=tuple(f"target {k} {j}" for j in range(draw(st.integers(1, 3)))),
            per_recording=draw(st.booleans()),
        )
    return specs


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_written_case_reads_back_the_same(data: st.DataObject, folder: Path) -> None:
    specs = data.draw(parameters())
    expect = {
        name: Expectation(name, value=data.draw(FINITE), fraction=fraction, absolute=absolute)
        for name in data.draw(st.lists(NAMES, unique=True, max_size=3))
        for fraction, absolute in [data.draw(st.sampled_from([(None, None), (0.01, None), (None, 0.5)]))]
    }
    run = data.draw(RUNS)
    inputs = data.draw(st.dictionaries(NAMES.map("in {}".format), TEXTS, max_size=3))
    case = Case(
        fmu=data.draw(st.sampled_from(["dc_motor", str(folder / "own.fmu"), str(folder / "step_10V5.csv")])),
        step=data.draw(st.none() | POSITIVE),
        inputs=inputs,
        products={name: data.draw(TEXTS) for name in inputs if data.draw(st.booleans())},
        linear=tuple(name for name in inputs if data.draw(st.booleans())),
        outputs=data.draw(st.dictionaries(NAMES, OUTPUTS, max_size=3)),
        parameters=specs,
        fixed=data.draw(st.dictionaries(NAMES.map("fixed {}".format), FINITE, max_size=3)),
        recordings=(folder / "step_10V5.csv",),
        runs=(run,) if run != RunSpec() else (),
        search=data.draw(
            st.builds(
                SearchSpec,
                method=st.sampled_from(METHODS),
                seed=st.integers(0, 2**62),
                nests=st.none() | st.integers(2, 1000),
                iterations=st.none() | st.integers(1, 1000),
                loss=st.sampled_from(["linear", "huber"]),
            )
        ),
        expect=expect,
    )
    path = folder / "written.case.toml"
    write_case(case, path)
    assert read_case(path) == case


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(fraction=st.floats(min_value=1e-12, max_value=10))
def test_a_share_is_written_so_that_it_reads_back_to_the_bit(fraction: float, folder: Path) -> None:
    case = Case(recordings=(folder / "step_10V5.csv",), expect={"R": Expectation("R", value=1.0, fraction=fraction)})
    write_case(case, folder / "written.case.toml")
    assert read_case(folder / "written.case.toml") == case


def test_a_written_case_is_a_file_to_read(folder: Path) -> None:
    path = folder / "written.case.toml"
    write_case(case_of(folder, FULL), path)
    assert path.read_text() == FULL.replace("step = 1e-3", "step = 0.001").replace("max = 5,", "max = 5.0,").replace(
        "cutoff = 50 ", "cutoff = 50.0 "
    )


def test_paths_are_written_relative_to_the_file(folder: Path) -> None:
    (folder / "sub").mkdir()
    case = Case(fmu=str(folder / "own.fmu"), recordings=(folder / "step_10V5.csv",))
    path = folder / "sub" / "a.case.toml"
    write_case(case, path)
    assert '"../own.fmu"' in path.read_text()
    assert '"../step_10V5.csv"' in path.read_text()
    assert read_case(path) == case


def test_a_case_is_written_whole_or_not_at_all(folder: Path) -> None:
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match="cannot be written"):
        write_case(Case(), folder / "missing" / "a.case.toml")
    assert sorted(folder.iterdir()) == before


def test_what_the_report_is_to_say_is_read_and_written(tmp_path):
    (tmp_path / "a.csv").write_text("time [s]\n")
    text = '[[recording]]\nfile = "a.csv"\n[about]\nmotor = "No. 3"\ndate = 2026-11-22\n'
    (tmp_path / "m.case.toml").write_text(text)
    case = read_case(tmp_path / "m.case.toml")
    assert dict(case.about) == {"motor": "No. 3", "date": "2026-11-22"}
    write_case(case, tmp_path / "again.case.toml")
    assert read_case(tmp_path / "again.case.toml") == case
    (tmp_path / "m.case.toml").write_text(text.replace('"No. 3"', "3"))
    with pytest.raises(CaseError, match="about.motor must be a text in quotes, not 3"):
        read_case(tmp_path / "m.case.toml")
