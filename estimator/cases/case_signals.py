"""What a case says of signals and recordings: columns, sensors, filters, corrections. Reads and writes their tables.

A value of the measurement chain is a number (it is held), "free" (it is estimated), or not given (it is found in the
data where it shows, else it stays at its default).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from estimator.cases import keys
from estimator.cases.keys import Key, Keys, Value
from estimator.cases.strict_toml import Table, number_in
from estimator.locked import Locked
from estimator.motor.winding import COLDEST, HOTTEST
from estimator.recordings.filters import (
    FAMILIES,
    MAX_COEFFICIENTS,
    MAX_ORDER,
    Chebyshev1,
    Coefficients,
    Filter,
    LowPass,
)
from estimator.recordings.read_as import AS_WRITTEN, ReadAs

SENSORS = ("auto", "identity", "mean")
HELD, LINEAR, JUMPING = "held", "linear", "linear between jumps"
BETWEEN = ("found", HELD, LINEAR, JUMPING)
MAX_AVERAGE = 256  # as in sensors.h
REST, SETTLED, GIVEN = BEGINS = ("rest", "settled", "given")  # how a simulation begins


@dataclass(frozen=True)
class InputSpec:
    """One FMU input and the column that drives it; ``INPUT`` says what each is."""

    column: str
    fmu: str = ""
    times: str = ""
    between: str = "found"

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing to say but the column."""
        return self == InputSpec(self.column)


@dataclass(frozen=True)
class OutputSpec:
    """One FMU output, the column that measures it, and the sensor between them; ``OUTPUT`` says what each is."""

    column: str
    sensor: str = "auto"
    filter: Filter | None = None
    fmu: str = ""
    integral: str = ""
    counts: int | None = None
    average: int | None = None
    both: Filter | None = None
    gain: Value = None
    offset: Value = None
    delay: Value = None
    quantum: float | None = None


@dataclass(frozen=True)
class RunSpec(Locked):
    """What a case says of one recording beside its file; ``RUN`` says what each is."""

    window: tuple[float, float] | None = None
    scale: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)
    delay: Value = None
    temperature: float | None = None
    validate: bool = False
    read_as: ReadAs = AS_WRITTEN
    begin: str | None = None


def _window(entry: Table, key: str) -> tuple[float, float]:
    ends = entry.value[key]
    low, high = (number_in(end) for end in ends) if isinstance(ends, list) and len(ends) == 2 else (None, None)
    if low is None or high is None:
        entry.fail((key,), f"{entry.full(key)} must be two times in s, such as [0.4, 2.0]")
    if low >= high:
        entry.fail((key,), f"{entry.full(key)} ends before it begins; write [from, to] in s")
    return low, high


def _average(about: str) -> Key:
    samples = keys.whole("", minimum=1, maximum=MAX_AVERAGE)
    return Key(
        lambda table, key: None if table.value[key] == "auto" else samples.read(table, key),
        {"anyOf": [samples.schema["anyOf"][0], {"const": "auto"}], "description": about},
    )


_FILTER = {
    "order": keys.whole("order", minimum=1, maximum=MAX_ORDER),
    "ripple": keys.number("in the pass band, dB", above=0),
    "attenuation": keys.number("in the stop band, dB", above=0),
    "cutoff": keys.number("Hz", above=0),
}
_USUAL = {"order": 3, "ripple": 0.5, "attenuation": 40, "cutoff": 50}
_FILTERS = {
    family: Keys(None, **{name: replace(_FILTER[name], required=True) for name in ("order", *needed, "cutoff")})
    for family, needed in FAMILIES.items()
}


def _read_filter(table: Table, key: str) -> Filter:
    table = table.table(key)
    table.only(*_FILTERS, "coefficients")
    if len(table.keys) != 1:
        table.fail((), f"{table.title} needs one filter, such as {{ butterworth = {{ order = 2, cutoff = 50 }} }}")
    family = table.keys[0]
    inner = table.table(family)
    if family == "coefficients":
        inner.only("b", "a")
        return Coefficients(b=_coefficients(inner, "b"), a=_coefficients(inner, "a"))
    inner.only(*_FILTERS[family])
    for name in _FILTERS[family]:
        if name not in inner.value:
            example = ", ".join(f"{key} = {_USUAL[key]}" for key in _FILTERS[family])
            inner.fail((), f"{inner.title} has no {name}; write {{ {example} }}")
    values = _FILTERS[family].read(inner)
    return Chebyshev1(**values) if family == "chebyshev1" else LowPass(family, **values)


def _filter_value(spec: Filter) -> dict[str, Any]:
    if isinstance(spec, Coefficients):
        return {"coefficients": {"b": list(spec.b), "a": list(spec.a)}}
    return {spec.family: {name: getattr(spec, name) for name in _FILTERS[spec.family]}}


def _filter(about: str) -> Key:
    numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1, "maxItems": MAX_COEFFICIENTS}
    coefficients = Keys(None, **{name: Key(_coefficients, numbers, required=True) for name in ("b", "a")})
    families = {family: inner.schema() for family, inner in {**_FILTERS, "coefficients": coefficients}.items()}
    schema = {"type": "object", "properties": families, "additionalProperties": False}
    return Key(_read_filter, {**schema, "minProperties": 1, "maxProperties": 1, "description": about}, _filter_value)


def _coefficients(table: Table, key: str) -> tuple[float, ...]:
    values = table.value.get(key)
    numbers = [number_in(value) for value in values] if isinstance(values, list) else []
    coefficients = tuple(number for number in numbers if number is not None)
    if not numbers or len(coefficients) < len(numbers):
        table.fail(
            (key,) if key in table.value else (), f"{table.full(key)} must be a list of numbers, such as [0.1, 0.1]"
        )
    from estimator.recordings.sensors import transfer_sections

    if len(numbers) > MAX_COEFFICIENTS:
        table.fail(
            (key,),
            f"{table.full(key)} has {len(numbers)} coefficients, of which {MAX_COEFFICIENTS} at most can be used;"
            " a running mean is average = n, samples",
        )
    if key == "a":
        try:
            transfer_sections((1.0,), coefficients)
        except ValueError as error:
            table.fail((key,), f"{table.full(key)}: {error}; take a stable filter's")
    return coefficients


INPUT = Keys(
    InputSpec,
    column=keys.text("column of the recording", required=True),
    fmu=keys.text("variable of the FMU; default: the input's own name"),
    times=keys.text("column that it is multiplied with: the supply of a duty cycle"),
    between=keys.choice(BETWEEN, "from row to row; found: held, or as the data of an FMU that is no motor show"),
)
OUTPUT = Keys(
    OutputSpec,
    column=keys.text("column of the recording", required=True),
    fmu=keys.text("variable of the FMU; default: the output's own name"),
    integral=keys.text("variable of the FMU that integrates it, for the sensor mean; default: angle for w"),
    sensor=keys.choice(
        SENSORS, "mean: over the last sampling interval, as differenced encoder counts; auto: by the data"
    ),
    counts=keys.whole("of an encoder a turn: the column holds counts", minimum=1),
    average=_average("samples of a running mean that the logger took; default: by the data"),
    filter=_filter("that the measurement went through; the model goes through it too"),
    both=_filter("that is applied here, to measurement and model"),
    gain=keys.value("of the sensor; -1: the FMU counts the other way", never=0),
    offset=keys.value("of the sensor, SI"),
    delay=keys.value("of this channel beyond the recording's, s"),
    quantum=keys.number("step of the quantisation, SI; default: by the data", above=0),
)
RUN = Keys(
    RunSpec,
    window=Key(
        _window,
        {
            "type": "array",
            "items": keys.number("s").schema,
            "minItems": 2,
            "maxItems": 2,
            "description": "only samples from one time to the other are used, s of the recording's own time",
        },
        list,
    ),
    scale=keys.named(keys.number("factor"), "channel = factor on its samples; -1 turns its sign"),
    offset=keys.named(keys.number("SI"), "channel = what is added to its samples after the factor"),
    delay=keys.value("of the outputs behind the inputs, s"),
    temperature=keys.number("of the winding, degrees Celsius", above=COLDEST, below=HOTTEST),
    validate=keys.flag("held out of the fit, compared with it"),
    begin=keys.choice(
        BEGINS,
        "how the simulation begins: at rest, settled at the first row's inputs, or as FMU and case give its states;"
        " default: a motor by the data, another FMU as given",
    ),
)
READING = Keys(
    ReadAs,
    columns=keys.named(keys.text(), "v, i, w, angle or load = the column that it is; wins over the file's header"),
    units=keys.named(keys.text(), "column, or v, i, w, …, time = its unit; wins over the file's header"),
    rate=keys.number("of the samples of a file that has no time, Hz", above=0),
    test=keys.text("which test, of a file that holds several; default: all, each a recording"),
    motor=keys.text("which motor, of a file that holds several: left, right, 1, …"),
    per_turn=keys.number("m that a turn goes, of a speed in m/s or a way in m", above=0),
    counts=keys.number("counts a turn, of a column of encoder counts", above=0),
    supply=keys.text("of a duty cycle: volts, volts a count (12/255), or the column that holds them"),
)
RECORDING = Keys(
    RunSpec,
    file=keys.text("path, relative to this file; a pattern (motor_*.csv) is a case for each match", required=True),
    **RUN,
    **READING,
)


def read_input(inputs: Table, name: str) -> InputSpec:
    """Read one entry of [inputs]: the text "column", or a table."""
    if not isinstance(inputs.value[name], dict):
        return InputSpec(inputs.text(name))
    spec = InputSpec(**INPUT.checked(inputs.table(name)))
    return replace(spec, fmu="") if spec.fmu == name else spec


def read_output(outputs: Table, name: str) -> OutputSpec:
    """Read one entry of [outputs]: the text "column", or a table."""
    if not isinstance(outputs.value[name], dict):
        return OutputSpec(outputs.text(name, expected='the text "column" or { column = "…" }'))
    return OutputSpec(**OUTPUT.checked(outputs.table(name)))


def read_run(entry: Table) -> RunSpec:
    """Read what one [[recording]] says beside its file."""
    entry.only(*RECORDING)
    return RunSpec(**RUN.read(entry), read_as=ReadAs(**READING.read(entry)))


def input_value(spec: InputSpec) -> Any:
    """Return an input as a case file says it."""
    return spec.column if spec.is_plain else INPUT.write(spec)


def output_value(spec: OutputSpec) -> Any:
    """Return an output as a case file says it."""
    return spec.column if spec == OutputSpec(spec.column) else OUTPUT.write(spec)


def run_value(spec: RunSpec) -> dict[str, Any]:
    """Return what a case file says of a recording beside its file."""
    return {**RUN.write(spec), **READING.write(spec.read_as)}
