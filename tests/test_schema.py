"""The JSON Schema of case files says the same as their reader (schema.py against case.py)."""

import re
import tomllib
from dataclasses import fields
from functools import cache

import jsonschema
import pytest

from estimator.cases.case import FMU, PARAMETER, SEARCH, Case, ParameterSpec, SearchSpec, read_cases
from estimator.cases.case_signals import INPUT, OUTPUT, READING, RUN, InputSpec, OutputSpec, RunSpec
from estimator.cases.expectation import ENTRY, LIMITS, Expectation, Limits
from estimator.cases.schema import schema
from estimator.errors import CaseError
from estimator.recordings.read_as import ReadAs

FULL = """\
[fmu]
path = "dc_motor"
step = 1e-3
[inputs]
v = { column = "duty [%]", times = "supply [V]", between = "linear" }
[outputs]
i = "current [A]"
w = { column = "speed [rpm]", sensor = "mean", filter = { chebyshev1 = { order = 3, ripple = 0.5, cutoff = 50 } } }
angle = { column = "enc", counts = 4000, average = "auto", gain = "free", offset = 0.1, delay = 1e-3, quantum = 0.01 }
x = { column = "x", sensor = "auto", average = 4, both = { bessel = { order = 2, cutoff = 9 } } }
y = { column = "y", filter = { coefficients = { b = [0.5], a = [1, -0.5] } } }
z = { column = "z", both = { elliptic = { order = 3, ripple = 1, attenuation = 40, cutoff = 9 } } }
[parameters]
R = { min = 0.01, max = 5, nominal = "{R}", start = 3.0, per_recording = true }
K = { min = 0.005, max = 0.1, fmu = ["Ke", "Km"] }
[fixed]
load = 0.0
[[recording]]
file = "run.csv"
window = [0.4, 2.0]
scale = { i = -1 }
offset = { i = 0.02 }
delay = "free"
temperature = 60
[[recording]]
file = "held.csv"
validate = true
[motors]
file = "motors.csv"
name = "serial"
[search]
method = "paper"
seed = 7
nests = 40
loss = "huber"
iterations = 25
[expect]
R = { value = 3.1363, within = "1 %" }
K = { min = 0.04, max = 0.06 }
L = { value = "{R}", within = 0.5 }
verdict = ["ok", "doubtful"]
confidence = 0.95
rmse = { i = 0.05 }
standard_error = { R = "1 %", K = 1e-3 }
[nameplate]
voltage = 12
R = 3.1
no_load_speed = { value = 2000, unit = "rpm", within = "5 %" }
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "run.csv").write_text("")
    (tmp_path / "held.csv").write_text("")
    (tmp_path / "motors.csv").write_text("serial,R\nA1,3.1\n")
    return tmp_path


def read(folder, text):
    path = folder / "a.case.toml"
    path.write_text(text)
    return read_cases(path)


@cache
def validator():
    """Return what validates case files: the schema itself is checked by a test, once."""
    return jsonschema.validators.validator_for(schema())(schema())


def valid(text):
    return validator().is_valid(tomllib.loads(text))


def test_the_schema_is_a_schema_and_accepts_a_full_case(folder):
    jsonschema.Draft202012Validator.check_schema(schema())
    read(folder, FULL)
    assert valid(FULL)


# A misspelt key makes the reader list what it knows: the keys must be the schema's.
TABLES = {
    "": (),
    "[fmu]": ("fmu",),
    "[motors]": ("motors",),
    "[search]": ("search",),
    "[nameplate]": ("nameplate",),
    "[nameplate.R]": ("nameplate", "R", 1),
    "[parameters.R]": ("parameters", None),
    "[outputs.w]": ("outputs", None, 1),
    "[outputs.w.filter]": ("outputs", None, 1, "filter"),
    "[outputs.w.filter.chebyshev1]": ("outputs", None, 1, "filter", "chebyshev1"),
    "[expect.R]": ("expect", None),
    "[[recording]]": ("recording",),
}


@pytest.mark.parametrize("title", TABLES)
def test_the_reader_and_the_schema_know_the_same_keys(title, folder):
    node = schema()
    for step in TABLES[title]:
        if isinstance(step, int):
            node = node["anyOf"][step]
        else:
            node = node["additionalProperties"] if step is None else node["properties"][step]
    node = node.get("items", node)
    known = set(node["properties"])
    recording = '[[recording]]\nfile = "run.csv"\n'
    column = 'column = "w"\n' if title == "[outputs.w]" else ""
    if title == "[outputs.w.filter]" or title.endswith("chebyshev1]"):
        column = '[outputs.w]\ncolumn = "w"\n'
    text = f"zzz = 1\n{recording}" if not title else f"{recording}{column if 'filter' in title else ''}{title}\n"
    if title:
        text += f"{column if 'filter' not in title else ''}zzz = 1\n"
    assert not valid(text)
    with pytest.raises(CaseError, match=r"there is no key 'zzz'") as error:
        read(folder, text)
    assert set(re.search(r"\(([^()]*)\)$", str(error.value))[1].split(", ")) == known


HOLDERS = [(INPUT, InputSpec), (OUTPUT, OutputSpec), (RUN, RunSpec), (READING, ReadAs), (PARAMETER, ParameterSpec)]
HOLDERS += [(SEARCH, SearchSpec), (FMU, Case), (ENTRY, Expectation), (LIMITS, Limits)]


@pytest.mark.parametrize(("keys", "holder"), HOLDERS, ids=lambda x: getattr(x, "__name__", ""))
def test_every_key_has_its_place_in_what_holds_it_and_nothing_there_lacks_a_key(keys, holder):
    made = {key.field or name for name, key in keys.items()}
    assert all(name in {f.name for f in fields(holder)} or hasattr(holder, name) for name in made)
    elsewhere = {"name", "gains", "fmu", "fraction", "absolute", "read_as"}  # of the way to the key, or of another key
    assert holder is Case or {f.name for f in fields(holder)} <= made | elsewhere


WRONG = [
    ("step = 1e-3", "step = 0"),
    ('sensor = "mean"', 'sensor = "men"'),
    ("order = 3", "order = 3.5"),
    ("order = 3", "order = 21"),
    ("min = 0.01", 'min = "low"'),
    ("min = 0.01", "min = true"),
    ("load = 0.0", "load = [1]"),
    ('file = "run.csv"', "file = 3"),
    ('method = "paper"', 'method = "papre"'),
    ("seed = 7", "seed = -1"),
    ("nests = 40", "nests = 1"),
    ('within = "1 %"', 'within = "one"'),
    ('["ok", "doubtful"]', '["okay"]'),
    ("confidence = 0.95", "confidence = 95"),
    ("i = 0.05", "i = -1"),
    ('R = "1 %"', 'R = "1"'),
    ("voltage = 12", "voltage = 0"),
    ("temperature = 60", "temperature = -250"),
    ("temperature = 60", "temperature = 1e140"),
]


@pytest.mark.parametrize(("right", "wrong"), WRONG)
def test_what_the_schema_refuses_the_reader_refuses(right, wrong, folder):
    text = FULL.replace(right, wrong, 1)
    assert text != FULL
    assert not valid(text)
    with pytest.raises(CaseError):
        read(folder, text)
