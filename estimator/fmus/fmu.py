"""An FMU as a file: what it says of itself. Executes nothing of it; knows no motor.

Of this package only this module and those of the worker processes (``fmu_instance.py``, ``slow_path.py``) know FMI and
fmpy.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from estimator.errors import FmuError, one_line, suggestion
from estimator.fmus.archive import check_archive, check_description
from estimator.fmus.variable import Variable, base_of, limit_of, number_of, start_of, variable_of

NAMES_SHOWN = 3  # in one sentence
MEANT = {  # by what fmpy stumbles over
    IndexError: "its ModelStructure names a variable that is not there",
    UnboundLocalError: "a variable of it has no type",
}

# FMI 2.0.4 and 3.0.2, section 2.2.9 and 2.4.7.5.1: the grammar of names.
_QUOTED = r"""'(?:[^'\\"\x00-\x1f]|\\['"?\\abfnrtv])+'"""
_PART = rf"(?:[A-Za-z_][A-Za-z0-9_]*|{_QUOTED})(?:\[\d+(?:,\d+)*\])?"
STRUCTURED_NAME = re.compile(rf"{_PART}(?:\.{_PART})*|der\({_PART}(?:\.{_PART})*(?:,\d+)?\)")
FLAT_NAME = re.compile(r"[^\r\n\t]*")


@dataclass(frozen=True)
class FmuDescription:
    """What an FMU says of itself.

    Attributes
    ----------
    path : Path
        The .fmu file.
    identifier : str or None
        Model identifier of the co-simulation part: the library's name.
    kinds : tuple of "co-simulation" and "model-exchange"
    platforms : tuple of str
        Platforms with a binary, and "c-code" where sources are inside.
    default_experiment : mapping of "start_time", "stop_time", "step_size", "tolerance" → s or None
    warnings : tuple of str
        What the validation of the description found.
    """

    path: Path
    name: str
    fmi_version: str
    model_name: str
    guid: str
    generation_tool: str
    identifier: str | None
    kinds: tuple[str, ...]
    platforms: tuple[str, ...]
    variables: tuple[Variable, ...]
    capabilities: Mapping[str, bool]
    default_experiment: Mapping[str, float | None]
    warnings: tuple[str, ...]
    description: str = ""
    model_exchange_identifier: str | None = None
    counts: tuple[int, int] = (0, 0)  # continuous states and event indicators
    unlisted: tuple[str, ...] = ()  # derivatives, where the structure names none: how many states there are is not said
    kind: str = "co-simulation"  # what is used; co-simulation where both are offered: the FMU then brings its solver
    restart: str = "reset"  # how it begins again: "reset", "re-instantiate" or "fresh process" (probe.py)
    probe_simulations: int = 0  # that it took to find out
    is_bundled: bool = False  # found by a bundled model's name
    capabilities_of: Mapping[str, Mapping[str, bool]] = field(default_factory=dict)  # of each kind

    @property
    def library(self) -> str | None:
        """Model identifier of the kind that is used."""
        return self.identifier if self.kind == "co-simulation" else self.model_exchange_identifier

    @property
    def is_fast(self) -> bool:
        """Whether the loop calls it as it is, without an adapter: co-simulation of FMI 2.0 or 3.0."""
        return self.kind == "co-simulation" and self.fmi_version[:1] in ("2", "3")

    @property
    def has_events(self) -> bool:
        """Whether its model changes within a step, as dry friction that catches: such steps cost several plain ones."""
        return self.counts[1] > 0

    def variable(self, name: str, *, role: str = "variable") -> Variable:
        """Return the variable of that name; `role` ("parameter", "input", "output", …) also bounds the suggestion.

        Raises
        ------
        FmuError
            There is none; the sentence suggests the nearest.
        """
        for variable in self.variables:
            if variable.name == name:
                return variable
        known = [v.name for v in self.variables if role == "variable" or v.causality == role]
        raise FmuError(f"{self.path.name} has no {role} {name!r}{suggestion(name, known)}")

    def of_causality(self, causality: str) -> tuple[Variable, ...]:
        """Return the variables of one causality, in the FMU's order."""
        return tuple(v for v in self.variables if v.causality == causality)


def find_fmu(fmu: str | Path) -> Path:
    """Return the path of an FMU given as a file or as the name of a bundled model.

    Raises
    ------
    FmuError
        No such file and no such model.
    """
    path = Path(fmu)
    if path.is_file():
        return path
    text = str(fmu)
    import fmu_build

    if text in fmu_build.bundled_names():
        try:
            known = _bundled(text)
            return known if known.is_file() else fmu_build.bundled(text)
        except fmu_build.BuildError as error:
            raise FmuError(f"the bundled model {text!r} cannot be built: {error}") from error
    if path.is_dir():
        raise FmuError(f"{fmu} is a folder, not an FMU; give the .fmu file")
    if path.suffix == ".fmu" or len(path.parts) > 1:
        raise FmuError(f"{fmu}: no such file; give an .fmu file or a bundled model's name")
    raise FmuError(f"no FMU {text!r}: no such file, and no bundled model{suggestion(text, fmu_build.bundled_names())}")


@cache
def _bundled(name: str) -> Path:
    """Return the path of a bundled model's FMU; that it is that of its sources is looked at once."""
    import fmu_build

    return fmu_build.bundled(name)


def describe(fmu: str | Path, *, validate: bool = False) -> FmuDescription:
    """Read an FMU's model description. Nothing of the FMU is executed.

    Parameters
    ----------
    fmu : str or Path
        A file, or a bundled model's name.
    validate : bool
        Also check the description against the standard's schema and rules; findings become `warnings`.

    Raises
    ------
    FmuError
        No such file, no zip archive, no readable model description.
    """
    path = find_fmu(fmu).resolve()
    if validate:
        return _read_anew(path, validate=True, bundled=_is_name(fmu))
    stat = path.stat()
    made = stat.st_ino, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size
    return _read_before(path, made, _is_name(fmu))


@lru_cache(maxsize=32)
def _read_before(path: Path, made: tuple[int, ...], bundled: bool) -> FmuDescription:
    """Return the description of a file that was `made` so: reading one takes 7 ms, and it is asked for often."""
    return _read_anew(path, validate=False, bundled=bundled)


def _read_anew(path: Path, *, validate: bool, bundled: bool) -> FmuDescription:
    check_archive(path)
    try:
        check_description(path)
        with _without_collection():
            description, found = _read(path, validate=validate)
            warnings = (*found, *_illegal_names(description), *_contradictions(description)) if validate else ()
            return _described(description, path, warnings=warnings, bundled=bundled)
    except FmuError:
        raise
    except Exception as error:  # fmpy raises many kinds; each means that the description cannot be read
        words = MEANT.get(type(error), one_line(error))
        raise FmuError(f"{path.name}: modelDescription.xml cannot be read: {words}") from error


def _is_name(fmu: str | Path) -> bool:
    return not Path(fmu).is_file()


@contextlib.contextmanager
def _without_collection() -> Iterator[None]:
    """Keep the collector of garbage away: among ten thousands of new objects it costs more than the reading."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _read(path: Path, *, validate: bool) -> tuple[Any, tuple[str, ...]]:
    """Return fmpy's description, and what its validation found; names are left to `_illegal_names`."""
    from fmpy.model_description import ValidationError, read_model_description

    found: tuple[str, ...] = ()
    if validate:
        try:
            return read_model_description(str(path), validate=True, validate_model_structure=True), ()
        except ValidationError as error:
            found = tuple(one_line(problem) for problem in error.problems)
        except Exception as error:
            found = (f"the validation itself failed: {one_line(error)}",)
    return read_model_description(str(path), validate=False), found


def _illegal_names(description: Any) -> list[str]:
    """Return a sentence about the names that their naming convention forbids; fmpy takes 1.7 ms to look at a name."""
    structured = description.variableNamingConvention == "structured"
    pattern = STRUCTURED_NAME if structured else FLAT_NAME
    wrong = [v.name for v in description.modelVariables if not pattern.fullmatch(v.name)]
    if not wrong:
        return []
    shown = ", ".join(repr(name) for name in wrong[:NAMES_SHOWN])
    more = f" and {len(wrong) - NAMES_SHOWN} more" if len(wrong) > NAMES_SHOWN else ""
    convention = "structured" if structured else "flat"
    return [f'{shown}{more}: no legal name for the naming convention "{convention}"']


def _contradictions(description: Any) -> list[str]:
    """Return what fmpy's validation does not look at: limits the wrong way round, starts outside them."""
    found = []
    for variable in description.modelVariables:
        low, high, start = limit_of(variable, "min"), limit_of(variable, "max"), start_of(variable)
        if low is not None and high is not None and low > high:
            found.append(f"{variable.name} has min {low:g} above max {high:g}; its limits are not used")
        elif isinstance(start, float) and ((low is not None and start < low) or (high is not None and start > high)):
            found.append(f"{variable.name} starts at {start:g}, outside its own limits")
    return found


def _described(description: Any, path: Path, *, warnings: tuple[str, ...], bundled: bool) -> FmuDescription:
    import fmpy

    co_simulation, model_exchange = description.coSimulation, description.modelExchange
    parts = (("co-simulation", co_simulation), ("model-exchange", model_exchange))
    kinds = tuple(kind for kind, part in parts if part is not None)
    experiment = description.defaultExperiment
    bases = {u.name: base_of(u) for u in description.unitDefinitions}
    capabilities = {kind: _capabilities(part, kind) for kind, part in parts if part is not None}
    version = str(description.fmiVersion)
    identifiers = [part.modelIdentifier if part is not None else None for _, part in parts]
    for identifier in identifiers:
        if identifier is not None and ("/" in identifier or "\\" in identifier or ".." in identifier):
            raise FmuError(f"{path.name}: the model identifier {identifier!r} is no name of a library")
    return FmuDescription(
        path=path,
        name=path.stem,
        fmi_version=version,
        model_name=description.modelName or path.stem,
        guid=description.guid or "",
        generation_tool=description.generationTool or "unknown tool",
        identifier=identifiers[0],
        kinds=kinds,
        platforms=tuple(fmpy.supported_platforms(str(path))),
        variables=tuple(variable_of(v, bases=bases) for v in description.modelVariables),
        capabilities=capabilities[kinds[0]] if kinds else {},
        capabilities_of=capabilities,
        default_experiment={
            "start_time": number_of(experiment.startTime if experiment else None),
            "stop_time": number_of(experiment.stopTime if experiment else None),
            "step_size": number_of(experiment.stepSize if experiment else None),
            "tolerance": number_of(experiment.tolerance if experiment else None),
        },
        warnings=warnings,
        description=description.description or "",
        model_exchange_identifier=identifiers[1],
        counts=(int(description.numberOfContinuousStates or 0), int(description.numberOfEventIndicators or 0)),
        unlisted=() if description.numberOfContinuousStates else _derivatives(description),
        kind=kinds[0] if kinds else "co-simulation",
        is_bundled=bundled,
    )


def _derivatives(description: Any) -> tuple[str, ...]:
    """Return the names of what an FMU says to be derivatives of states."""
    found = [(v.name, getattr(v, "derivative", None)) for v in description.modelVariables]
    return tuple(name for name, state in found if state is not None and getattr(state, "causality", "") != "input")


def with_kind(description: FmuDescription, kind: str | None) -> FmuDescription:
    """Return the description with the kind that is to be used; by default co-simulation where it is offered.

    Raises
    ------
    FmuError
        The FMU does not offer that kind.
    """
    if kind is None or kind == description.kind:
        return description
    if kind not in description.kinds:
        offered = " and ".join(description.kinds) or "nothing that can be simulated"
        raise FmuError(f"{description.path.name} offers no {kind}, only {offered}; choose that, or leave the kind out")
    capabilities = description.capabilities_of.get(kind, description.capabilities)
    return dataclasses.replace(description, kind=kind, capabilities=capabilities)


def check_usable(description: FmuDescription) -> None:
    """Raise FmuError, with the reason, unless the FMU can be simulated on this machine."""
    import fmpy

    name = description.path.name
    if not description.kinds or not description.library:
        raise FmuError(f"{name} offers neither co-simulation nor model exchange; export it as a co-simulation FMU")
    if description.fmi_version[:2] not in ("1.", "2.", "3."):
        raise FmuError(f"{name} is FMI {description.fmi_version}; export it as FMI 1.0, 2.0 or 3.0")
    if description.kind == "model-exchange" and description.unlisted:
        shown = ", ".join(description.unlisted[:NAMES_SHOWN])
        more = len(description.unlisted) - NAMES_SHOWN
        remedy = "use its co-simulation" if "co-simulation" in description.kinds else "export it as co-simulation"
        raise FmuError(
            f"the ModelStructure of {name} names no derivatives, though its variables hold some ({shown}"
            f"{f' and {more} more' if more > 0 else ''}), so its model exchange has no states to integrate; {remedy},"
            " or have them named"
        )
    here = (fmpy.platform, fmpy.platform_tuple)
    if not set(here) & set(description.platforms):
        there = ", ".join(description.platforms) or "none"
        remedy = "export it for this platform"
        if "c-code" in description.platforms:
            remedy = f"compile its sources with: python -m fmpy compile {name}"
        raise FmuError(f"{name} has no binary for {here[0]} (it has: {there}); {remedy}")


def _capabilities(part: Any, kind: str) -> dict[str, bool]:
    names: tuple[str, ...] = (
        "needsExecutionTool",
        "canBeInstantiatedOnlyOncePerProcess",
        "canGetAndSetFMUstate",
        "canSerializeFMUstate",
        "providesDirectionalDerivative",
    )
    if kind == "co-simulation":
        names += ("canHandleVariableCommunicationStepSize", "canInterpolateInputs", "canRunAsynchronuously")
    return {name: bool(getattr(part, name, False)) for name in names}
