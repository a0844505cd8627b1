"""A job as it travels to a worker process, and what came of a candidate. Knows neither ctypes nor fmpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

FAST_TYPES = ("Real", "Float64")  # that the stepping loop sets and gets
FINISHED, CUT_SHORT, FAILED, NOT_FINITE = range(4)  # as in stepper.c
CRASHED, TIMED_OUT, PENDING = 4, 5, 6  # found by the worker's owner, not by the stepper
PHASES = ("", "instantiate", "reset", "set", "set up", "initialise", "doStep", "read")
FMI_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
MAX_SIGNALS = 64  # inputs or outputs of a job, as in stepper.c
IDENTITY, MEAN = range(2)  # sensors, as in sensors.h
ASKS_NEW, ASKS_CORRECTED, ASKS_COST, ASKS_BENT, DONE, DONE_BESIDE = range(6)  # as in gauss_newton.h


@dataclass(frozen=True)
class ExperimentLayout:
    """One recording of a job; offsets are bytes into the job's memory."""

    samples: int
    substeps: int
    start: float  # s
    interval: float  # s
    inputs: int
    measured: int
    weights: int
    complete: bool
    chains: tuple[tuple[int, tuple[tuple[float, ...], ...]], ...] = ()  # of each output: average, filter sections
    times: int | None = None  # bytes into the job's memory; None: equidistant
    ends: int | None = None  # of inputs that go linearly, before the next row; None: what they are there


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What to set and what to read, by FMI value reference."""

    parameter_references: tuple[int, ...]
    input_references: tuple[int, ...]
    output_references: tuple[int, ...]
    sensors: tuple[int, ...]
    reinstantiate: bool = False
    sensor_values: int = 0  # that follow the parameters in a candidate's row: 0, or 1 + 3 an output
    even_steps: bool = False
    fresh_process: bool = False  # a process of its own for every simulation
    types: tuple[str, ...] = ()  # of parameters, inputs and outputs, one after the other; empty: all real
    settings: tuple[tuple[str, int, float | str], ...] = ()  # type, value reference, value: set every time
    scale: tuple[tuple[float, float], ...] = ()  # of each output: factor and offset from its unit to SI; empty: SI
    linear: tuple[bool, ...] = ()  # of each input: whether it goes linearly from row to row; empty: all are held


@dataclass(frozen=True, kw_only=True)
class JobLayout(Asked):
    """A job as it travels to a worker: everything but the numbers, which stand in shared memory."""

    folder: str
    identifier: str
    guid: str
    experiments: tuple[ExperimentLayout, ...]
    version: str = "2.0"
    kind: str = "co-simulation"
    interpolates: bool = False  # the FMU takes the slopes of its inputs
    counts: tuple[int, int] = (0, 0)  # continuous states and event indicators, for model exchange

    @property
    def is_fast(self) -> bool:
        """Whether the stepping loop calls the FMU's own functions; variables go by their value references then."""
        return all(t in FAST_TYPES for t in self.types)

    @property
    def needs_fmpy(self) -> bool:
        """Whether fmpy loads the FMU: the loop itself does co-simulation of FMI 2.0 and 3.0."""
        return not self.is_fast or self.kind != "co-simulation" or self.version.startswith("1")


@dataclass(frozen=True, kw_only=True)
class Placing:
    """Where parameters go in a job's candidates; ``fits.h`` says what each field means.

    `column`, `gain` and `shift` are of all values of a candidate, recording by recording.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    log: tuple[bool, ...]
    column: tuple[int, ...]
    gain: tuple[float, ...]
    shift: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class FitsLayout(Placing):
    """Whole least-squares fits of a job as they travel to a worker."""

    starts: tuple[tuple[float, ...], ...]
    evaluations: int
    ftol: float
    xtol: float
    least_step: float
    weights: tuple[float, ...]
    known: tuple[float, ...] | None = None
    known_cost: float = 0.0


@dataclass(frozen=True, kw_only=True)
class DescentLayout(Placing):
    """A descent as it travels to a worker; the weights of its samples stand in shared memory."""

    x: tuple[float, ...]
    iterations: int
    rounds: int
    fine: bool
    told: bool
    tolerance: float
    limit: float
    least_part: float
    most_part: float
    longest: tuple[float, ...]
    steps: tuple[float, ...]
    known: tuple[float, ...] | None = None
    bars: tuple[float, ...] | None = None
    known_cost: float = 0.0


def types_of(types: Sequence[str]) -> tuple[str, ...]:
    """Return the types of a job's variables; nothing if the stepping loop knows them all."""
    return () if all(t in FAST_TYPES for t in types) else tuple(types)


def positions(job: JobLayout) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Return the positions of a job's parameters, inputs and outputs among its variables."""
    p, q = len(job.parameter_references), len(job.parameter_references) + len(job.input_references)
    return tuple(range(p)), tuple(range(p, q)), tuple(range(q, q + len(job.output_references)))


def status_name(status: int) -> str:
    """Return the standard's name of an FMI status, or its number where it is none of the standard's."""
    return FMI_STATUS[status] if 0 <= status < len(FMI_STATUS) else f"the status {status}, which FMI does not know"


def outcome_sentence(outcome: int, *, words: str = "", names: Sequence[str] = ()) -> str:
    """Say what an outcome code means: "doStep returned Error: <the FMU's words>".

    Parameters
    ----------
    names : of the parameters, the settings and the inputs, one after the other
    """
    kind, phase, status, refused = outcome % 256, outcome >> 8 & 255, outcome >> 16 & 255, outcome >> 24
    if kind == FAILED:
        which = f" for {names[refused - 1]}" if 0 < refused <= len(names) else ""
        return f"{PHASES[phase]} returned {status_name(status)}{which}" + (f": {words}" if words else "")
    return {
        FINISHED: "finished",
        CUT_SHORT: "cut short",
        NOT_FINITE: "an output became infinite or not a number",
        CRASHED: "the FMU crashed",
        TIMED_OUT: "the FMU exceeded its time limit",
        PENDING: "not simulated",
    }[kind]


def is_of_step(outcome: int) -> bool:
    """Whether an outcome code says that a communication step failed."""
    return outcome % 256 == FAILED and PHASES[outcome >> 8 & 255] == "doStep"
