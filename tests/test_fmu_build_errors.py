"""What is wrong with a model, or the place it is built in: one sentence each, naming file, line or variable."""

from __future__ import annotations

import importlib.util
import re
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

import fmpy
import pytest

import fmu_build
import fmu_build.compiler
import fmu_build.platforms
from fmu_build import BuildError
from fmu_build.export import _write_archive
from fmu_build.model import loaded_model

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MODEL = """\
/* A small model. */
#define MODEL_LINEAR 1
#define MODEL_VARIABLES(X) \\
    X(input,     v, 0, 10, -100, 100, "V",   "Voltage") \\
    X(parameter, R, 1, 1,  0.1,  10,  "Ohm", "Resistance") \\
    X(parameter, L, 1, 1,  0.1,  10,  "H",   "Inductance") \\
    X(state,     i, 0, 1,  -1e3, 1e3, "A",   "Current") \\
    X(output,    p, 0, 1,  -1e6, 1e6, "W",   "Power")
#include "model.h"
static void derivatives(const Variables *m, Derivatives *d)
{
    d->i = (m->v - m->R * m->i) / m->L;
    d->p = m->v * m->i;
}
"""


@pytest.fixture(scope="module", autouse=True)
def quickly() -> Iterator[None]:
    """Compile without optimising: what is said of a model does not depend on it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu_build.compiler, "FLAGS", (*fmu_build.compiler.FLAGS, "-O0"))
        yield


def build(folder: Path, text: str, *, name: str = "small.c") -> Path:
    model = folder / name
    model.write_text(text)
    return fmu_build.build(model, output=folder / "small.fmu")


def message(folder: Path, old: str, new: str) -> str:
    """Return what is said of the model with one change, after the file's name; nothing may be left behind."""
    assert old in MODEL
    with pytest.raises(BuildError) as caught:
        build(folder, MODEL.replace(old, new, 1))
    assert [path.name for path in folder.iterdir()] == ["small.c"]
    text = str(caught.value)
    assert text.startswith(f"{folder / 'small.c'}: ") and "\n" not in text
    return text.removeprefix(f"{folder / 'small.c'}: ")


def test_model_without_faults_is_built(tmp_path: Path) -> None:
    assert build(tmp_path, MODEL).is_file()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("m->R * m->i)", "m->Rs * m->i)", "line 12: 'Variables' has no member named 'Rs'"),
        ("d->p = m->v * m->i;", "d->p = m->v * m->i", "line 13: expected ';' before '}' token"),
        ("d->p = m->v", "d->p = cosinus(m->v)", "line 13: implicit declaration of function 'cosinus'"),
        ("void derivatives", "void derivation", "it uses what it does not define: derivatives"),
        ("#define MODEL_LINEAR 1", "", "before model.h is included, MODEL_LINEAR must be defined"),
        ("MODEL_VARIABLES(X)", "MODEL_TABLE(X)", "before model.h is included, MODEL_VARIABLES must be defined"),
        ("X(parameter, R", "X(parametre, R", "line 5: .*parametre"),
        ('10,  "Ohm",', "10, ", "line 5: .*requires 8 arguments, but only 7 given"),
        ("X(state,     i", "X(state,     v", "line 7: duplicate member 'v'"),
        ("X(state,     i", "X(output,    i", "a model has a state"),
    ],
)
def test_error_of_the_compiler_is_told_in_terms_of_the_model(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert re.search(said, message(tmp_path, old, new))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("R, 1, 1,  0.1", "R, 0, 1,  0.1", "variable R starts at 0, not within min 0.1 and max 10"),
        ("R, 1, 1,  0.1", "R, 1, 0,  0.1", "variable R has nominal 0; a typical magnitude above 0 is needed"),
        ("0.1,  10", "10,  0.1", "variable R has min 10 and max 0.1; min <= max and both finite are needed"),
        ("-1e3, 1e3", "-INFINITY, 1e3", "variable i has min -inf and max 1000; min <= max and both finite are needed"),
        ('"Ohm"', '"ohm"', "unit of variable R: 'ohm' is not a coherent SI unit such as 'N.m.s/rad'"),
        ('"Resistance"', '""', "variable R has no description"),
        ("d->p = m->v * m->i;", "", "d->p is not set, or not finite at the start values"),
        ("m->i) / m->L", "m->i) / (m->L - 1)", "d->i is not set, or not finite at the start values"),
        ("m->R * m->i)", "m->i)", "parameter R changes no derivative and no output; use it or remove it"),
        ("m->R * m->i)", "m->R * m->i * m->i)", "d->i is not linear in the states; say MODEL_LINEAR 0"),
        ("m->R * m->i)", "m->v * m->i)", "d->i is not linear in the states; say MODEL_LINEAR 0"),
        ("#include", '#include "table.h"\n#include', 'a model is one file; it includes "table.h"'),
    ],
)
def test_fault_of_the_table_or_the_equations_is_one_sentence(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert message(tmp_path, old, new).startswith(said)


MODES = MODEL.replace(
    'X(output,    p, 0, 1,  -1e6, 1e6, "W",   "Power")', 'X(mode, way, 0, 1, -1, 1, "1", "Way")'
).replace(
    "    d->p = m->v * m->i;\n}",
    """}
static void switches(const Variables *m, Switches *s)
{
    s->way = dry_friction(m->way, m->i, m->v, 1);
}
static void enter(Variables *m)
{
    if (m->way == 0) m->i = 0;
}""",
)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("void switches", "void switching", "it uses what it does not define: .*switches"),
        ("void enter", "void entering", "it uses what it does not define: .*enter"),
        ("s->way = dry", "dry", "s->way.margin is not set, or not finite at the start values"),
        ("s->way = dry", "s->away = dry", "'Switches' has no member named 'away'"),
        ("0, 1, -1, 1,", "0, 1, -1, 1e6,", "variable way is a mode from -1 to 1e.06; give it the few whole numbers"),
        ("(m->v - m->R", "(m->v - m->way * m->i * m->i - m->R", "d->i is not linear in the states"),
        (
            "dry_friction(m->way, m->i, m->v, 1)",
            "linear_switch(1 + m->i * m->i, 0)",
            "s->way.linear is not linear in the states",
        ),
        (
            "dry_friction(m->way, m->i, m->v, 1)",
            "linear_switch(1 + m->v * m->i, 0)",
            "s->way.linear is not linear in the states",
        ),
        (
            "dry_friction(m->way, m->i, m->v, 1)",
            "(Switch){1 + m->i * m->i, 0, .linear = m->i, .most = INFINITY}",
            "s->way.margin is not what its linear and most say",
        ),
    ],
)
def test_fault_of_a_model_with_modes_is_one_sentence(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in MODES
    with pytest.raises(BuildError, match=said):
        build(tmp_path, MODES.replace(old, new, 1))


def test_model_with_modes_and_without_faults_is_built(tmp_path: Path) -> None:
    assert build(tmp_path, MODES).is_file()


def test_parameter_that_is_only_in_a_comment_is_refused_and_one_that_acts_in_a_corner_is_not(tmp_path: Path) -> None:
    unread = message(tmp_path, "m->R * m->i)", "m->i) /* m->R * m->i */")
    assert unread == "parameter R changes no derivative and no output; use it or remove it"
    corner = MODEL.replace("m->v * m->i;", "m->v * m->i + (m->i > 999 ? m->C : 0);").replace(
        "    X(state,", '    X(parameter, C, 1, 1, 0, 10, "W", "Acts at 999 A and above") \\\n    X(state,'
    )
    description = fmpy.read_model_description(str(build(tmp_path, corner)))
    known = {u.variable.name: {k.name for k in u.dependencies} for u in description.initialUnknowns}
    assert all("C" in names for names in known.values())  # rather one too many


def test_variable_may_not_be_called_time(tmp_path: Path) -> None:
    text = MODEL.replace(" R,", " time,").replace("m->R", "m->time")
    with pytest.raises(BuildError, match="variable time has the name of the independent variable; give it another"):
        build(tmp_path, text)


def test_text_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    (tmp_path / "small.c").write_bytes(MODEL.replace("Resistance", "Widerstand \xfc").encode("latin-1"))
    with pytest.raises(BuildError, match=r"small.c: the model file cannot be read: it is not UTF-8"):
        fmu_build.build(tmp_path / "small.c", output=tmp_path / "small.fmu")
    with pytest.raises(BuildError, match=r"small.c: the line of R is not UTF-8"):
        build(tmp_path, MODEL.replace("Resistance", r"Widerstand \xfc"))


def test_affine_model_counts_as_linear(tmp_path: Path) -> None:
    assert build(tmp_path, MODEL.replace("m->v - m->R", "3 + m->v - m->R")).is_file()


def test_model_that_does_not_exist_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"no model 'dc_motr': neither a C file nor a bundled model \(.*dc_motor"):
        fmu_build.build("dc_motr", output=tmp_path / "x.fmu")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("my-motor.c", "the name becomes a C identifier; use letters, digits and _, such as my_motor.c"),
        ("1motor.c", "the name becomes a C identifier"),
        ("motor.h", "a model is one C file, its name ending in .c"),
        ("fmi2.c", "this name is taken by the code around the model; give the file another"),
        ("motor_fmu.c", "this name is taken by the code around the model; give the file another"),
    ],
)
def test_model_file_must_have_a_usable_name(tmp_path: Path, name: str, said: str) -> None:
    with pytest.raises(BuildError, match=re.escape(said)):
        build(tmp_path, MODEL, name=name)


def test_output_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="there is no folder .*nowhere"):
        fmu_build.build("dc_motor", output=tmp_path / "nowhere" / "x.fmu")
    (tmp_path / "folder.fmu").mkdir()
    with pytest.raises(BuildError, match=r"folder.fmu: cannot be written"):
        fmu_build.build("dc_motor", output=tmp_path / "folder.fmu")
    assert [path.name for path in tmp_path.iterdir()] == ["folder.fmu"]


def test_on_a_disk_that_cannot_be_written_the_output_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("fmu_build.export.zipfile.ZipFile", refused)
    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(BuildError, match=r"x\.fmu: cannot be written: Read-only file system"):
        _write_archive(tmp_path / "x.fmu", {})


def test_no_compiler_is_one_sentence_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(fmu_build.platforms, "find_spec", lambda name: None)
    with pytest.raises(BuildError, match="no C compiler found .cc, .*; install one, .*package ziglang, or name it in"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")
    monkeypatch.setenv("CC", "some-cc -m64")
    with pytest.raises(BuildError, match="the C compiler 'some-cc' that .CC names is not found; correct or unset CC"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="needs a program without a suffix")
def test_compiler_that_fails_or_cannot_be_run_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def install(text: bytes) -> None:
        program = tmp_path / "bad-cc"
        program.write_bytes(text)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("CC", str(program))

    install(b"#!/nonexistent/interpreter\n")
    with pytest.raises(BuildError, match="the C compiler .*bad-cc' cannot be run: "):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")
    install(b"#!/bin/sh\necho out of order >&2\nexit 1\n")
    with pytest.raises(BuildError, match=r"dc_motor.c: it does not compile: out of order"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")
    install(b"#!/bin/sh\nexit 0\n")
    with pytest.raises(BuildError, match=r"dc_motor.c: it does not compile: the compiler gave no reason"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")


def test_missing_fmi_headers_are_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_build.compiler, "find_spec", lambda name: importlib.util.find_spec("json"))
    with pytest.raises(BuildError, match="the FMI C headers are not found; install fmpy, which carries them"):
        fmu_build.build("dc_motor", output=tmp_path / "x.fmu")


def test_library_that_cannot_be_loaded_is_an_error(tmp_path: Path) -> None:
    library = tmp_path / "library.so"
    library.write_bytes(b"no library")
    with (
        pytest.raises(BuildError, match="the compiled library cannot be loaded: "),
        loaded_model(library, source=library),
    ):
        pass
