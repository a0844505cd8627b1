"""Completion of the command line in bash, zsh and fish, made from the parser. Knows shells, no command's work."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

SHELLS = ("bash", "zsh", "fish")


@dataclass(frozen=True)
class Command:
    """What can follow a command: its options, and the words that an option takes."""

    name: str
    help: str
    options: tuple[tuple[str, str], ...]  # option, help
    choices: tuple[tuple[str, tuple[str, ...]], ...]  # option, words
    words: tuple[str, ...] = ()  # that stand by themselves


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a script that completes commands, options and their words; files where any other word stands.

    Parameters
    ----------
    shell : "bash", "zsh" or "fish"
    """
    commands = _commands(parser)
    if shell == "fish":
        return _fish(parser.prog, commands)
    script = _bash(parser.prog, commands)
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def _commands(parser: argparse.ArgumentParser) -> list[Command]:
    found = []
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction):
            continue
        helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, sub in action.choices.items():
            options = [(o, a.help or "") for a in sub._actions for o in a.option_strings]
            choices = [(o, tuple(map(str, a.choices))) for a in sub._actions for o in a.option_strings if a.choices]
            words = [str(c) for a in sub._actions if not a.option_strings and a.choices for c in a.choices]
            found.append(Command(name, helps.get(name, ""), tuple(options), tuple(choices), tuple(words)))
    return found


def _bash(program: str, commands: Sequence[Command]) -> str:
    names = " ".join(command.name for command in commands)
    lines = [
        f"_{_identifier(program)}() {{",
        '    local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}"',
        '    local command="${COMP_WORDS[1]}" words=""',
        '    if [ "$COMP_CWORD" -eq 1 ]; then',
        f'        COMPREPLY=($(compgen -W "{names} --help --version" -- "$word")); return',
        "    fi",
        '    case "$command $before" in',
    ]
    for command in commands:
        for option, choices in command.choices:
            lines.append(f'        "{command.name} {option}") words="{" ".join(choices)}" ;;')
    lines += ["        *)", '            case "$command" in']
    for command in commands:
        listed = " ".join([*command.words, *(option for option, _ in command.options)])
        plain = f'[[ "$word" == -* ]] && words="{listed}"' if not command.words else f'words="{listed}"'
        lines.append(f"                {command.name}) {plain} ;;")
    lines += [
        "            esac ;;",
        "    esac",
        '    if [ -n "$words" ]; then COMPREPLY=($(compgen -W "$words" -- "$word"))',
        '    else COMPREPLY=($(compgen -f -- "$word")); fi',
        "}",
        f"complete -o filenames -F _{_identifier(program)} {program}",
    ]
    return "\n".join(lines) + "\n"


def _fish(program: str, commands: Sequence[Command]) -> str:
    lines = []
    for command in commands:
        lines.append(
            f"complete -c {program} -n __fish_use_subcommand -f -a {command.name} -d {shlex.quote(command.help)}"
        )
        seen = f"-n '__fish_seen_subcommand_from {command.name}'"
        words = dict(command.choices)
        for option, text in command.options:
            kind = f"-l {option[2:]}" if option.startswith("--") else f"-s {option[1:]}"
            taken = f" -x -a {shlex.quote(' '.join(words[option]))}" if option in words else ""
            plain = text.replace("%(default)s", "the usual")
            lines.append(f"complete -c {program} {seen} {kind}{taken} -d {shlex.quote(plain)}")
        if command.words:
            lines.append(f"complete -c {program} {seen} -f -a {shlex.quote(' '.join(command.words))}")
    return "\n".join(lines) + "\n"


def _identifier(program: str) -> str:
    return program.replace("-", "_")
