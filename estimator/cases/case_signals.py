"""What a case says of signals and recordings: columns, sensors, filters, corrections. Reads and writes their tables.

A value of the measurement chain is a number (it is held), "free" (it is estimated), or not given (it is found in the
data where it shows, else it stays at its default).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Literal

from estimator.cases.strict_toml import Table
from estimator.recordings.filters import FAMILIES, MAX_ORDER, Chebyshev1, Coefficients, Filter, LowPass
from estimator.recordings.read_as import AS_WRITTEN, ReadAs

SENSORS = ("auto", "identity", "mean")
BETWEEN = ("held", "linear")
FREE: Literal["free"] = "free"
Value = float | Literal["free"] | None
MAX_AVERAGE = 64  # as in sensors.h

INPUT_KEYS = ("column", "fmu", "times", "between")
OUTPUT_KEYS = (
    "column", "fmu", "integral", "sensor", "counts", "average", "filter", "both", "gain", "offset", "delay", "quantum",
)  # fmt: skip
READING_KEYS = ("columns", "units", "rate", "test", "motor", "per_turn", "counts", "supply")
RUN_KEYS = ("file", "window", "scale", "offset", "delay", "temperature", "validate", "begin", *READING_KEYS)
REST, SETTLED, GIVEN = BEGINS = ("rest", "settled", "given")  # how a simulation begins


@dataclass(frozen=True)
class InputSpec:
    """One FMU input and the column that drives it."""

    column: str
    fmu: str = ""  # variable of the FMU; by default the one of the same name
    times: str = ""  # column that it is multiplied with: the supply of a duty cycle
    between: str = "held"  # from row to row; "linear": on a line

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing to say but the column."""
        return self == InputSpec(self.column)


@dataclass(frozen=True)
class OutputSpec:
    """One FMU output, the column that measures it, and the sensor between them."""

    column: str
    sensor: str = "auto"  # "mean": over the last sampling interval, as differenced encoder counts; "auto": by the data
    filter: Filter | None = None  # that the measurement went through
    fmu: str = ""  # variable of the FMU; by default the one of the same name
    integral: str = ""  # variable of the FMU that integrates it, for the sensor "mean"; by default angle for w
    counts: int | None = None  # of an encoder a turn: the column holds counts
    average: int | None = None  # samples of a running mean; None: by the data
    both: Filter | None = None  # that is applied here, to measurement and model
    gain: Value = None
    offset: Value = None
    delay: Value = None  # s, beyond that of the recording
    quantum: float | None = None  # step of the quantisation; None: by the data


@dataclass(frozen=True)
class RunSpec:
    """What a case says of one recording."""

    window: tuple[float, float] | None = None  # s, of the recording's own time; only samples within are used
    scale: Mapping[str, float] = field(default_factory=dict)  # channel → factor on its samples
    offset: Mapping[str, float] = field(default_factory=dict)  # channel → what is added after, SI
    delay: Value = None  # s, of the outputs behind the inputs
    temperature: float | None = None  # °C, of the winding
    validate: bool = False  # held out of the fit, compared with it
    read_as: ReadAs = AS_WRITTEN  # columns and units that win over the file's header
    begin: str | None = None  # "rest", "settled" at the first row's inputs, "given" by FMU and case; None: by the data

    def __post_init__(self) -> None:
        """Lock the mappings."""
        for name in ("scale", "offset"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as plain dictionaries."""
        values = (getattr(self, f.name) for f in fields(self))
        return RunSpec, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


def read_input(inputs: Table, name: str) -> InputSpec:
    """Read one entry of [inputs]: the text "column", or a table."""
    if not isinstance(inputs.value[name], dict):
        return InputSpec(inputs.text(name))
    table = inputs.table(name)
    table.only(*INPUT_KEYS)
    variable = table.text("fmu") if "fmu" in table.value else ""
    return InputSpec(
        column=table.text("column"),
        fmu="" if variable == name else variable,
        times=table.text("times") if "times" in table.value else "",
        between=table.choice("between", BETWEEN, default="held"),
    )


def read_output(outputs: Table, name: str) -> OutputSpec:
    """Read one entry of [outputs]: the text "column", or a table."""
    if not isinstance(outputs.value[name], dict):
        return OutputSpec(outputs.text(name, expected='the text "column" or { column = "…" }'))
    table = outputs.table(name)
    table.only(*OUTPUT_KEYS)
    return OutputSpec(
        column=table.text("column"),
        sensor=table.choice("sensor", SENSORS, default="auto"),
        filter=_filter(table.table("filter")) if "filter" in table.value else None,
        fmu=table.text("fmu") if "fmu" in table.value else "",
        integral=table.text("integral") if "integral" in table.value else "",
        counts=table.integer("counts", minimum=1),
        average=None if table.value.get("average") == "auto" else _average(table),
        both=_filter(table.table("both")) if "both" in table.value else None,
        gain=_value(table, "gain", above=0),
        offset=_value(table, "offset"),
        delay=_value(table, "delay"),
        quantum=table.number("quantum", above=0),
    )


def read_run(entry: Table) -> RunSpec:
    """Read what one [[recording]] says beside its file."""
    window = None
    if "window" in entry.value:
        ends = entry.value["window"]
        if not isinstance(ends, list) or len(ends) != 2 or not all(_is_number(end) for end in ends):
            entry.fail(("window",), f"{entry.full('window')} must be two times in s, such as [0.4, 2.0]")
        window = (float(ends[0]), float(ends[1]))
        if window[0] >= window[1]:
            entry.fail(("window",), f"{entry.full('window')} ends before it begins; write [from, to] in s")
    held_out = entry.value.get("validate", False)
    if not isinstance(held_out, bool):
        entry.fail(("validate",), f"{entry.full('validate')} must be true or false")
    return RunSpec(
        window=window,
        scale=_numbers(entry, "scale"),
        offset=_numbers(entry, "offset"),
        delay=_value(entry, "delay"),
        temperature=entry.number("temperature", above=-273.15),
        validate=held_out,
        read_as=ReadAs(
            columns=_texts(entry, "columns"),
            units=_texts(entry, "units"),
            rate=entry.number("rate", above=0),
            test=entry.text("test") if "test" in entry.value else None,
            motor=entry.text("motor") if "motor" in entry.value else None,
            per_turn=entry.number("per_turn", above=0),
            counts=entry.number("counts", above=0),
            supply=entry.text("supply") if "supply" in entry.value else None,
        ),
        begin=entry.choice("begin", BEGINS, default="") or None if "begin" in entry.value else None,
    )


def input_value(spec: InputSpec) -> Any:
    """Return an input as a case file says it."""
    if spec.is_plain:
        return spec.column
    value = {"column": spec.column, "fmu": spec.fmu, "times": spec.times}
    return {k: v for k, v in value.items() if v} | ({} if spec.between == "held" else {"between": spec.between})


def output_value(spec: OutputSpec) -> Any:
    """Return an output as a case file says it."""
    if spec == OutputSpec(spec.column):
        return spec.column
    value: dict[str, Any] = {"column": spec.column}
    value |= {} if spec.sensor == "auto" else {"sensor": spec.sensor}
    value |= {k: v for k in ("fmu", "integral") if (v := getattr(spec, k))}
    numbers = ("counts", "average", "gain", "offset", "delay", "quantum")
    value |= {k: v for k in numbers if (v := getattr(spec, k)) is not None}
    value |= {k: _filter_value(v) for k in ("filter", "both") if (v := getattr(spec, k)) is not None}
    return value


def run_value(spec: RunSpec) -> dict[str, Any]:
    """Return what a case file says of a recording beside its file."""
    value: dict[str, Any] = {}
    value |= {} if spec.window is None else {"window": list(spec.window)}
    value |= {k: dict(v) for k in ("scale", "offset") if (v := getattr(spec, k))}
    value |= {k: v for k in ("delay", "temperature") if (v := getattr(spec, k)) is not None}
    value |= {k: dict(v) for k in ("columns", "units") if (v := getattr(spec.read_as, k))}
    value |= {} if spec.begin is None else {"begin": spec.begin}
    value |= {k: v for k in READING_KEYS[2:] if (v := getattr(spec.read_as, k)) is not None}
    return value | ({"validate": True} if spec.validate else {})


def _filter(table: Table) -> Filter:
    table.only(*FAMILIES, "coefficients")
    if len(table.keys) != 1:
        table.fail((), f"{table.title} needs one filter, such as {{ butterworth = {{ order = 2, cutoff = 50 }} }}")
    family = table.keys[0]
    inner = table.table(family)
    if family == "coefficients":
        inner.only("b", "a")
        return Coefficients(b=_coefficients(inner, "b"), a=_coefficients(inner, "a"))
    needed = ("order", *FAMILIES[family], "cutoff")
    inner.only(*needed)
    usual = {"order": 3, "ripple": 0.5, "attenuation": 40, "cutoff": 50}
    for name in needed:
        if name not in inner.value:
            example = ", ".join(f"{key} = {usual[key]}" for key in needed)
            inner.fail((), f"{inner.title} has no {name}; write {{ {example} }}")
    order = inner.integer("order", minimum=1, maximum=MAX_ORDER) or 0
    cutoff = inner.number("cutoff", above=0) or 0.0
    ripple, attenuation = (inner.number(k, above=0) for k in ("ripple", "attenuation"))
    if family == "chebyshev1":
        return Chebyshev1(order=order, ripple=ripple or 0.0, cutoff=cutoff)
    return LowPass(family, order=order, cutoff=cutoff, ripple=ripple, attenuation=attenuation)


def _filter_value(spec: Filter) -> dict[str, Any]:
    if isinstance(spec, Coefficients):
        return {"coefficients": {"b": list(spec.b), "a": list(spec.a)}}
    names = ("order", *FAMILIES[spec.family], "cutoff")
    return {spec.family: {name: getattr(spec, name) for name in names}}


def _coefficients(table: Table, key: str) -> tuple[float, ...]:
    values = table.value.get(key)
    if not isinstance(values, list) or not values or not all(_is_number(value) for value in values):
        table.fail(
            (key,) if key in table.value else (), f"{table.full(key)} must be a list of numbers, such as [0.1, 0.1]"
        )
    from estimator.recordings.sensors import transfer_sections

    coefficients = tuple(float(value) for value in values)
    if key == "a":
        try:
            transfer_sections((1.0,), coefficients)
        except ValueError as error:
            table.fail((key,), f"{table.full(key)}: {error}; take a stable filter's")
    return coefficients


def _average(table: Table) -> int | None:
    return table.integer("average", minimum=1, maximum=MAX_AVERAGE)


def _value(table: Table, key: str, *, above: float | None = None) -> Value:
    if table.value.get(key) == FREE:
        return FREE
    if isinstance(table.value.get(key), str) and not _is_number(table.value[key]):
        table.fail((key,), f'{table.full(key)} must be a number, or "free" to estimate it')
    return table.number(key, above=above)


def _numbers(table: Table, key: str) -> dict[str, float]:
    if key not in table.value:
        return {}
    inner = table.table(key)
    return {name: inner.required_number(name) for name in inner.keys}


def _texts(entry: Table, key: str) -> dict[str, str]:
    if key not in entry.value:
        return {}
    inner = entry.table(key)
    return {name: inner.text(name) for name in inner.keys}


def _is_number(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    try:
        return abs(float(value)) < float("inf")
    except (TypeError, ValueError):
        return False
