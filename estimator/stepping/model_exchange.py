"""Model exchange: an FMU's equations, integrated by CVode from one communication point to the next.

The inputs are held over a step, as in co-simulation; where they jump, that is an event: the FMU is told, and the
solver begins anew, so nothing is interpolated across the jump. Knows the life of an initialised instance only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

TOLERANCE = 1e-10  # relative; the absolute one is that times the states' nominal values
MAX_STEPS = 100_000  # of the solver, between two communication points
EVENT_ITERATIONS = 100
RECOVERABLE, UNRECOVERABLE = 1, -1  # of CVode, from a callback
AT_EVENT = 1e-12  # relative: an event this near is now


class Ended(Exception):
    """The FMU ended the simulation, or its events do not settle: an FMI status and words."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(words)
        self.status = status


class ModelExchange:
    """The equations of one FMU and their solver, which serves all its simulations.

    Parameters
    ----------
    fmu : fmpy's FMU1Model, FMU2Model or FMU3Model
    version : "1", "2" or "3"
    counts : continuous states and event indicators, as the description says
    """

    def __init__(self, fmu: Any, *, version: str, counts: tuple[int, int]) -> None:
        self.fmu, self.version, self.counts = fmu, version, counts
        self.solver: Any = None
        self.jumped = False  # since the last step; FMI 2.0 and 3.0 are in event mode then
        self.next_event: float | None = None

    def begin(self, start: float, event: Sequence[Any] | None = None) -> None:
        """Begin at `start`, s, with an instance that has just been initialised; `event`: what FMI 1.0 said to that."""
        self.next_event = None
        if event is not None:
            self._note(event)
        else:  # it is in event mode now
            self._settle()
            self.fmu.enterContinuousTimeMode()
        if self.solver is None:
            self.solver = self._new_solver(start)
        else:
            self.solver.reset(start)
        self.jumped = False

    def jump(self) -> None:
        """Let the inputs jump: they are set after this and before the next step."""
        if not self.jumped and self.version != "1":
            self.fmu.enterEventMode()
        self.jumped = True

    def step(self, time: float, end: float) -> None:
        """Integrate from `time` to `end`, s."""
        if self.jumped:
            self._event(time, entered=True)
        while time < end and not _near(time, end):
            goal = end
            if self.next_event is not None and time < self.next_event < end and not _near(self.next_event, end):
                goal = self.next_event
            root, _, time = self.solver.step(time, goal)
            self.fmu.setTime(time)
            wanted = self._completed()
            if wanted or root or (self.next_event is not None and _near(time, self.next_event)):
                self._event(time)

    def _completed(self) -> bool:
        """Tell the FMU that an integrator step is complete; return whether it wants an event."""
        answer = self.fmu.completedIntegratorStep()
        if isinstance(answer, tuple):
            answer, ended = answer
            if ended:
                raise Ended(2, "it ended the simulation")
        return bool(answer)

    def _event(self, time: float, *, entered: bool = False) -> None:
        if self.version == "1":
            self._note(self.fmu.eventUpdate())
        else:
            if not entered:
                self.fmu.enterEventMode()
            self._settle()
            self.fmu.enterContinuousTimeMode()
        self.solver.reset(time)
        self.jumped = False

    def _settle(self) -> None:
        """Iterate the discrete states of FMI 2.0 and 3.0 until they stay."""
        for _ in range(EVENT_ITERATIONS):
            found = self.fmu.updateDiscreteStates() if self.version == "3" else self.fmu.newDiscreteStates()
            again, ended, _, _, defined, at = found
            if ended:
                raise Ended(2, "it ended the simulation")
            self.next_event = at if defined else None
            if not again:
                return
        raise Ended(3, f"its discrete states do not settle in {EVENT_ITERATIONS} iterations")

    def _note(self, event: Sequence[Any]) -> None:
        """Take what FMI 1.0 says of an event."""
        _, _, _, ended, defined, at = event
        if ended:
            raise Ended(2, "it ended the simulation")
        self.next_event = at if defined else None

    def _new_solver(self, start: float) -> Any:
        fmu, (states, indicators) = self.fmu, self.counts
        if self.version == "3":
            states, indicators = fmu.getNumberOfContinuousStates(), fmu.getNumberOfEventIndicators()
        return _solver_class()(
            nx=states,
            nz=indicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=fmu.getContinuousStateDerivatives if self.version == "3" else fmu.getDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalContinuousStates if self.version == "1" else fmu.getNominalsOfContinuousStates,
            set_time=fmu.setTime,
            input=_Held(),
            startTime=start,
            relativeTolerance=TOLERANCE,
            maxNumSteps=MAX_STEPS,
        )


def _solver_class() -> Any:
    """Return fmpy's solver, with errors of the FMU that reach whoever steps."""
    from fmpy.sundials import CVodeSolver

    class Solver(CVodeSolver):  # type: ignore[misc]
        """CVode calls back through C, where an exception would be lost."""

        failure: Exception | None = None

        def f(self, t: float, y: Any, ydot: Any, user_data: Any) -> int:
            """Give the derivatives; a discarded call makes CVode try a shorter step."""
            return self._guarded(super().f, t, y, ydot, user_data)

        def g(self, t: float, y: Any, gout: Any, user_data: Any) -> int:
            """Give the event indicators."""
            return self._guarded(super().g, t, y, gout, user_data)

        def step(self, t: float, tNext: float) -> Any:  # noqa: N803 - fmpy's name
            """Step, and raise what the FMU raised."""
            self.failure = None
            try:
                return super().step(t, tNext)
            except RuntimeError as error:
                raise self.failure or error from None

        def _guarded(self, function: Any, *arguments: Any) -> int:
            try:
                return int(function(*arguments))
            except Exception as error:
                self.failure = error
                return RECOVERABLE if getattr(error, "status", 3) == 2 else UNRECOVERABLE

    return Solver


class _Held:
    """Inputs that are held: what fmpy's solver asks for at every root search."""

    def apply(self, _time: float) -> None:
        """Leave the inputs as they are."""


def _near(time: float, other: float) -> bool:
    return abs(time - other) <= AT_EVENT * max(abs(time), abs(other), 1e-3)
