"""``vip-factors``: finds the command, runs it; what the user can mend, and signals, end it with a line and a code."""

import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NoReturn

from vip_factors import __version__
from vip_factors.cli.terminal import STANDARD_OUTPUT, Ending, give_up_output, printable, say
from vip_factors.errors import VipFactorsError, naming_file

PROGRAM = "vip-factors"
DESCRIPTION = "Body-worn inertial sensors and one camera in, 3D human motion out."
BAD_INPUT = 2
# Module of each command, imported when asked for, and its help. A command is a function, execute_….
COMMANDS = {
    "demo": ("recordings", "reconstruct a recording that the package makes itself"),
    "convert": ("convert", "bring sensor logs, 2D poses and a camera into one recording"),
    "detect": ("convert", "find the 2D poses of everybody in a video"),
    "run": ("smooth", "from a video and sensor logs to motion and a report"),
    "calibrate-camera": ("calibrate_camera", "find a camera's focal length, distortion and the floor"),
    "info": ("views", "say what a recording, a scene or an estimate holds"),
    "body": ("results", "write the body that was found into a file, for the next time"),
    "simulate": ("recordings", "make a recording, or a filmed scene, with known truth"),
    "sync": ("recordings", "find the offset between the clocks of video and sensors"),
    "smooth": ("smooth", "reconstruct: motion, headings, mountings, camera, who is who"),
    "graph": ("views", "draw the factor graph of a recording, with counts"),
    "stream": ("stream", "track sensors and detections as they arrive"),
    "evaluate": ("results", "compare an estimate with the truth"),
    "export": ("results", "write an estimate into files of other programs"),
    "report": ("views", "write an estimate as one page for people"),
    "gait": ("results", "tell how somebody walked: strides, figures, joint angles"),
    "repetitions": ("results", "tell squats, lunges, jumps and curls, and jump heights"),
    "view": ("views", "look at recordings and estimates in Rerun"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: without the program's name; those of the process if None.

    Returns:
        The exit code: 0, 2 for what the user can mend (bad options, files or recordings), 130 after Ctrl-C,
        143 after SIGTERM.
        Anything unforeseen is raised, with its traceback.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    open_streams()
    with Ending() as ending:
        try:
            return _run(words)
        except KeyboardInterrupt:
            pass
        except ImportError:  # what compiled modules make of a signal that comes while they are loaded
            if not ending.number:
                raise
    print(f"{PROGRAM}: interrupted; nothing half-written is left", file=sys.stderr)
    return ending.exit_code


def _run(words: list[str]) -> int:
    try:
        with warnings.catch_warnings():
            shown = set[str]()  # each once: a file that is read in several passes is as cut off in every one of them

            def show(message: Warning | str, *_: object, **__: object) -> None:
                line = printable(f"{PROGRAM}: note: {' '.join(str(message).split())}")
                if line not in shown:
                    shown.add(line)
                    print(line, file=sys.stderr)

            warnings.showwarning = show
            code = _dispatched(words)
            with naming_file(STANDARD_OUTPUT):
                sys.stdout.flush()
            return code
    except BrokenPipeError:  # the reader of our output, ``head`` say, has seen enough
        give_up_output()
        return 0
    except (VipFactorsError, OSError) as error:
        if isinstance(error, OSError) and error.filename == STANDARD_OUTPUT:
            give_up_output()
        print(f"{PROGRAM}: {_sentence(error)}", file=sys.stderr)
        return BAD_INPUT


def _dispatched(words: Sequence[str]) -> int:
    if words[:1] == ["--version"]:
        say(f"{PROGRAM} {__version__}")
        return 0
    try:
        if not words or words[0] not in COMMANDS:
            _run_without_command(words)
        command, *words = words
        if command in ("smooth", "stream") and not {"-h", "--help"} & {*words}:
            from vip_factors.cli import multi_file

            if multi_file.is_multi_file(command, words):
                return multi_file.main(command, options_of(command), words)
        run_command(command, words)
    except SystemExit as stop:  # how the parser of options ends, after help or a complaint
        return stop.code if isinstance(stop.code, int) else BAD_INPUT if stop.code else 0
    return 0


def run_command(command: str, words: Sequence[str]) -> None:
    """Run a command with the options that the words after it make.

    Raises:
        InputError: as :func:`~vip_factors.cli.options.parse`, and for a file that exists and may not be replaced, or
            cannot be written.
    """
    from vip_factors.cli.options import check_existing, parse

    options = parse(options_of(command), f"{PROGRAM} {command}", words)
    check_existing(options)
    _function(command)(options)


def options_of(command: str) -> type[Any]:
    """Dataclass of a command's options; the module of the command is imported."""
    options: type[Any] = _function(command).__annotations__["options"]
    return options


def _function(command: str) -> Callable[[Any], None]:
    module = import_module(f"vip_factors.cli.{COMMANDS[command][0]}")
    function: Callable[[Any], None] = getattr(module, f"execute_{command.replace('-', '_')}")
    return function


def _run_without_command(words: Sequence[str]) -> NoReturn:
    """Print help, a script that completes words in a shell, or what is wrong about words that name no command."""
    from tyro.extras import SubcommandApp

    completes = bool(words) and words[0] in ("--tyro-print-completion", "--tyro-write-completion")
    commands = SubcommandApp()
    for name, (_, line) in COMMANDS.items():
        commands.command(name=name, help=line)(options_of(name) if completes else lambda: None)
    commands.cli(prog=PROGRAM, description=DESCRIPTION, args=words)
    raise SystemExit(0)


def _sentence(error: Exception) -> str:
    """The message on one line; of an OSError the file first."""
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        text = str(error) or type(error).__name__
    return printable(" ".join(text.split()))


def open_streams() -> None:
    """Make sure that there is an output to write to, and that it takes all characters: what it has not is escaped."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  # for as long as we live
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
