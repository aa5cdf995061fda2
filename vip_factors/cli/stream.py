"""``vip-factors stream``: samples in as they arrive, poses out as they are known."""

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.named import named_tree
from vip_factors.cli.options import Flag, parse
from vip_factors.cli.rerun_targets import STREAM_INSTEAD, check_display, check_rerun_file
from vip_factors.configurations import Configuration
from vip_factors.errors import InputError
from vip_factors.io.live.settings import LiveSourceSettings
from vip_factors.live.settings import LiveSettings

if TYPE_CHECKING:
    from vip_factors.cli.stream_session import Interrupts, Session
    from vip_factors.cli.terminal import StatusLine
    from vip_factors.io.live.source import LiveSource
    from vip_factors.io.live_mcap import LiveMcapSink
    from vip_factors.sensors.live import LiveSetup
    from vip_factors.viz.live_rerun import LiveRerunSink

INTERRUPTED = 130  # what shells report for a program stopped by Ctrl-C


@dataclass(frozen=True)
class StreamOptions:
    """Track a stream: every frame is answered with the newest pose, and with the smoothed one of a lag earlier.

    SOURCE is a recording (.mcap), played back, or followed while another program writes it; - for standard input;
    tcp://host:port or ws://host:port to listen there; tcp-connect://host:port to connect to a sender.

    Ctrl-C ends the stream and completes the files. Every setting of the pipeline is an option; --settings reads them
    from a file, and options win over it.
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Where samples come from."""
    out: Path | None = None
    """Estimate (.mcap) to write as it goes: FILE.partial.mcap until the stream ends, readable even after a crash."""
    json: Flag = False
    """Write a line of JSON a frame to standard output."""
    rerun: Flag = False
    """Open Rerun's viewer and show it all."""
    rerun_save: Path | None = None
    """Rerun file (.rrd) to write."""
    rerun_connect: str | None = None
    """Show it in a viewer that runs already, at rerun+http://host:9876/proxy say."""
    rerun_serve: int | None = None
    """Port on which Rerun's viewers may connect."""
    real_time: Flag = False
    """Play a recording back in its own time instead of as fast as it can be tracked."""
    follow: Flag = False
    """Wait for more at the end of the file: another program still writes it."""
    lag: float | None = None
    """Seconds between the newest pose and the smoothed one; the same as --lag-s."""
    configuration: Configuration = Configuration.OWN
    """Settings to start from: this package's own, or those that stand for the estimators of Kaichi et al. 2020, which
    want a camera of known pose. A settings file may name one too (configuration = "kaichi-full")."""
    settings: Path | None = None
    """TOML file with settings; a table for each group, such as [walk]."""
    overwrite: Flag = False
    """Replace files that exist."""
    limits: LiveSourceSettings = field(default_factory=LiveSourceSettings)
    tree: Annotated[LiveSettings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=LiveSettings)


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(StreamOptions, prog, arguments, _defaults(arguments), none_is_a_value=True)
    if options.lag is not None:
        options = replace(options, tree=replace(options.tree, lag_s=options.lag))
    _check(options)
    from threadpoolctl import threadpool_limits

    from vip_factors.cli.stream_session import Interrupts
    from vip_factors.cli.terminal import StatusLine

    # Lines of JSON on the same terminal would run into the status.
    line = StatusLine(wanted=not (options.json and sys.stdout.isatty()))
    with Interrupts() as interrupts:
        # Products of small matrices: a second thread in each costs more than it brings.
        with line, threadpool_limits(limits=1, user_api="blas"):
            session, told = _run(options, interrupts, line)
        _conclude(options, session, told, interrupts.asked)


def _check(options: StreamOptions) -> None:
    from vip_factors.io.atomic import check_target

    check_rerun_file("--rerun-save", options.rerun_save)
    if options.rerun:
        check_display(STREAM_INSTEAD)
    for wanted in (options.out, options.rerun_save):
        if wanted is not None:
            check_target(wanted, options.overwrite)
    if not 0 < options.tree.lag_s < float("inf"):
        raise InputError(f"a lag of {options.tree.lag_s:g} s: expected a positive number of seconds, such as 0.25")


def _run(options: StreamOptions, interrupts: "Interrupts", line: "StatusLine") -> tuple["Session", list[str]]:
    """Track until the end; returns what was counted, and what is to be said at last."""
    from vip_factors.cli.stream_session import Session
    from vip_factors.io.live.open import open_source
    from vip_factors.io.live_json import LiveJsonSink

    with ExitStack() as stack:
        source: LiveSource = open_source(
            options.source, follow=options.follow, real_time=options.real_time, settings=options.limits,
            tell=lambda finding: line.note(f"note: {finding.sentence}"),
        )  # fmt: skip
        from vip_factors.live.tracker import FixedLagTracker  # takes a second: before the clock runs

        stack.enter_context(source)
        line.show("waiting for the stream to begin")
        setup = interrupts.waiting_for(lambda: source.setup)
        played = Path(options.source).is_file() and not options.real_time  # as fast as it can be tracked
        tracker = FixedLagTracker(setup, options.tree, real_time=not played or options.follow)
        file = _file(options, setup, stack)
        viewers = _viewers(options, setup, stack)
        json = [LiveJsonSink(sys.stdout)] if options.json else []
        session = Session(tracker, [*json, *([file] if file is not None else [])], viewers, line)
        for item in interrupts.until_asked(iter(source)):
            session.take(item)
            if session.over:
                _silence_stdout()
                break
        session.finish()
        if file is not None:
            file.close()
        told = [sentence for viewer in viewers for sentence in viewer.close()]
        dropped = sum(viewer.dropped for viewer in viewers)
        if dropped:
            told.append(f"{dropped} frames were not drawn: Rerun was busy")
    return session, told


def _file(options: StreamOptions, setup: "LiveSetup", stack: ExitStack) -> "LiveMcapSink | None":
    if options.out is None:
        return None
    from vip_factors.cli.settings_file import flattened
    from vip_factors.io.live_mcap import LiveMcapSink

    settings = flattened(options.tree)
    return stack.enter_context(LiveMcapSink(options.out, setup, options.tree.frame_rate, settings, options.overwrite))


def _viewers(options: StreamOptions, setup: "LiveSetup", stack: ExitStack) -> "list[LiveRerunSink]":
    from vip_factors.viz.live_rerun import LiveRerunSink, LiveTarget

    targets = [LiveTarget()] if options.rerun else []
    if options.rerun_save is not None:
        targets.append(LiveTarget(save=options.rerun_save, overwrite=options.overwrite))
    if options.rerun_connect is not None:
        targets.append(LiveTarget(connect=options.rerun_connect))
    if options.rerun_serve is not None:
        targets.append(LiveTarget(serve=options.rerun_serve))
    viewers = []
    for target in targets:
        viewer = LiveRerunSink(setup, target, options.tree.frame_rate)
        stack.callback(viewer.close)
        viewers.append(viewer)
    return viewers


def _conclude(options: StreamOptions, session: "Session", told: Sequence[str], interrupted: bool) -> None:
    """The summary; beside lines of JSON on stderr, where it is no part of them."""
    from vip_factors.cli.stream_session import summary

    place = sys.stderr if options.json else sys.stdout
    for sentence in told:
        print(f"note: {sentence}", file=sys.stderr)
    if session.update_s:
        print(summary(session.update_s, options.tree.frame_rate), file=place)
        for path in (options.out, options.rerun_save):
            if path is not None and path.is_file():
                print(path, file=place)
    elif not interrupted:
        raise InputError(
            f"{options.source} ended before there was anything to answer: expected at least "
            f"{options.tree.start_s:g} s of samples of every placed sensor; nothing was written"
        )
    if interrupted:
        raise SystemExit(INTERRUPTED)


def _silence_stdout() -> None:
    """Nobody reads it: what is still in its buffer must not fail at the interpreter's end."""
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError):  # not a file
        return
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, descriptor)
    os.close(nothing)


def _defaults(arguments: Sequence[str]) -> StreamOptions | None:
    """The options' defaults, with those of a configuration or settings file if named."""
    tree = named_tree(arguments, LiveSettings())
    return None if tree is None else StreamOptions(source=tyro.MISSING, tree=tree)
