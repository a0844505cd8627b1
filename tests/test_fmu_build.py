"""What is inside a built FMU: its description, sources, documentation; where bundled ones are kept."""

from __future__ import annotations

import ctypes
import io
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import matplotlib.image
import pytest
from fmpy.model_description import ModelDescription
from fmpy.validation import validate_fmu

import fmu_build
import fmu_build.bundle
import fmu_build.export
from fmu_build.compiler import compile_library, fmi_headers, library_suffix
from fmu_build.units import base_exponents, derivative_unit

ROOT = Path(__file__).parent.parent
FAN = Path(__file__).parent / "models" / "dc_motor_fan.c"


@pytest.fixture(scope="module")
def fan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fmu_build.build(FAN, output=tmp_path_factory.mktemp("fan") / "dc_motor_fan.fmu")


@pytest.fixture(scope="module")
def motor3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fmu_build.build("dc_motor", output=tmp_path_factory.mktemp("fmi3") / "dc_motor.fmu", fmi=3)


@pytest.fixture(params=["dc_motor", "dc_motor_fan", "dc_motor in FMI 3"])
def fmu(request: pytest.FixtureRequest, fan: Path, motor3: Path) -> Path:
    if request.param == "dc_motor in FMI 3":
        return motor3
    return fan if request.param == "dc_motor_fan" else fmu_build.bundled("dc_motor")


@pytest.fixture
def description(fmu: Path) -> ModelDescription:
    return fmpy.read_model_description(str(fmu))


@pytest.mark.smoke
def test_validation_finds_nothing(fmu: Path) -> None:
    assert validate_fmu(str(fmu)) == []


def test_every_variable_has_unit_bounds_nominal_and_description(fmu: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    units = {unit.attrib["name"] for unit in root.findall("UnitDefinitions/Unit")}
    variables = root.findall("ModelVariables/*")
    assert len(variables) >= 10
    for variable in variables:
        real = variable if variable.tag == "Float64" else variable.find("Real")
        assert real is not None and variable.attrib["description"] and real.attrib["unit"] in units
        if variable.attrib["causality"] in ("local", "independent"):  # a derivative, the time
            assert "start" not in real.attrib
            continue
        low, high = float(real.attrib["min"]), float(real.attrib["max"])
        assert low < high and float(real.attrib["nominal"]) > 0
        if "start" in real.attrib:
            assert low <= float(real.attrib["start"]) <= high


def test_parameters_are_tunable_inputs_start_and_calculated_outputs_do_not(description: ModelDescription) -> None:
    for v in description.modelVariables:
        kind = (v.causality, v.variability, v.initial, v.start is not None)
        assert kind in {
            ("parameter", "tunable", "exact", True),
            ("input", "continuous", "exact", True),  # exact: fmpy's reading of an input without initial
            ("output", "continuous", "exact", True),
            ("output", "continuous", "calculated", False),
            ("local", "continuous", "calculated", False),
            *([("independent", "continuous", None, False)] if v.name == "time" else []),
        }


def test_dc_motor_has_its_names_in_units_of_si() -> None:
    description = fmpy.read_model_description(str(fmu_build.bundled("dc_motor")))
    units = {(v.causality, v.name): v.unit for v in description.modelVariables}
    assert units == {
        ("input", "v"): "V",
        ("input", "load"): "N.m",
        ("parameter", "R"): "Ohm",
        ("parameter", "K"): "V.s/rad",
        ("parameter", "L"): "H",
        ("parameter", "J"): "kg.m2",
        ("parameter", "B"): "N.m.s/rad",
        ("output", "i"): "A",
        ("output", "w"): "rad/s",
        ("output", "angle"): "rad",
        ("local", "der(i)"): "A/s",
        ("local", "der(w)"): "rad/s2",
        ("local", "der(angle)"): "rad/s",
    }
    start = {v.name: float(v.start) for v in description.modelVariables if v.causality != "local"}
    assert start | {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 1.69e-4} == start


def test_bounds_of_dc_motor_admit_any_motor() -> None:
    description = fmpy.read_model_description(str(fmu_build.bundled("dc_motor")))
    bounds = {v.name: (float(v.min), float(v.max)) for v in description.modelVariables if v.causality == "parameter"}
    for name, small, big in [("R", 1e-5, 1e4), ("K", 1e-5, 1e3), ("L", 1e-8, 1e2), ("J", 5e-10, 1e3), ("B", 0, 1e3)]:
        assert bounds[name][0] <= small and bounds[name][1] >= big
    assert all(bounds[name][0] > 0 for name in "RKLJ") and bounds["B"][0] == 0


def test_units_have_base_exponents_and_speed_is_displayed_in_rpm(description: ModelDescription) -> None:
    units = {unit.name: unit for unit in description.unitDefinitions}
    torque, speed = units["N.m"].baseUnit, units["rad/s"]
    assert (torque.kg, torque.m, torque.s, torque.A, torque.rad) == (1, 2, -2, 0, 0)
    assert (speed.baseUnit.s, speed.baseUnit.rad) == (-1, 1)
    assert speed.displayUnits[0].name == "rpm" and float(speed.displayUnits[0].factor) * 3.141592653589793 == 30
    assert {v.displayUnit for v in description.modelVariables if v.unit == "rad/s" and v.start} == {"rpm"}


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("V.s/rad", {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
        ("H", {"kg": 1, "m": 2, "s": -2, "A": -2}),
        ("N.m.s2/rad2", {"kg": 1, "m": 2, "rad": -2}),
        ("Ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}),
        ("1/s", {"s": -1}),
        ("1", {}),
    ],
)
def test_unit_is_a_product_of_base_units(unit: str, exponents: dict[str, int]) -> None:
    assert base_exponents(unit) == exponents


@pytest.mark.parametrize("unit", ["rpm", "V*s", "N.m/s/rad", "", "kg.", "m^2", "mm"])
def test_unit_outside_si_is_refused(unit: str) -> None:
    with pytest.raises(fmu_build.BuildError, match="is not a coherent SI unit"):
        base_exponents(unit)


def test_structure_lists_what_outputs_depend_on(fan: Path) -> None:
    description = fmpy.read_model_description(str(fan))
    outputs = {u.variable.name: {k.name for k in u.dependencies} for u in description.outputs}
    initial = {u.variable.name: {k.name for k in u.dependencies} for u in description.initialUnknowns}
    derivatives = {u.variable.name: {k.name for k in u.dependencies} for u in description.derivatives}
    assert outputs == {"w": {"w"}, "power": {"v", "i"}, "i": {"i"}, "torque": {"w"}}
    assert derivatives == {"der(w)": {"w", "i"}, "der(i)": {"v", "w", "i"}}
    assert initial["power"] == {"v", "i"} and initial["torque"] == {"w", "drag"}
    assert initial["der(i)"] == {"v", "w", "i", "R", "K", "L"}
    assert initial["der(w)"] == {"w", "i", "K", "B", "J", "drag"}


def test_model_description_says_what_the_fmu_can_do(fmu: Path, description: ModelDescription) -> None:
    simulation = description.coSimulation
    assert simulation.modelIdentifier == description.modelName == fmu.stem
    assert simulation.canHandleVariableCommunicationStepSize
    assert not simulation.canBeInstantiatedOnlyOncePerProcess
    with zipfile.ZipFile(fmu) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))  # fmpy does not read all of FMI 3.0's
    second = root.attrib["fmiVersion"] == "2.0"
    can = {"canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"}
    can |= {"canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives"}
    for part in root.findall("ModelExchange") + root.findall("CoSimulation"):
        assert part.attrib["modelIdentifier"] == fmu.stem
        assert len([name for name in can if part.get(name) == "true"]) == 3
    assert len(root.findall("ModelExchange")) == 1
    assert root.attrib["guid" if second else "instantiationToken"].startswith("{")
    assert description.generationTool and len(description.description) > 20
    assert [category.name for category in description.logCategories] == ["logAll", "logStatusDiscard", "logStatusError"]
    experiment = description.defaultExperiment
    assert (float(experiment.startTime), float(experiment.stopTime), float(experiment.stepSize)) == (0, 2.8, 1e-3)


def test_archive_has_documentation_licence_icon_sources_and_no_fmi_headers(fmu: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        names = set(archive.namelist())
        page = archive.read("documentation/index.html").decode()
        licence = archive.read("documentation/licenses/license.txt").decode()
        icon = matplotlib.image.imread(io.BytesIO(archive.read("model.png")))
    assert {f"sources/{name}" for name in (f"{fmu.stem}.c", f"{fmu.stem}_fmu.c", "model.h")} <= names
    (version,) = {"sources/fmi2.c", "sources/fmi3.c"} & names
    assert ("sources/buildDescription.xml" in names) == (version == "sources/fmi3.c")
    assert not any("fmi" in name and name.endswith(".h") for name in names)
    assert "L di/dt" in page and "Armature resistance" in page
    assert "BSD 2-Clause" in licence or "Redistribution and use" in licence
    assert icon.shape == (64, 64, 4) or icon.shape == (64, 64, 2)
    assert 0 < icon[..., -1].mean() < 0.5  # a drawing on nothing


def test_library_exports_every_function_of_its_fmi_version(fmu: Path, tmp_path: Path) -> None:
    version = fmpy.read_model_description(str(fmu)).fmiVersion[0]
    header = (fmi_headers() / f"fmi{version}Functions.h").read_text()
    declared = set(re.findall(rf"^#define (fmi{version}[A-Z]\w*) +fmi{version}FullName\(", header, re.M))
    declared -= {f"fmi{version}FullName"}
    assert len(declared) == {"2": 44, "3": 75}[version]
    fmpy.extract(str(fmu), tmp_path)
    library = ctypes.CDLL(str(next((tmp_path / "binaries").rglob(f"*{library_suffix()}"))))
    assert [name for name in sorted(declared) if not hasattr(library, name)] == []


def test_fmi3_is_described_as_fmi3_wants_it(motor3: Path) -> None:
    with zipfile.ZipFile(motor3) as archive:
        names = archive.namelist()
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert root.attrib["fmiVersion"] == "3.0" and "guid" not in root.attrib
    assert fmu_build.platforms.platform_folder(3).count("-") == 1
    assert f"binaries/{fmu_build.platforms.platform_folder(3)}/dc_motor{library_suffix()}" in names
    independent = root.findall("ModelVariables/Float64[@causality='independent']")
    assert [variable.attrib["name"] for variable in independent] == ["time"]
    (configuration,) = fmpy.model_description.read_build_description(str(motor3))
    assert configuration.modelIdentifier == "dc_motor"
    assert [s.sourceFiles for s in configuration.sourceFileSets] == [["dc_motor_fmu.c"]]


def test_other_versions_of_fmi_are_refused(tmp_path: Path) -> None:
    with pytest.raises(fmu_build.BuildError, match="FMI 1 is not offered; 2 or 3 is"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu", fmi=1)


@pytest.mark.parametrize(
    ("unit", "derivative"),
    [("A", "A/s"), ("rad/s", "rad/s2"), ("m/s2", "m/s3"), ("V.s/rad", "V.s/(rad.s)"), ("J/(kg.s)", "J/(kg.s2)")],
)
def test_unit_of_a_derivative_has_one_second_more_below(unit: str, derivative: str) -> None:
    assert derivative_unit(unit) == derivative
    exponents = base_exponents(unit)
    assert base_exponents(derivative) == exponents | {"s": exponents.get("s", 0) - 1}


@pytest.mark.skipif(shutil.which("nm") is None, reason="nm is not installed")
def test_library_exports_nothing_else_and_needs_only_the_c_library(fmu: Path, tmp_path: Path) -> None:
    fmpy.extract(str(fmu), tmp_path)
    library = str(next((tmp_path / "binaries").rglob(f"*{library_suffix()}")))
    exported = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True)
    needed = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True)
    names = {line.split()[-1] for line in exported.stdout.splitlines()}
    assert {name for name in names if not name.startswith(("fmi2", "fmi3"))} == {"fmu_build_model"}
    wanted = {line.split()[-1].partition("@")[0] for line in needed.stdout.splitlines() if " U " in line}
    memory = {"calloc", "malloc", "free", "memcpy", "memcmp", "memset"}
    text = {"strcmp", "strlen", "strcpy", "vsnprintf", "__vsnprintf_chk", "__stack_chk_fail"}
    assert wanted - memory - text <= ({"sqrt"} if "fan" in fmu.stem else set())


def test_equal_content_is_an_equal_fmu_and_another_start_value_another_guid(tmp_path: Path, fan: Path) -> None:
    again = fmu_build.build(FAN, output=tmp_path / "again.fmu")
    assert again.read_bytes() == fan.read_bytes()
    changed = tmp_path / "dc_motor_fan.c"
    changed.write_text(FAN.read_text().replace("3.1363", "3.1364"))
    other = fmu_build.build(changed, output=tmp_path / "other.fmu")
    guids = {fmpy.read_model_description(str(path)).guid for path in (fan, other)}
    assert len(guids) == 2


def test_default_output_is_beside_the_caller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert fmu_build.build("dc_motor") == Path("dc_motor.fmu")
    assert [path.name for path in tmp_path.iterdir()] == ["dc_motor.fmu"]


def test_sources_compile_without_a_warning(tmp_path: Path, fmu: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    unit = tmp_path / "sources" / f"{fmu.stem}_fmu.c"
    compile_library(unit, tmp_path / "library", include=[fmi_headers()], warnings_are_errors=True)
    assert (tmp_path / "library").is_file()


def test_fmu_build_does_not_import_the_estimator() -> None:
    code = "import sys, fmu_build; print(*{name.partition('.')[0] for name in sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"estimator", "numpy", "fmpy"} & set(run.stdout.split())


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Path, Path]]:
    """Return where bundled FMUs are kept: a folder in place of the package's, and a cache."""
    package, cache = tmp_path / "package", tmp_path / "cache"
    monkeypatch.setattr(fmu_build.bundle, "BUNDLED", package)
    monkeypatch.setattr(fmu_build.bundle, "_cache", lambda: cache)
    yield package, cache


def test_bundled_fmu_is_built_once_and_again_when_out_of_date(places: tuple[Path, Path]) -> None:
    package, _ = places
    assert "dc_motor" in fmu_build.bundled_names()
    path = fmu_build.bundled("dc_motor")
    assert path == package / "dc_motor.fmu"
    built = path.stat().st_mtime_ns
    assert fmu_build.bundled("dc_motor") == path and path.stat().st_mtime_ns == built
    for stale in (b"no archive", b""):
        path.write_bytes(stale)
        assert validate_fmu(str(fmu_build.bundled("dc_motor"))) == []
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", '<fmiModelDescription guid="{another}"/>')
    assert validate_fmu(str(fmu_build.bundled("dc_motor"))) == []


def test_bundled_fmu_goes_to_the_cache_where_the_package_cannot_be_written(places: tuple[Path, Path]) -> None:
    package, cache = places
    package.write_text("a file where the folder would be")
    path = fmu_build.bundled("dc_motor")
    assert path.is_relative_to(cache) and validate_fmu(str(path)) == []
    assert fmu_build.bundled("dc_motor") == path


def test_bundled_fmu_that_cannot_be_kept_is_an_error(places: tuple[Path, Path]) -> None:
    for place in places:
        place.write_text("a file where the folder would be")
    with pytest.raises(fmu_build.BuildError, match="the FMU of dc_motor cannot be kept: neither .* nor .*"):
        fmu_build.bundled("dc_motor")


def test_unknown_bundled_model_is_an_error() -> None:
    with pytest.raises(fmu_build.BuildError, match=r"no bundled model 'ac_motor' \(.*dc_motor.*\)"):
        fmu_build.bundled("ac_motor")
