"""Completion, asked of the shells themselves."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import shtab

from estimator.cli import main
from estimator.commands import completion
from estimator.commands.arguments import command_line
from estimator.commands.result_arguments import SHELLS
from estimator.method_names import METHODS


def script(shell: str) -> str:
    return completion.completion(command_line(), shell)


def bash_completes(line: str, *, cwd: Path) -> set[str]:
    """Return what bash would offer behind a line."""
    words = line.split(" ")
    listed = " ".join(f"'{word}'" for word in words)
    place = f"COMP_WORDS=({listed}); COMP_CWORD={len(words) - 1}"
    ask = f"{place}; _shtab_fmu_estimator; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    done = subprocess.run([bash, "-c", f"{script('bash')}\n{ask}"], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == ""
    return set(done.stdout.split())


def test_bash_completes_commands_options_their_words_and_files(tmp_path):
    (tmp_path / "step.csv").touch()
    assert bash_completes("fmu-estimator est", cwd=tmp_path) == {"estimate"}
    assert {"demo", "estimate", "export"} <= bash_completes("fmu-estimator ", cwd=tmp_path)
    assert bash_completes("fmu-estimator --v", cwd=tmp_path) == {"--version"}
    assert bash_completes("fmu-estimator estimate --me", cwd=tmp_path) == {"--method"}
    assert bash_completes("fmu-estimator estimate --method ", cwd=tmp_path) == set(METHODS)
    assert bash_completes("fmu-estimator export out --format m", cwd=tmp_path) == {"matlab", "modelica"}
    assert bash_completes("fmu-estimator estimate st", cwd=tmp_path) == {"step.csv"}
    assert bash_completes("fmu-estimator estimate a --validate st", cwd=tmp_path) == {"step.csv"}
    assert bash_completes("fmu-estimator completion b", cwd=tmp_path) == {"bash"}


@pytest.mark.parametrize("shell", ["zsh", "fish", "tcsh"])
def test_other_shells_read_the_script(shell, tmp_path):
    path = shutil.which(shell)
    text = script(shell)
    assert "estimate" in text and "steiglitz-mcbride" in text
    if path is None:
        pytest.skip(f"{shell} is not installed")
    file = tmp_path / "script"
    file.write_text(text)
    done = subprocess.run(
        [path, "-n", str(file)], capture_output=True, text=True, env={**os.environ, "HOME": str(tmp_path)}
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_command_prints_the_script(capsys):
    assert set(SHELLS) <= set(shtab.SUPPORTED_SHELLS)
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out == script("bash")
