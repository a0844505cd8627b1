"""The files of an estimate for other tools, by format. Knows which FMU allows which; runs nothing but a compiler."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from estimator.errors import InputError, suggestion
from estimator.fmus.fmu import describe
from estimator.motor.names import is_motor
from estimator.results.handover import (
    csv_table,
    estimate_from_json,
    matlab_script,
    modelica_modifier,
    state_space_json,
)
from estimator.results.result import Estimate

FORMATS = ("csv", "ssv", "ssp", "fmu", "matlab", "modelica", "state-space")  # as in result_arguments.py
RESULT = "result.json"


def read_result(path: Path) -> Estimate:
    """Return the estimate in a result.json, or in a folder that holds one, without its signals.

    Raises
    ------
    InputError
        There is none, or it is no estimate's.
    """
    file = path / RESULT if path.is_dir() else path
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; give the folder or the result.json of estimate -o") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{file} is no text; give the folder or the result.json of estimate -o") from error
    return estimate_from_json(text, source=str(file))


def told_results(paths: Sequence[Path]) -> list[str]:
    """Return a short name for each result: its folder's, or its file's, with as many folders as tell them apart.

    Raises
    ------
    InputError
        A result is given twice.
    """
    whole = [path.absolute().parent if path.name == RESULT else path.absolute() for path in paths]
    for k, path in enumerate(whole):
        if path in whole[:k]:
            raise InputError(f"the result {paths[k]} is given twice; leave one out")
    parts = [path.with_suffix("") if path.suffix == ".json" else path for path in whole]
    for count in range(1, max(len(path.parts) for path in parts) + 1):
        names = ["/".join(path.parts[-count:]) for path in parts]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def handover_files(
    estimate: Estimate, *, formats: Sequence[str] = (), fmu: str | None = None
) -> tuple[dict[str, bytes], list[str]]:
    """Return the files by name, and a sentence for each format that was not asked for by name and is left out.

    Parameters
    ----------
    formats : of `FORMATS`
        Empty: all that this estimate and its FMU allow.
    fmu : str, optional
        The FMU, where it no longer lies where the estimate found it.

    Raises
    ------
    InputError
        There is nothing to hand over, no such format, or one that was asked for cannot be made.
    """
    from fmu_build.errors import BuildError

    if estimate.verdict == "refused" or not estimate.parameters:
        reason = estimate.reasons[0] if estimate.reasons else "it has no parameters"
        raise InputError(f"the estimate was refused, so there is nothing to export: {reason}")
    for form in formats:
        if form not in FORMATS:
            raise InputError(f"there is no format {form!r}{suggestion(form, FORMATS)}")
    files: dict[str, bytes] = {}
    left_out = []
    for wanted in formats or FORMATS:
        try:
            name, content = _made(wanted, estimate, fmu)
        except (InputError, BuildError) as error:
            if formats:
                raise
            left_out.append(f"{wanted}: {error}")
            continue
        files[name] = content
    return files, left_out


def _made(wanted: str, estimate: Estimate, fmu: str | None) -> tuple[str, bytes]:
    """Return name and content of one format's file."""
    name = str(estimate.fmu.get("name") or "motor")
    if wanted == "csv":
        return "parameters.csv", csv_table(estimate)
    if wanted == "matlab":
        return "motor_parameters.m", matlab_script(estimate)
    if wanted == "modelica":
        return "modifier.mo", modelica_modifier(estimate)
    if wanted == "state-space":
        if not is_motor({n: p.value for n, p in estimate.parameters.items()}):
            raise InputError("a linear motor model needs R, K, L, J and B among the parameters, estimated or fixed")
        return "state_space.json", state_space_json(estimate)
    if wanted == "ssv":
        from estimator.results.export import parameter_set

        return "parameters.ssv", parameter_set(estimate)
    path = fmu or str(estimate.fmu.get("path") or name)
    if fmu is None and not Path(path).is_file():
        raise InputError(f"the FMU is no longer at {path}; say with --fmu where it is")
    description = describe(path)
    for parameter in estimate.parameters.values():
        for setting in parameter.set_in_fmu:
            description.variable(setting.variable, role="parameter")  # another FMU has no such one
    if wanted == "ssp":
        from estimator.results.system import system_archive

        return f"{name}.ssp", system_archive(estimate, description)
    from estimator.results.rebuild import rebuilt_fmu

    return f"{name}.fmu", rebuilt_fmu(estimate, description)
