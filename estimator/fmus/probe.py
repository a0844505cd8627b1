"""How an FMU behaves, found out in worker processes: runs, repeats, resets, steps. Knows no case and no search.

Whatever the FMU does, crash or hang included, becomes a finding. What is found decides how the FMU is driven:

    reset              fmi2Reset between two simulations, where that was seen to lead back to the beginning
    re-instantiate     a new instance for every simulation, where a new instance was seen to begin afresh
    fresh process      a process of its own for every simulation, for everything else
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from estimator.errors import FmuError
from estimator.fmus.fmu import FmuDescription, check_usable, describe, with_kind
from estimator.fmus.probe_stages import Stages, Stopped
from estimator.fmus.run_folder import RunFolder
from estimator.stepping.library import check_installed

RESET, REINSTANTIATE, FRESH_PROCESS = "reset", "re-instantiate", "fresh process"
LIMIT = 40.0  # s of all stages
LARGE_CHANGE = 1e-3  # of a signal's span, from step h to h/10
LARGE_DISTANCE = 1e-2  # of a signal's span, between the two kinds of one FMU
LONG_RUN, LEAST_STEPS = 0.5, 10  # s
LONGER, LONGEST = 10, 4  # times longer, and how often, where nothing moves and no stop time is stated


@dataclass(frozen=True)
class Probe:
    """What was found.

    Attributes
    ----------
    runs : bool
    problem : why it does not run, in one sentence; "" if it does
    hopeless : no other values could help: it cannot be loaded, gives no instance, crashes or hangs
    restart : how to begin again: "reset", "re-instantiate" or "fresh process"
    seconds, steps, step : s that one run took, its communication steps, s of each
    repeats, reset, reinstantiates, apart : whether it does; None: not found out
    parameters : name → "taken", "no effect", "ignored", "refused" or "not tried"
    honours_step : whether a finer step is taken; None: not found out
    step_change : largest change from step h to h/10, of a signal's span; None: not found out
    findings : sentences
    simulations : runs done
    last, span : what its outputs read at the end of a run, and how far they moved in it; None: not finite
    """

    runs: bool
    problem: str = ""
    hopeless: bool = False
    restart: str = RESET
    seconds: float | None = None
    steps: int = 0
    step: float | None = None
    repeats: bool | None = None
    reset: bool | None = None
    reinstantiates: bool | None = None
    apart: bool | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    honours_step: bool | None = None
    step_change: float | None = None
    findings: tuple[str, ...] = ()
    simulations: int = 0
    last: tuple[float | None, ...] = ()
    span: tuple[float | None, ...] = ()


def disagreement(probes: Mapping[str, Probe]) -> str:
    """Return a sentence where both kinds of an FMU ran the same time and ended at different outputs; else nothing."""
    ran = [p for p in probes.values() if p.runs]
    if len(ran) < 2 or (ran[0].steps, ran[0].step) != (ran[1].steps, ran[1].step):
        return ""
    apart = 0.0
    for x, y, *spans in zip(ran[0].last, ran[1].last, ran[0].span, ran[1].span, strict=False):
        known = [s for s in spans if s is not None]
        if x is not None and y is not None and known and max(known) > 0:
            apart = max(apart, abs(x - y) / max(known))
    if apart <= LARGE_DISTANCE:
        return ""
    return (
        f"the two kinds do not agree: after {ran[0].steps * (ran[0].step or 0.0):.4g} s their outputs lie"
        f" {100 * apart:.2g} % of their range apart; the solver inside the co-simulation may be coarse, so try a finer"
        " step, or model-exchange"
    )


@cache
def bundled_model(name: str) -> FmuDescription:
    """Return the description of a bundled model; that its FMU is that of its sources is looked at once."""
    return describe(name)


def driven(description: FmuDescription) -> FmuDescription:
    """Return the description with the way in which the FMU is to be driven.

    A bundled model is trusted. Another one runs twice; where `reset` then does not lead back, a few times more. An FMU
    that does not even run by itself keeps what it promises: the search will tell.

    Raises
    ------
    FmuError
        The FMU cannot be simulated on this machine.
    """
    if description.is_bundled:
        return description
    check_usable(description)
    stamp = description.path.stat()
    key = (description.path, stamp.st_mtime_ns, stamp.st_size, description.kind)
    if key not in _KNOWN:
        _KNOWN[key] = probe(description, thorough=False)
    found = _KNOWN[key]
    if found.hopeless:
        needs = description.capabilities.get("needsExecutionTool")
        tool = f"; it needs its tool, {description.generation_tool}, to be installed and running" if needs else ""
        raise FmuError(f"{description.path.name} cannot be used: {found.problem}{tool}")
    return dataclasses.replace(description, restart=found.restart, probe_simulations=found.simulations)


_KNOWN: dict[Any, Probe] = {}


def probe(description: FmuDescription, *, thorough: bool = True, limit: float = LIMIT) -> Probe:
    """Probe an FMU.

    Parameters
    ----------
    thorough : bool
        All stages; otherwise only those that decide how it is driven.
    limit : float
        s for everything.
    """
    check_installed()
    try:
        check_usable(description)
        with RunFolder() as folder, Stages(description, folder, until=time.monotonic() + limit) as owner:
            return _Conclusion(description, owner).draw(thorough=thorough)
    except FmuError as error:
        return Probe(False, problem=str(error), hopeless=True)
    except OSError as error:
        return Probe(False, problem=f"it cannot be extracted: {error.strerror or error}", hopeless=True)


def probe_kinds(description: FmuDescription, kinds: Sequence[str], *, limit: float) -> dict[str, Probe]:
    """Probe an FMU as each of the kinds, one after the other, in `limit` s in all."""
    until = time.monotonic() + limit
    found = {}
    for k, kind in enumerate(kinds):
        share = max(0.0, until - time.monotonic()) / (len(kinds) - k)
        found[kind] = probe(with_kind(description, kind) if description.kinds else description, limit=min(LIMIT, share))
    return found


def ignores_step(description: FmuDescription) -> bool:
    """Whether an FMU that runs was seen to give the same samples at a ten times finer step."""
    until = time.monotonic() + LIMIT
    with RunFolder() as folder, Stages(description, folder, until=until) as owner, contextlib.suppress(Stopped):
        return bool(owner.stage("step_size").get("ignored"))
    return False


class _Conclusion:
    """From stages to findings."""

    def __init__(self, description: FmuDescription, owner: Stages) -> None:
        self.description, self.owner = description, owner
        self.findings: list[str] = []
        self.facts: dict[str, Any] = {"simulations": 0}

    def draw(self, *, thorough: bool) -> Probe:
        """Run the stages, one after the other."""
        once = self.description.capabilities.get("canBeInstantiatedOnlyOncePerProcess", False)
        try:
            first = self._try("run")
        except Stopped as stop:
            return Probe(False, problem=f"it does not run: {stop}", hopeless=True)
        if "refused" in first:
            none = first["refused"].startswith("instantiate")
            return Probe(False, problem=f"it does not run: {first['refused']}", hopeless=none)
        first = self._long_enough(first)
        steps, h = int(first["steps"]), self.owner.order["h"]
        self.owner.order["steps"] = steps
        if first["seconds"] > LONG_RUN:  # the other stages run a part of it only
            self.owner.order["steps"] = max(1, min(steps, LEAST_STEPS), int(steps * LONG_RUN / first["seconds"]))
            self.owner.end()
        self.facts |= {"last": tuple(first["last"]), "span": tuple(first["span"])}
        self.facts |= {"seconds": float(first["seconds"]), "steps": steps, "step": h}
        if first["stopped"]:
            self.findings.append(f"it runs for {steps * h:.4g} s only: {first['stopped']}")
        elif steps * h < self.owner.order["horizon"] - 0.5 * h:
            self.findings.append(f"it is slow: {steps * h:.3g} s took {first['seconds']:.2g} s; the rest was not tried")
        if not first["finite"]:
            self.findings.append("with its start values an output becomes infinite or not a number")
        if not first["moves"]:
            self.findings.append(f"with its start values no output moves within {steps * h:.4g} s")
        reset = self._honoured("reset")
        if reset is not True and self._is_volatile(first):
            reset = self._honoured("reset")
        self.facts["reset"] = reset
        if reset is not True:
            self.owner.end()
            self.facts["reinstantiates"] = None if once else self._honoured("reinstantiate")
            self.owner.end()
        restart = RESET if reset else REINSTANTIATE if self.facts.get("reinstantiates") else FRESH_PROCESS
        self.facts["restart"] = restart
        if not reset:
            way = {REINSTANTIATE: "a new instance is made", FRESH_PROCESS: "a process of its own is started"}[restart]
            self.findings.append(f"for every simulation {way}, since reset does not lead back to the beginning")
        if (thorough or restart == FRESH_PROCESS) and "repeats" not in self.facts:
            self._repeats(first)
        if thorough:
            self._thorough(once)
        return Probe(runs=True, findings=tuple(self.findings), **self.facts)

    def _long_enough(self, first: dict[str, Any]) -> dict[str, Any]:
        """Run longer, in longer steps, where nothing moves and the FMU does not say how long a run is."""
        stated = self.description.default_experiment
        order = self.owner.order
        for _ in range(LONGEST if stated["stop_time"] is None and stated["step_size"] is None else 0):
            if first["moves"] or first["stopped"]:
                break
            self.owner.end()
            kept = order["h"], order["horizon"]
            order["h"], order["horizon"] = LONGER * order["h"], LONGER * order["horizon"]
            try:
                longer = self._try("run")
            except Stopped:
                longer = {"refused": ""}
            if "refused" in longer or longer["stopped"] or not longer["finite"]:
                order["h"], order["horizon"] = kept
                self.owner.end()
                break
            first = longer
        return first

    def _is_volatile(self, first: Mapping[str, Any]) -> bool:
        """Find outputs that are different in every run, such as a clock of the computer; the others are compared."""
        self._repeats(first)
        return bool(self.owner.order.get("volatile"))

    def _repeats(self, first: Mapping[str, Any]) -> None:
        self.owner.end()
        try:
            again = self._try("run")
        except Stopped:
            again = {}
        if self.owner.order["steps"] < first["steps"] and again:
            first = again
            self.owner.end()
            with contextlib.suppress(Stopped):
                again = self._try("run")
        digest, other = first["digest"], again.get("digest", ())
        differ = [j for j, (x, y) in enumerate(zip(digest, other, strict=False)) if x != y]
        alike = len(other) == len(digest) and again.get("steps") == first["steps"]
        self.facts["repeats"] = alike and (not differ or len(differ) < len(digest))
        if alike and differ and self.facts["repeats"]:
            self.owner.order["volatile"] = differ
            names = ", ".join(self.owner.order["shown"][j] for j in differ)
            self.findings.append(
                f"{names} differ{'s' if len(differ) == 1 else ''} from run to run; the other outputs repeat"
            )
        elif not self.facts["repeats"]:
            self.findings.append("it does not repeat itself: two first runs in fresh processes differ")
        self.owner.end()

    def _thorough(self, once: bool) -> None:
        if not once and self.description.is_fast:
            self._apart()
        self.owner.end()
        if not once:
            self._parameters()
            self.owner.end()
            self._step()

    def _apart(self) -> None:
        try:
            found = self._try("apart")
        except Stopped as stop:
            self.findings.append(f"two instances in one process fail: {stop}")
            self.facts["apart"] = False
            return
        if found.get("second") is False or "refused" in found:
            self.findings.append("a second instance in one process is refused")
        elif not found["honoured"]:
            self.facts["apart"] = False
            self.findings.append("two instances in one process disturb each other")
        else:
            self.facts["apart"] = True

    def _parameters(self) -> None:
        names = self.owner.order["names"]
        try:
            found = self._try("parameters")
        except Stopped as stop:
            self.findings.append(f"its parameters could not all be tried: {stop}")
            return
        answers = dict(zip(names, found.get("answers", ()), strict=False))
        if len(answers) < len(names):
            self.findings.append(f"only {len(answers)} of its {len(names)} parameters could be tried in the time")
        self.facts["parameters"] = answers
        self.facts["simulations"] += len(answers)
        for answer, sentence in (
            ("refused", "it does not run with a value 10 % off for {}"),
            ("ignored", "it ignores what is set for {}"),
            ("no effect", "no output moves when 10 % is added to {}"),
        ):
            those = [name for name, a in answers.items() if a == answer]
            if those:
                self.findings.append(sentence.format(", ".join(those)))

    def _step(self) -> None:
        h = self.owner.order["h"]
        try:
            found = self._try("step_size")
        except Stopped as stop:
            self.findings.append(f"at a ten times finer step it fails: {stop}")
            return
        if "refused" in found:
            self.facts["honours_step"] = False
            self.findings.append(f"it refuses a step finer than {h:g} s: {found['refused']}")
        elif found.get("ignored"):
            self.facts["honours_step"] = False
            self.findings.append(
                f"it ignores the step that it is given: {h / 10:g} s and {h:g} s give the same samples"
            )
        elif found["moves"]:
            self.facts |= {"honours_step": True, "step_change": found["change"]}
            if found["change"] is None or found["change"] > LARGE_CHANGE:
                size = (
                    "without limit" if found["change"] is None else f"by {100 * found['change']:.2g} % of their range"
                )
                other = {"co-simulation": "model-exchange"}.get(self.description.kind, "")
                choose = f", or choose {other}" if other in self.description.kinds else ""
                self.findings.append(
                    f"its outputs change {size} from a step of {h:g} s to {h / 10:g} s; set a fine step under [fmu]"
                    f"{choose}"
                )

    def _honoured(self, stage: str) -> bool | None:
        try:
            found = self._try(stage)
        except Stopped as stop:
            self.findings.append(f"{stage} fails: {stop}")
            return False
        if "refused" in found:
            self.findings.append(f"{stage} fails: {found['refused']}")
        return bool(found.get("honoured", False))

    def _try(self, stage: str) -> dict[str, Any]:
        self.facts["simulations"] += {"run": 1, "reset": 2, "reinstantiate": 3, "apart": 2, "step_size": 1}.get(
            stage, 0
        )
        return self.owner.stage(stage)
