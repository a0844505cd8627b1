"""What to estimate, from what, through which FMU, as a case file (TOML) says it. Opens no FMU and no recording.

Strict: a key that is not known is an error with the nearest right one, every value is checked, and every
message names the file and the line. One file may mean many cases: one for each recording that a pattern such as
``motor_*.csv`` matches, and one for each row of a table of motors (expansion.py).
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from estimator.cases import keys
from estimator.cases.case_signals import (
    HELD,
    INPUT,
    JUMPING,
    LINEAR,
    OUTPUT,
    RECORDING,
    OutputSpec,
    RunSpec,
    read_input,
    read_output,
    read_run,
)
from estimator.cases.expansion import MOTORS, expanded, told_apart
from estimator.cases.expectation import (
    ENTRY,
    EXPECT,
    LIMITS,
    Expectation,
    Limits,
    read_expectation,
    read_limits,
)
from estimator.cases.keys import Key, Keys
from estimator.cases.nameplate import NAMEPLATE, Nameplate, read_nameplate
from estimator.cases.starts import STARTS, Start
from estimator.cases.strict_toml import Cell, Document, Table, Way
from estimator.cases.tolerance import TOLERANCE, Tolerance, read_tolerances
from estimator.choices import FMI_KINDS, LOSSES
from estimator.errors import CaseError
from estimator.locked import Locked
from estimator.method_names import CUCKOO, METHODS
from estimator.recordings.filters import Chebyshev1

MOST_SEARCHED = 1_000_000  # nests, and generations: more are a slip, and nests are held in memory
BUNDLED_FMU = "dc_motor"
__all__ = ["Chebyshev1", "Expectation", "OutputSpec", "RunSpec"]  # of others, for who takes a case


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter to estimate; None where the case says nothing. ``PARAMETER`` says what each is."""

    name: str
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    start: float | None = None
    fmu: tuple[str, ...] = ()  # variables of the FMU that take the value; by default the one of the same name
    gains: tuple[float, ...] = ()  # of each variable: its value over the parameter's; empty: 1
    per_recording: bool = False  # a value of its own for each recording

    def __post_init__(self) -> None:
        """Fill in where the value goes."""
        if not self.fmu:
            object.__setattr__(self, "fmu", (self.name,))

    @property
    def targets(self) -> tuple[str, ...] | dict[str, float] | None:
        """The variables that take the value, with their factors if it has any; None: the one of its name."""
        if self.gains:
            return dict(zip(self.fmu, self.gains, strict=True))
        return None if self.fmu == (self.name,) else self.fmu


@dataclass(frozen=True)
class SearchSpec:
    """How to search."""

    method: str = CUCKOO
    seed: int = 1
    nests: int | None = None  # None: the method's own
    iterations: int | None = None
    loss: str = "linear"  # of the residuals in the polish: "huber" lets outliers pull less
    starts: tuple[Start, ...] = ()  # further ones, each polished beside the search: values, or files of them


@dataclass(frozen=True)
class Case(Locked):
    """What to estimate, from what, through which FMU."""

    path: Path | None = field(default=None, compare=False)
    fmu: str = BUNDLED_FMU  # a bundled model's name, or an absolute path
    step: float | None = None  # s, communication step; None: the recording's sampling interval
    kind: str | None = None  # "co-simulation" or "model-exchange"; None: co-simulation where the FMU offers it
    inputs: Mapping[str, str] = field(default_factory=dict)  # FMU input → column; empty: by the usual names
    input_variables: Mapping[str, str] = field(default_factory=dict)  # input → variable of the FMU, if not its name
    products: Mapping[str, str] = field(default_factory=dict)  # input → column that its own is multiplied with
    linear: tuple[str, ...] = ()  # inputs that go linearly from row to row
    jumping: tuple[str, ...] = ()  # those of them that stand where they are until the row at which they jump
    held: tuple[str, ...] = ()  # inputs that are said to be held from row to row, as all others are that are not linear
    outputs: Mapping[str, OutputSpec] = field(default_factory=dict)  # FMU output → column; empty: usual names
    parameters: Mapping[str, ParameterSpec] = field(default_factory=dict)  # empty: what the FMU offers
    fixed: Mapping[str, float] = field(default_factory=dict)  # FMU parameter or input → value
    fixed_texts: Mapping[str, str] = field(default_factory=dict)  # FMU parameter → text, or item of an enumeration
    recordings: tuple[Path, ...] = ()  # absolute
    runs: tuple[RunSpec, ...] = ()  # what is said of each recording; the last holds for all that follow
    search: SearchSpec = SearchSpec()
    expect: Mapping[str, Expectation] = field(default_factory=dict)  # of the parameters
    limits: Limits = Limits()  # what is expected of the estimate as a whole
    nameplate: Nameplate | None = None
    tolerance: tuple[Tolerance, ...] = ()  # what no recording can tell
    motor: str = ""  # which row of the table of motors
    recording_of: str = ""  # which recording of a pattern's; "" if the file names its recordings
    about: Mapping[str, str] = field(default_factory=dict)  # for the report: motor, operator, date, …

    @property
    def name(self) -> str:
        """What the case is called: the file's stem, then what tells it from the file's others."""
        stem = self.path.name if self.path else self.recordings[0].stem if self.recordings else "case"
        stem = stem.removesuffix(".toml").removesuffix(".case")
        inside = ",".join(part for part in (self.motor, self.recording_of) if part)
        return f"{stem}[{inside}]" if inside else stem

    def run(self, recording: int) -> RunSpec:
        """Return what is said of a recording."""
        return self.runs[min(recording, len(self.runs) - 1)] if self.runs else RunSpec()

    def runs_of(self, count: int) -> tuple[RunSpec, ...]:
        """Return what is said of each of so many recordings."""
        return tuple(self.run(k) for k in range(count))


def case_for_recording(recording_path: Path, *, fmu: str = BUNDLED_FMU) -> Case:
    """Return the case of a bare recording: columns by their usual names, everything else by default."""
    return Case(fmu=fmu, recordings=(Path(os.path.abspath(recording_path)),))


def read_case(path: Path) -> Case:
    """Read a case file that means one case.

    Raises
    ------
    CaseError
        One sentence: the file, the line, what is wrong there, and what would be right.
    """
    cases = read_cases(path)
    if len(cases) > 1:
        raise CaseError(f"{Path(path).name} means {len(cases)} cases; run them with the command batch, or by pytest")
    return cases[0]


def read_cases(path: Path, *, recordings: Path | None = None, there_only: bool = False) -> tuple[Case, ...]:
    """Read a case file: one case, or one for each row of its table of motors and each recording of its pattern.

    Parameters
    ----------
    recordings : path, optional
        A folder in which the recordings are, instead of where the file says.
    there_only : bool
        Leave out cases whose recordings are not there, or not yet; there may be none then.

    Raises
    ------
    CaseError
        One sentence: the file, the line, what is wrong there, and what would be right.
    """
    path = Path(path)
    document = Document(path)
    document.table().only(*FILE)
    cases: list[Case] = []
    for motor, filled in expanded(document):
        for files, runs, recording_of in _recordings(filled.table(), recordings, there_only=there_only):
            cases.append(_case(filled, motor=motor, files=files, runs=runs, recording_of=recording_of))
    return tuple(cases)


def _case(
    document: Document, *, motor: str, files: tuple[Path, ...], runs: tuple[RunSpec, ...], recording_of: str
) -> Case:
    top = document.table()
    fmu = top.table("fmu")
    fmu.only(*FMU)
    parameters = {name: _parameter(top.table("parameters").table(name)) for name in top.table("parameters").keys}
    expect, fixed, about = top.table("expect"), top.table("fixed"), top.table("about")
    inputs = {name: read_input(top.table("inputs"), name) for name in top.table("inputs").keys}
    case = Case(
        path=document.path,
        **{"fmu": BUNDLED_FMU, **FMU.read(fmu)},
        inputs={name: spec.column for name, spec in inputs.items()},
        input_variables={name: spec.fmu for name, spec in inputs.items() if spec.fmu},
        products={name: spec.times for name, spec in inputs.items() if spec.times},
        linear=tuple(name for name, spec in inputs.items() if spec.between in (LINEAR, JUMPING)),
        jumping=tuple(name for name, spec in inputs.items() if spec.between == JUMPING),
        held=tuple(name for name, spec in inputs.items() if spec.between == HELD),
        outputs={name: read_output(top.table("outputs"), name) for name in top.table("outputs").keys},
        parameters=parameters,
        fixed={name: _held(fixed, name) for name in fixed.keys if not _is_text(fixed.value[name])},
        fixed_texts={name: fixed.text(name) for name in fixed.keys if _is_text(fixed.value[name])},
        recordings=files,
        runs=runs if any(run != RunSpec() for run in runs) else (),
        search=SearchSpec(**SEARCH.checked(top.table("search"))),
        expect={name: _expectation(expect, name, parameters) for name in expect.keys if name not in LIMITS},
        limits=read_limits(expect),
        nameplate=read_nameplate(top.table("nameplate")) if "nameplate" in top.value else None,
        tolerance=read_tolerances(top),
        motor=motor,
        recording_of=recording_of,
        about={name: _said(about, name) for name in about.keys},
    )
    _check_destinations(case, document)
    return case


def _fmu_path(fmu: Table, key: str) -> str:
    text = fmu.text(key)
    return str(fmu.file(key, what="FMU")) if is_file_name(text) else text


def is_file_name(text: str) -> bool:
    """Tell a file from a bundled model's name."""
    return text.endswith(".fmu") or "/" in text or "\\" in text


def _recordings(
    top: Table, folder: Path | None, *, there_only: bool
) -> list[tuple[tuple[Path, ...], tuple[RunSpec, ...], str]]:
    """Return the recordings of each case: those named, or one that matches the pattern and what to call it."""
    entries = top.value.get("recording")
    if entries is None:
        top.fail((), 'no recording is given; add [[recording]] with file = "…"')
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        top.fail(("recording",), 'recording must be written [[recording]], in double brackets, with file = "…"')
    files: list[Path] = []
    runs: list[RunSpec] = []
    for k in range(len(entries)):
        entry = Table(top.document, ("recording", k), entries[k])
        run = read_run(entry)
        if there_only and not entry.has_files("file", folder=folder):
            return []
        if entry.is_pattern("file", folder=folder):
            if len(entries) > 1:
                entry.fail(
                    ("file",),
                    f"the pattern {entry.value['file']!r} stands beside other recordings; each file that it matches"
                    " is a case of its own, so leave the others out",
                )
            found = entry.files("file", what="recording", folder=folder)
            if run.validate:
                entry.fail(("validate",), "a pattern's files are cases of their own; name the recording to validate on")
            return [((file,), (run,), name) for file, name in zip(found, told_apart(found), strict=True)]
        file = entry.file("file", what="recording", folder=folder)
        if file in files:
            entry.fail(("file",), f"the recording {entry.value['file']!r} is given twice; leave one out")
        files.append(file)
        runs.append(run)
    if not files:
        top.fail(("recording",), 'no recording is given; add [[recording]] with file = "…"')
    if all(run.validate for run in runs):
        top.fail(("recording", 0, "validate"), "every recording is held out to validate on; leave one to fit to")
    return [(tuple(files), tuple(runs), "")]


def _is_text(value: Any) -> bool:
    """Tell an enumeration's item from a number in quotes."""
    if not isinstance(value, str) or isinstance(value, Cell) or not value.strip():
        return False
    try:
        float(value)
    except ValueError:
        return True
    return False


def _held(fixed: Table, name: str) -> float:
    value = fixed.value[name]
    return value if isinstance(value, bool) else fixed.required_number(name)


def _parameter(table: Table) -> ParameterSpec:
    said = PARAMETER.checked(table)
    low, high, start = (said.get(name) for name in ("minimum", "maximum", "start"))
    if low is not None and high is not None and low >= high:
        table.fail(("min",), f"{table.title} has min {low:g} and max {high:g}; min must be the smaller one")
    if start is not None and not (low is None or start >= low):
        table.fail(("start",), f"{table.title} starts at {start:g}, below its min {low:g}; start within the bounds")
    if start is not None and not (high is None or start <= high):
        table.fail(("start",), f"{table.title} starts at {start:g}, above its max {high:g}; start within the bounds")
    targets = said.pop("targets", ())
    gains = tuple(targets.values()) if isinstance(targets, dict) else ()
    return ParameterSpec(str(table.way[-1]), fmu=tuple(targets), gains=gains, **said)


def _targets(table: Table, key: str) -> tuple[str, ...] | dict[str, float]:
    """Return the variables of the FMU; with their factors where they are written ``fmu = { Ke = 1, Km = 1.05 }``."""
    if not isinstance(table.value[key], dict):
        return table.texts(key)
    factors = table.table(key)
    if not factors.keys:
        table.fail((key,), f"{factors.title} is empty; write {{ Ke = 1, Km = 1 }}: variables and their factors")
    gains = {name: factors.required_number(name) for name in factors.keys}
    for name, gain in gains.items():
        if gain == 0:
            factors.fail(
                (name,), f"{factors.full(name)} is 0, so {name!r} would not follow the parameter; leave it out"
            )
    return gains


def _expectation(expect: Table, name: str, parameters: Mapping[str, ParameterSpec]) -> Expectation:
    table = expect.table(name)
    table.only(*ENTRY)
    spec = parameters.get(name)
    nominal = None if spec is None else spec.nominal
    return read_expectation(table, nominal=nominal, remedy=f", or a nominal to parameters.{name}")


def _check_destinations(case: Case, document: Document) -> None:
    """Refuse a variable of the FMU that would be given twice."""
    given: dict[str, str] = {}

    def give(variable: str, by: str, at: Way) -> None:
        if variable in given:
            document.fail(at, f"{variable!r} is given by {given[variable]} and by {by}; leave one out")
        given[variable] = by

    for name in case.inputs:
        give(case.input_variables.get(name, name), "[inputs]", ("inputs", name))
    for name, spec in case.parameters.items():
        for variable in spec.fmu:
            give(variable, f"parameters.{name}", ("parameters", name, "fmu"))
    for name in (*case.fixed, *case.fixed_texts):
        if name in case.parameters and name not in given:
            document.fail(("fixed", name), f"{name!r} is both estimated (parameters.{name}) and fixed; leave one out")
        give(name, "[fixed]", ("fixed", name))


def _said(about: Table, name: str) -> str:
    """Return a text for the report; a date may stand without quotes."""
    value = about.value[name]
    return str(value) if isinstance(value, datetime.date) else about.text(name)


FMU = Keys(
    Case,
    path=Key(_fmu_path, keys.text("a bundled model's name, or a file").schema, field="fmu"),
    step=keys.number("communication step, s; default: the recording's sampling interval", above=0),
    kind=keys.choice(FMI_KINDS, "default: co-simulation where the FMU offers it"),
)
PARAMETER = Keys(
    ParameterSpec,
    min=keys.number("smallest value of the search").in_field("minimum"),
    max=keys.number("greatest value of the search").in_field("maximum"),
    nominal=keys.number("what the data sheet says, for comparison"),
    start=keys.number("where the search begins"),
    fmu=Key(
        _targets,
        {
            "anyOf": [
                keys.TEXT,
                {"type": "array", "items": keys.TEXT, "minItems": 1},
                {**keys.named(keys.number("factor"), "variable = factor").schema, "minProperties": 1},
            ],
            "description": "variables of the FMU that take the value; default: the parameter's own name",
        },
        lambda targets: targets if isinstance(targets, dict) else list(targets) if len(targets) > 1 else targets[0],
        field="targets",
    ),
    per_recording=keys.flag("a value of its own for each recording"),
)
SEARCH = Keys(
    SearchSpec,
    method=keys.choice(METHODS),
    seed=keys.whole("of the random numbers", minimum=0),
    nests=keys.whole("candidates a generation", minimum=2, maximum=MOST_SEARCHED),
    iterations=keys.whole("generations", minimum=1, maximum=MOST_SEARCHED),
    loss=keys.choice(LOSSES, "huber: outliers pull less"),
    starts=STARTS,
)
FILE: dict[str, Any] = {  # every key of the file → what a JSON Schema says of it
    "fmu": FMU.schema(),
    "inputs": keys.map_of(
        {"anyOf": [keys.text("column of the recording").schema, INPUT.schema()]}, "FMU input = column"
    ),
    "outputs": keys.map_of({"anyOf": [keys.TEXT, OUTPUT.schema()]}, "FMU output = column"),
    "parameters": keys.map_of(PARAMETER.schema(), "parameters to estimate"),
    "fixed": keys.map_of(
        {"anyOf": [keys.number("value").schema, {"type": "boolean"}, keys.TEXT]},
        "FMU parameters and inputs that are held",
    ),
    "recording": {"type": "array", "items": RECORDING.schema(), "minItems": 1},
    "motors": MOTORS.schema(),
    "search": SEARCH.schema(),
    "expect": EXPECT,
    "nameplate": NAMEPLATE.schema(),
    "tolerance": TOLERANCE,
    "about": keys.map_of({"type": "string"}, "motor, operator, date, … → text, for the report"),
}
