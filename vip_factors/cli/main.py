"""``vip-factors``: finds the command, runs it; what the user can mend, and signals, end it with a line and a code.

``vip-factors --completion``: a script with which a shell completes commands and their options.
"""

import io
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from types import FrameType
from typing import Any

from vip_factors import __version__
from vip_factors.cli.terminal import printable
from vip_factors.errors import InputError, VipFactorsError, naming_file

SHELLS = ("bash", "zsh", "fish")
OPTION = re.compile(r"(?<![\w.-])--?[a-z][a-z0-9.-]*")
WIDE = "120"  # columns: no option's name is broken, and help does not lay its boxes side by side
PROGRAM = "vip-factors"
BAD_INPUT = 2
# Name → one line. The module of the same name (with _ for -) holds ``main(options)``, imported when asked for.
COMMANDS = {
    "demo": "reconstruct a recording that the package makes itself",
    "convert": "bring sensor logs, 2D poses and a camera into one recording",
    "detect": "find the 2D poses of everybody in a video",
    "run": "from a video and sensor logs to motion and a report",
    "calibrate-camera": "find a camera's focal length, distortion and the floor",
    "info": "say what a recording, a scene or an estimate holds",
    "body": "write the body that was found into a file, for the next time",
    "simulate": "make a recording, or a filmed scene, with known truth",
    "sync": "find the offset between the clocks of video and sensors",
    "smooth": "reconstruct: motion, headings, mountings, camera, who is who",
    "graph": "draw the factor graph of a recording, with counts",
    "stream": "track sensors and detections as they arrive",
    "evaluate": "compare an estimate with the truth",
    "export": "write an estimate into files of other programs",
    "report": "write an estimate as one page for people",
    "gait": "tell how somebody walked: strides, figures, joint angles",
    "repetitions": "tell squats, lunges, jumps and curls, and jump heights",
    "view": "look at recordings and estimates in Rerun",
}
# Named by ``--help``; told, as all are, by ``--help-all``.
FURTHER = ("calibrate-camera", "body", "simulate", "sync", "evaluate", "graph")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: without the program's name; those of the process if None.

    Returns:
        The exit code: 0, 2 for what the user can mend (bad options, files or recordings), 130 after Ctrl-C,
        143 after SIGTERM.
        Anything unforeseen is raised, with its traceback.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    open_streams()
    with ending() as asked:
        try:
            return _run(given)
        except KeyboardInterrupt:
            pass
        except ImportError:  # what compiled modules make of a signal that comes while they are loaded
            if not asked.number:
                raise
    print(f"{PROGRAM}: interrupted; nothing half-written is left", file=sys.stderr)
    return asked.exit_code


def _run(given: list[str]) -> int:
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _Notes().show
            code = _dispatched(given)
            sys.stdout.flush()
            return code
    except BrokenPipeError:  # the reader of our output, ``head`` say, has seen enough
        sys.stderr.close()
        return 0
    except (VipFactorsError, OSError) as error:
        if isinstance(error, OSError) and error.filename == STANDARD_OUTPUT:
            give_up_output()
        print(f"{PROGRAM}: {_sentence(error)}", file=sys.stderr)
        return BAD_INPUT


def _dispatched(given: list[str]) -> int:
    if not given or given[0] in ("-h", "--help", "--help-all", "help"):
        print(_help(every="--help-all" in given))
        return 0 if given else BAD_INPUT
    if given[0] == "--version":
        print(f"{PROGRAM} {__version__}")
        return 0
    if given[0].partition("=")[0] == "--completion":
        shell = given[1] if len(given) > 1 else given[0].partition("=")[2]
        print(completion(shell, PROGRAM, COMMANDS), end="")
        return 0
    command = _command(given[0])
    try:
        from vip_factors.cli.many_tasks import is_many
        from vip_factors.cli.options import run_command

        if is_many(command, given[1:]):
            from vip_factors.cli import many

            return many.main(command, f"{PROGRAM} {command}", given[1:])
        run_command(command, f"{PROGRAM} {command}", given[1:])
    except SystemExit as stop:  # how the parser of options ends, after help or a complaint
        return stop.code if isinstance(stop.code, int) else BAD_INPUT if stop.code else 0
    return 0


def _command(name: str) -> str:
    from difflib import get_close_matches

    if name in COMMANDS:
        return name
    near = get_close_matches(name, COMMANDS, n=1)
    hint = f", did you mean '{near[0]}'" if near else ""
    raise InputError(f"unknown command '{name}'{hint}; commands are {', '.join(COMMANDS)}")


class _Notes:
    """Warnings as lines, each once: a file that is read in several passes is as cut off in every one of them."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def show(self, message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        """A warning as one line: what was left out of a file, say; where in our code it arose helps nobody."""
        line = printable(f"{PROGRAM}: note: {' '.join(str(message).split())}")
        if line not in self._told:
            self._told.add(line)
            print(line, file=sys.stderr)


def _sentence(error: Exception) -> str:
    """The message on one line; of an OSError the file first."""
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        text = str(error) or type(error).__name__
    return printable(" ".join(text.split()))


def _help(every: bool) -> str:
    """A screen, or every command."""
    shown = COMMANDS if every else {name: line for name, line in COMMANDS.items() if name not in FURTHER}
    more = [] if every else [f"More: {', '.join(FURTHER)}"]
    return "\n".join(
        [
            f"usage: {PROGRAM} COMMAND [OPTIONS]",
            "",
            "Body-worn inertial sensors and one camera in, 3D human motion out.",
            "",
            *(f"  {name:<{max(map(len, shown))}}  {line}" for name, line in shown.items()),
            "",
            *more,
            "COMMAND --help tells its usual options, --help-all all of them;",
            "--version the version; --completion bash (zsh, fish) a script for the shell.",
        ]
    )


STANDARD_OUTPUT = "standard output"
ENDING = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """Which signal has asked for the end, if any has.

    Attributes:
        number: of the signal; 0 without one.
    """

    def __init__(self) -> None:
        self.number = 0
        self._process = os.getpid()

    @property
    def exit_code(self) -> int:
        """What shells report for a program that the signal stopped; 130 for Ctrl-C."""
        return 128 + (self.number or signal.SIGINT)

    def ask(self, number: int, frame: FrameType | None) -> None:
        """As a handler: the end comes as KeyboardInterrupt, so that everything half-written is removed.

        Raises:
            KeyboardInterrupt: always, in this process; its forks end as without a handler.
        """
        if os.getpid() != self._process and number == signal.SIGTERM:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self.number = number
        raise KeyboardInterrupt


@contextmanager
def ending() -> Iterator[Ending]:
    """Take the signals that ask for the end; those that somebody else takes, or ignores, are left to them."""
    found, before = Ending(), {}
    if threading.current_thread() is threading.main_thread():
        for number in ENDING:
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                before[number] = signal.signal(number, found.ask)
    try:
        yield found
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _StandardOutput(io.FileIO):
    """Standard output, whose errors name it: to the system it is a number."""

    def write(self, data: Any, /) -> int:
        with naming_file(STANDARD_OUTPUT):
            return super().write(data)


def open_streams() -> None:
    """Make sure that there is an output to write to, and that it takes all characters: what it has not is escaped."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  # for as long as we live
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
            if name == "stdout" and type(stream) is io.TextIOWrapper:
                sys.stdout = _named_stream(stream)


def _named_stream(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The same output with a name; Python itself keeps the first one open, as ``sys.__stdout__``."""
    if stream is not sys.__stdout__:
        return stream
    stream.flush()
    raw = _StandardOutput(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw), stream.encoding, stream.errors, line_buffering=stream.line_buffering
    )


def give_up_output() -> None:
    """Forget what could not be written to standard output, or Python would try once more at its end."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # for as long as we live


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
    from vip_factors.cli.options import run_command

    told, before = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = WIDE
    try:
        with redirect_stdout(told), suppress(SystemExit):
            run_command(command, f"{program} {command}", ["--help-all"])
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
