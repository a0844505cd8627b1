"""One case file, many cases: patterns of recordings, tables of motors (expansion.py, case.py, strict_toml.py)."""

from pathlib import Path

import pytest

from estimator.cases.case import read_case, read_cases
from estimator.errors import CaseError

MOTORS = "serial; R; J\nA1; 3.1; 9e-6\n\n# comment\nB2; 2.9;\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("motor_10.csv", "motor_2.csv", "A1_1.csv", "A1_2.csv", "B2_1.csv", "odd[1].csv"):
        (tmp_path / name).write_text("")
    (tmp_path / "motors.csv").write_text(MOTORS)
    return tmp_path


def cases_of(folder: Path, text: str, **options):
    (folder / "line.case.toml").write_text(text)
    return read_cases(folder / "line.case.toml", **options)


def test_a_pattern_is_a_case_for_each_recording(folder):
    cases = cases_of(folder, '[[recording]]\nfile = "motor_*.csv"\n')
    assert [case.name for case in cases] == ["line[motor_10]", "line[motor_2]"]
    assert [case.recordings for case in cases] == [(folder / "motor_10.csv",), (folder / "motor_2.csv",)]


def test_a_file_whose_name_looks_like_a_pattern_is_that_file(folder):
    (case,) = cases_of(folder, '[[recording]]\nfile = "odd[1].csv"\n')
    assert case.recordings == (folder / "odd[1].csv",)
    assert case.name == "line"


def test_recordings_of_one_name_in_several_folders_are_told_apart(folder):
    for name in ("mon", "tue"):
        (folder / name).mkdir()
        (folder / name / "run.csv").write_text("")
    cases = cases_of(folder, '[[recording]]\nfile = "**/run.csv"\n')
    assert [case.name for case in cases] == ["line[mon/run.csv]", "line[tue/run.csv]"]


def test_a_table_of_motors_is_a_case_for_each_row(folder):
    cases = cases_of(
        folder,
        '[motors]\nfile = "motors.csv"\n[[recording]]\nfile = "{serial}_1.csv"\n'
        '[parameters]\nR = { nominal = "{R}" }\nJ = { start = "{J}" }\n[expect]\nR = { within = "1 %" }\n',
    )
    assert [case.name for case in cases] == ["line[A1]", "line[B2]"]
    assert [case.recordings[0].name for case in cases] == ["A1_1.csv", "B2_1.csv"]
    assert [case.parameters["R"].nominal for case in cases] == [3.1, 2.9]
    assert [case.parameters["J"].start for case in cases] == [9e-6, None]  # an empty cell leaves the key out


def test_runs_of_each_motor_are_cases_of_that_motor(folder):
    cases = cases_of(folder, '[motors]\nfile = "motors.csv"\n[[recording]]\nfile = "{serial}_*.csv"\n')
    assert [(case.motor, case.recording_of) for case in cases] == [("A1", "A1_1"), ("A1", "A1_2"), ("B2", "B2_1")]
    assert cases[0].name == "line[A1,A1_1]"


def test_another_column_may_name_the_motors_and_a_number_may_stand_in_a_text(folder):
    (folder / "motors.csv").write_text("batch,id\n7,A1\n7,B2\n")
    cases = cases_of(
        folder,
        '[motors]\nfile = "motors.csv"\nname = "id"\n[search]\nseed = "{batch}"\n[[recording]]\nfile = "{id}_1.csv"\n',
    )
    assert [case.motor for case in cases] == ["A1", "B2"]
    assert cases[0].search.seed == 7


def test_recordings_may_be_taken_from_another_folder(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "motor_3.csv").write_text("")
    for text in ("motor_*.csv", str(folder / "motor_*.csv"), "../gone/motor_*.csv"):
        (case,) = cases_of(folder, f'[[recording]]\nfile = "{text}"\n', recordings=other)
        assert case.recordings == (other / "motor_3.csv",)
    with pytest.raises(CaseError, match=r"there is no recording 'motor_2\.csv' in .*other$"):
        cases_of(folder, '[[recording]]\nfile = "motor_2.csv"\n', recordings=other)


def test_a_table_whose_columns_no_comma_separates_may_have_decimal_commas(folder):
    text = ROWS + '[expect]\nR = { value = "{R}", within = "{near}" }\n[fixed]\nload = "{load}"\n'
    (folder / "motors.csv").write_text("serial;R;near;load\nA1;3,14;0,5 %;-1,5e-3\n")
    (case,) = cases_of(folder, text)
    assert (case.expect["R"].value, case.expect["R"].fraction) == (3.14, 0.005)
    assert case.fixed == {"load": -1.5e-3}
    (folder / "motors.csv").write_text('serial,R,near,load\nA1,3.14,1 %,"1,000"\n')
    with pytest.raises(CaseError, match="load must be a number, not the text '1,000'"):  # a thousand, or one?
        cases_of(folder, text)


def test_a_cell_of_a_table_may_go_over_lines(folder):
    """A remark of a spreadsheet; it ended in an internal error."""
    (folder / "motors.csv").write_text('serial,remark\n# of Monday\nA1,"noisy\nbearing"\nB2,good\n')
    assert [case.motor for case in cases_of(folder, ROWS)] == ["A1", "B2"]
    (folder / "motors.csv").write_text('serial,remark\nA1,"noisy\nbearing"\nB2\n')
    with pytest.raises(CaseError, match="motors.csv line 4 has 1 cells, the header 2"):
        cases_of(folder, ROWS)
    (folder / "motors.csv").write_text('serial,remark\nA1,"' + "noisy\n" * 30_000)
    with pytest.raises(CaseError, match="motors.csv line 2 cannot be read"):
        cases_of(folder, ROWS)


ROWS = '[motors]\nfile = "motors.csv"\n[[recording]]\nfile = "{serial}_1.csv"\n'
WRONG = {
    "no match": (
        '[[recording]]\nfile = "none_*.csv"\n',
        MOTORS,
        r"line 2: no recording matches 'none_\*\.csv'; paths are relative to the case file's folder$",
    ),
    "pattern beside others": (
        '[[recording]]\nfile = "motor_2.csv"\n[[recording]]\nfile = "A1_*.csv"\n',
        MOTORS,
        r"line 4: the pattern 'A1_\*\.csv' stands beside other recordings; .*, so leave the others out$",
    ),
    "no such column": (
        ROWS.replace("{serial}", "{seral}"),
        MOTORS,
        r"line 4: the table of motors has no column 'seral'; did you mean 'serial'\? \(serial, R, J\)$",
    ),
    "no such name column": (
        ROWS.replace("[[", 'name = "id"\n[['),
        MOTORS,
        r"line 3: motors\.csv has no column 'id' \(serial, R, J\)$",
    ),
    "misspelt key": (
        ROWS.replace("file", "fiel", 1),
        MOTORS,
        r"line 2: there is no key 'fiel' in motors; did you mean 'file'\? \(file, name\)$",
    ),
    "no table": (ROWS.replace("motors.csv", "m.csv"), MOTORS, r"line 2: there is no table of motors 'm\.csv'; paths"),
    "no row": (ROWS, "serial\n", r"line 2: motors\.csv has no row below its header; add one for each motor$"),
    "short row": (ROWS, "serial,R\nA1\n", r"line 2: motors\.csv line 2 has 1 cells, the header 2$"),
    "nameless": (ROWS, "serial,R\nA1,1\n,2\n", r"line 2: motors\.csv line 3 has no serial; every row needs one$"),
    "twice": (ROWS, "serial,R\nA1,1\nA1,2\n", r"motors\.csv lines 2 and 3 are both 'A1'; each needs its own$"),
    "column twice": (
        ROWS,
        "serial,serial\nA1,1\n",
        r"motors\.csv line 1: the column 'serial' is not unique; name each",
    ),
    "no text": (ROWS, b"serial\n\xff\n", r"line 2: motors\.csv cannot be read; save it as CSV in UTF-8$"),
    "a row's fault": (
        ROWS,
        "serial\nA1\nC3\n",
        r"line 4 \(with motors\.csv line 3, C3\): there is no recording 'C3_1\.csv'; paths",
    ),
    "no number": (
        ROWS + '[fixed]\nload = "{R}"\n',
        "serial,R\nA1,high\n",
        r"line 6 \(with motors\.csv line 2, A1\): fixed\.load must be a number, not the text 'high'$",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_in_one_sentence_with_file_and_line(name, folder):
    text, table, message = WRONG[name]
    (folder / "motors.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    with pytest.raises(CaseError, match=message) as error:
        cases_of(folder, text)
    assert str(error.value).startswith("line.case.toml line ")
    assert "\n" not in str(error.value)


def test_a_single_case_is_asked_for_in_vain_where_there_are_many(folder):
    cases_of(folder, '[[recording]]\nfile = "motor_*.csv"\n')
    with pytest.raises(
        CaseError, match=r"^line\.case\.toml means 2 cases; run them with the command batch, or by pytest$"
    ):
        read_case(folder / "line.case.toml")
