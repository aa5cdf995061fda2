"""``vip-factors --completion``: a script with which a shell completes commands and their options."""

import os
import re
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout, suppress
from importlib import import_module
from io import StringIO

from vip_factors.errors import InputError

SHELLS = ("bash", "zsh", "fish")
OPTION = re.compile(r"(?<![\w.-])--?[a-z][a-z0-9.-]*")
WIDE = "120"  # columns: no option's name is broken, and help does not lay its boxes side by side


def completion(shell: str, program: str, commands: Mapping[str, str]) -> str:
    """The script, to be read by the shell when it starts; it holds all words, and asks nobody.

    Args:
        shell: one of :data:`SHELLS`.
        program: what is completed.
        commands: name → what it does, in a line.

    Raises:
        InputError: for another shell.
    """
    if shell not in SHELLS:
        raise InputError(f"--completion {shell or 'of no shell'}: expected one of {', '.join(SHELLS)}")
    options = {command: command_options(program, command) for command in commands}
    if shell == "fish":
        return _fish(program, commands, options)
    return ("autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else "") + _bash(program, options)


def command_options(program: str, command: str) -> list[str]:
    """All options of a command, as its help names them."""
    told, before = StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = WIDE
    try:
        with redirect_stdout(told), suppress(SystemExit):
            module = import_module(f"vip_factors.cli.{command.replace('-', '_')}")
            module.main(f"{program} {command}", ["--help-all"])
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    return sorted({"--help-all", *_named(told.getvalue().splitlines())})


def _named(lines: Iterable[str]) -> Iterable[str]:
    """Options that head an entry: what help says of them may name others."""
    for line in lines:
        text = line.strip("│ ")
        if text.startswith("-"):
            yield from (word for word in OPTION.findall(text) if word != "-h")


def _bash(program: str, options: Mapping[str, Iterable[str]]) -> str:
    function = f"_{program.replace('-', '_')}"
    cases = "\n".join(f'    {command}) words="{" ".join(words)}" ;;' for command, words in options.items())
    return f"""{function}() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{" ".join(options)} --help --version --completion" -- "$word"))
    return
  fi
  case "${{COMP_WORDS[1]}}" in
{cases}
    --completion) words="{" ".join(SHELLS)}" ;;
  esac
  case "$word" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$word")) ;;
    *) [ "${{COMP_WORDS[1]}}" = --completion ] && COMPREPLY=($(compgen -W "$words" -- "$word")) ;;
  esac
}}
complete -o default -F {function} {program}
"""


def _fish(program: str, commands: Mapping[str, str], options: Mapping[str, Iterable[str]]) -> str:
    lines = []
    for command, line in commands.items():
        told = line.replace("'", "\\'")
        lines.append(f"complete -c {program} -n __fish_use_subcommand -f -a {command} -d '{told}'")
        for word in options[command]:
            lines.append(f"complete -c {program} -n '__fish_seen_subcommand_from {command}' -l {word.lstrip('-')}")
    return "\n".join([*lines, f"complete -c {program} -l completion -f -a '{' '.join(SHELLS)}'", ""])
