"""Folders and files that are there completely or not at all."""

import os
import signal
import stat
from pathlib import Path

import pytest
from interrupts import taking_interrupts

from estimator.errors import InputError
from estimator.output import OutputFolder, write_files


def test_a_folder_is_made_with_its_parents_and_filled(tmp_path):
    with OutputFolder(tmp_path / "a" / "b") as folder:
        folder.write({"x": b"1", "y": b"2"})
    assert {p.name: p.read_bytes() for p in (tmp_path / "a" / "b").iterdir()} == {"x": b"1", "y": b"2"}


def test_a_folder_that_was_made_for_nothing_is_removed_again(tmp_path):
    with pytest.raises(RuntimeError), OutputFolder(tmp_path / "a" / "b"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_existed_stays_with_what_was_in_it(tmp_path):
    (tmp_path / "mine").write_bytes(b"1")
    with pytest.raises(RuntimeError), OutputFolder(tmp_path):
        raise RuntimeError
    assert (tmp_path / "mine").read_bytes() == b"1"


def test_stale_results_are_removed_and_other_files_are_not(tmp_path):
    for name in ("old", "mine"):
        (tmp_path / name).write_bytes(b"1")
    with OutputFolder(tmp_path) as folder:
        folder.write({"x": b"2"}, stale=("x", "old", "never"))
    assert {p.name for p in tmp_path.iterdir()} == {"x", "mine"}


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "f").write_bytes(b"")
    with pytest.raises(InputError, match="f is a file, not a folder; give -o another name"):
        OutputFolder(tmp_path / "f").__enter__()


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "f").write_bytes(b"")
    with pytest.raises(InputError, match=r"cannot write there \(Not a directory\); give -o a folder of yours"):
        OutputFolder(tmp_path / "f" / "g").__enter__()


def test_a_folder_with_other_files_is_not_ours(tmp_path):
    (tmp_path / "thesis.tex").write_bytes(b"")
    (tmp_path / "x").write_bytes(b"")
    with pytest.raises(InputError, match=r"already holds other files \(thesis.tex\); give -o an empty"):
        OutputFolder(tmp_path, own=("x", "y")).__enter__()
    (tmp_path / "thesis.tex").unlink()
    with OutputFolder(tmp_path, own=("x", "y")):
        pass


def test_either_all_files_are_written_or_none(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="b is a folder; give the name of a file"):
        write_files({tmp_path / "a": b"new", tmp_path / "b": b"new"})
    assert (tmp_path / "a").read_bytes() == b"old"
    assert {p.name for p in tmp_path.iterdir()} == {"a", "b"}


def test_a_place_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no/x: cannot be written \(No such file or directory\)"):
        write_files({tmp_path / "no" / "x": b""})


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"a: cannot be written \(No space left on device\)"):
        write_files({tmp_path / "a": b"new"})
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"old")]


def test_a_link_stays_a_link_and_a_device_stays_a_device(tmp_path):
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_files({tmp_path / "link": b"new"})
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_bytes() == b"new"
    fifo = tmp_path / "null"
    fifo.symlink_to(os.devnull)
    write_files({fifo: b"gone"})
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_files_have_the_rights_of_any_new_file(tmp_path):
    (tmp_path / "plain").touch()
    write_files({tmp_path / "a": b""})
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_folder_that_another_run_makes_at_the_same_moment_is_used_and_left_to_it(tmp_path, monkeypatch):
    make = Path.mkdir

    def made_by_another_first(self, *args, **kwargs):
        make(self)
        make(self, *args, **kwargs)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", made_by_another_first)
        folder = OutputFolder(tmp_path / "new" / "out").__enter__()
    folder.__exit__()
    assert (tmp_path / "new" / "out").is_dir()


@pytest.mark.parametrize("where", [(Path, "mkdir"), (Path, "iterdir"), (Path, "rmdir")], ids=["made", "tried", "left"])
def test_ctrl_c_while_a_folder_is_made_or_left_leaves_nothing(tmp_path, monkeypatch, where):
    pressed = with_ctrl_c_after(monkeypatch, *where)
    with taking_interrupts(), pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path / "a" / "b"):
        pass
    assert pressed and not (tmp_path / "a").exists()


def test_ctrl_c_while_files_get_their_names_gives_all_or_none(tmp_path, monkeypatch):
    pressed = with_ctrl_c_after(monkeypatch, os, "replace")
    with taking_interrupts(), pytest.raises(KeyboardInterrupt):
        write_files({tmp_path / "a": b"new", tmp_path / "b": b"new"})
    assert pressed and {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def with_ctrl_c_after(monkeypatch, owner, name):
    """Press Ctrl-C once, right after a function has done its work; return what was pressed so far."""
    done, pressed = getattr(owner, name), []

    def then_pressed(*arguments, **options):
        result = done(*arguments, **options)
        if not pressed:
            pressed.append(name)
            signal.raise_signal(signal.SIGINT)
        return result

    monkeypatch.setattr(owner, name, then_pressed)
    return pressed


def test_a_folder_that_another_run_has_locked_is_left_to_it_by_the_run_that_made_it(tmp_path, monkeypatch):
    """It was removed, empty as it was, under the run that had locked it first: both ended without a result."""
    from estimator import output

    made, first = tmp_path / "out", []

    def locked_by_another(folder):
        first.append(real(folder))
        monkeypatch.setattr(output, "_locked", real)
        return real(folder)

    real = output._locked
    monkeypatch.setattr(output, "_locked", locked_by_another)
    with pytest.raises(InputError, match="another run is at work in"), OutputFolder(made):
        raise AssertionError
    os.close(first[0])
    assert made.is_dir()
    with OutputFolder(made, own=("a",)) as folder:
        folder.write({"a": b"1"})
    assert (made / "a").read_bytes() == b"1"
