"""What an archive may not do: leave its folder, grow without end, expand entities, be executed by --static."""

import io
import time
import zipfile

import pytest
from foreign_fmus import foreign_fmu

import estimator.fmus.archive
from estimator.cli import main
from estimator.errors import FmuError
from estimator.fmus.fmu import describe

XML = '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation modelIdentifier="m"/><ModelVariables>'
XML += "</ModelVariables><ModelStructure/></fmiModelDescription>"


def archive(path, members=(), *, description=XML):
    """Write an archive with a description and further (name or ZipInfo, content) members."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        if description is not None:
            file.writestr("modelDescription.xml", description)
        for name, content in members:
            file.writestr(name, content)
    return path


def link(name):
    info = zipfile.ZipInfo(name)
    info.external_attr = 0o120777 << 16
    return info


MEMBERS = {
    "parent folder": ([("../evil.txt", "")], "holds the unsafe path '../evil.txt'"),
    "inside out": ([("binaries/../../evil.txt", "")], "holds the unsafe path 'binaries/../../evil.txt'"),
    "absolute path": ([("/etc/evil", "")], "holds the unsafe path '/etc/evil'"),
    "drive": ([("C:/evil", "")], "holds the unsafe path 'C:/evil'"),
    "backslash": ([("..\\evil", "")], r"holds the unsafe path '..\\evil'"),
    "symbolic link": ([(link("resources/shadow"), "/etc/shadow")], "holds the symbolic link 'resources/shadow'"),
    "bomb": ([("resources/zeros", bytes(64 << 20))], "'resources/zeros' grows 1000 times when unpacked"),
}


@pytest.mark.parametrize(("members", "sentence"), MEMBERS.values(), ids=MEMBERS)
def test_a_member_that_could_do_harm_closes_the_archive(tmp_path, members, sentence):
    path = archive(tmp_path / "bad.fmu", members)
    with pytest.raises(FmuError) as caught:
        describe(path)
    assert str(caught.value).startswith("bad.fmu") and sentence in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["bad.fmu"]


def test_a_member_given_twice_closes_the_archive(tmp_path):
    with pytest.warns(UserWarning, match="Duplicate"):
        path = archive(tmp_path / "bad.fmu", [("modelDescription.xml", XML)])
    with pytest.raises(FmuError, match=r"holds 'modelDescription.xml' twice"):
        describe(path)


ENTITIES = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;">]>' + XML.replace('"m" guid', '"&c;" guid')
OUTSIDE = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>' + XML.replace('"m" guid', '"&b;" guid')


@pytest.mark.parametrize("text", [ENTITIES, OUTSIDE, ENTITIES.encode("utf-16")], ids=["many", "a file", "utf-16"])
def test_entities_are_not_expanded(tmp_path, text):
    with pytest.raises(FmuError, match=r"modelDescription.xml has a document type with entities; it is not opened"):
        describe(archive(tmp_path / "bad.fmu", description=text))


def declared_as(encoding):
    return f'<?xml version="1.0" encoding="{encoding}"?>'


HIDDEN = {
    "utf-7": declared_as("UTF-7").encode() + ENTITIES.replace("<", "+ADw-").encode(),
    "an old code page": (declared_as("IBM037") + ENTITIES).encode("cp037"),
    "utf-32": (declared_as("UTF-32") + ENTITIES).encode("utf-32"),
}


@pytest.mark.parametrize("text", HIDDEN.values(), ids=HIDDEN)
def test_an_encoding_that_could_hide_entities_is_refused(tmp_path, text):
    with pytest.raises(FmuError, match=r"modelDescription.xml is in the encoding '.*'; write it in UTF-8"):
        describe(archive(tmp_path / "bad.fmu", description=text))


@pytest.mark.parametrize(("text", "what"), [(" \n", "is empty"), ("<html/>", "says no fmiVersion")])
def test_a_description_that_is_none_is_told(tmp_path, text, what):
    with pytest.raises(FmuError, match=f"bad.fmu: modelDescription.xml {what}, so it is no FMU"):
        describe(archive(tmp_path / "bad.fmu", description=text))


def test_a_description_without_variables_is_told(tmp_path):
    text = XML.replace("ModelVariables", "Nothing")
    with pytest.raises(FmuError, match=r"bad.fmu: modelDescription.xml has no ModelVariables, so nothing of it can"):
        describe(archive(tmp_path / "bad.fmu", description=text))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (
            "<ModelVariables>",
            '<ModelVariables><ScalarVariable name="x" valueReference="0"/>',
            "a variable of it has no type",
        ),
        (
            "<ModelStructure/>",
            '<ModelStructure><Outputs><Unknown index="7"/></Outputs></ModelStructure>',
            "its ModelStructure names a variable that is not there",
        ),
    ],
)
def test_a_description_that_contradicts_itself_is_told(tmp_path, old, new, what):
    with pytest.raises(FmuError, match=f"bad.fmu: modelDescription.xml cannot be read: {what}$"):
        describe(archive(tmp_path / "bad.fmu", description=XML.replace(old, new)))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "iso-8859-1", "windows-1252"])
def test_the_usual_encodings_are_read(tmp_path, encoding):
    text = declared_as(encoding.removesuffix("-sig").removesuffix("-le")) + "\n" + XML.replace('"m" guid', '"µ" guid')
    assert describe(archive(tmp_path / "good.fmu", description=text.encode(encoding))).model_name == "µ"


def test_too_many_members_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(estimator.fmus.archive, "MAX_MEMBERS", 3)
    path = archive(tmp_path / "bad.fmu", [(f"resources/{k}", "") for k in range(4)])
    with pytest.raises(FmuError, match=r"bad.fmu is too large: more than 3 files or 4 GiB extracted"):
        describe(path)


def test_a_large_description_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(estimator.fmus.archive, "MAX_DESCRIPTION", 1 << 20)
    noise = "".join(chr(33 + k * k % 60) for k in range(2 << 20)).replace("<", "").replace("&", "").replace("-", "")
    with pytest.raises(FmuError, match=r"modelDescription.xml is larger than 1 MiB"):
        describe(archive(tmp_path / "bad.fmu", description=XML + f"<!-- {noise} -->"))


def test_an_encrypted_archive_is_refused(tmp_path):
    path = archive(tmp_path / "bad.fmu")
    data = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + at] |= 1
    path.write_bytes(data)
    with pytest.raises(FmuError, match=r"bad.fmu is encrypted \('modelDescription.xml'\)"):
        describe(path)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "bad.fmu is no zip archive, so it is no FMU; give an .fmu file, or export it again"),
        (
            b"PK\x03\x04 and no more",
            "bad.fmu is no zip archive, so it is no FMU; give an .fmu file, or export it again",
        ),
        (None, "bad.fmu has no modelDescription.xml, so it is no FMU"),
    ],
)
def test_what_is_no_fmu_is_told(tmp_path, data, sentence):
    path = tmp_path / "bad.fmu"
    if data is None:
        archive(path, [("readme", "")], description=None)
    else:
        path.write_bytes(data)
    with pytest.raises(FmuError) as caught:
        describe(path)
    assert str(caught.value) == sentence


def test_an_identifier_that_leads_elsewhere_is_refused(tmp_path):
    text = XML.replace('Identifier="m"', 'Identifier="../../m"')
    with pytest.raises(FmuError, match=r"the model identifier '\.\./\.\./m' is no name of a library"):
        describe(archive(tmp_path / "bad.fmu", description=text))


def test_inspect_static_executes_nothing(tmp_path, capsys):
    trap = tmp_path / "executed"
    fmu = foreign_fmu(tmp_path / "fmu")
    source = tmp_path / "trap.c"
    source.write_text(
        "#include <stdio.h>\n__attribute__((constructor)) void trap(void) {"
        f' FILE *f = fopen("{trap}", "w"); if (f) fclose(f); }}\n#include "fmi2.c"\n'
    )
    from foreign_fmus import SOURCES, fmpy

    from fmu_build.compiler import compile_library, fmi_headers

    library = tmp_path / "trap.so"
    compile_library(source, library, include=[SOURCES, fmi_headers()])
    buffer = io.BytesIO()
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(buffer, "w") as new:
        new.writestr("modelDescription.xml", old.read("modelDescription.xml"))
        new.write(library, f"binaries/{fmpy.platform}/foreign{fmpy.sharedLibraryExtension}")
    fmu.write_bytes(buffer.getvalue())
    assert main(["inspect", str(fmu), "--static"]) == 0
    assert "motor.Ra" in capsys.readouterr().out and not trap.exists()
    assert main(["inspect", str(fmu)]) == 0
    assert "it loads and runs" in capsys.readouterr().out and trap.exists()


def described(path, variables):
    text = '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="{1}"><CoSimulation modelIdentifier="m"/>'
    text += f"<ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", text)
    return path


def variable(k, name="x"):
    return f'<ScalarVariable name="{name}{k}" valueReference="{k}" causality="local"><Real/></ScalarVariable>'


def test_sixty_thousand_variables_are_read_within_three_seconds(tmp_path):
    large = described(tmp_path / "large.fmu", "".join(variable(k, "motor.part[3].x") for k in range(60_000)))
    began = time.process_time()
    assert len(describe(large).variables) == 60_000
    assert time.process_time() - began < 3


def test_half_a_million_variables_are_told(tmp_path):
    huge = described(tmp_path / "huge.fmu", "".join(variable(k) for k in range(500_000)))
    began = time.process_time()
    with pytest.raises(FmuError, match="has 500000 variables, more than 200000; export the FMU without its protected"):
        describe(huge)
    assert time.process_time() - began < 3


def test_a_name_of_a_megabyte_is_told(tmp_path):
    with pytest.raises(FmuError, match="modelDescription.xml has a name of more than 20000 characters"):
        describe(described(tmp_path / "long.fmu", variable(1, "x" * 1_000_000)))
