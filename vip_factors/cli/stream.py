"""``vip-factors stream``: samples in as they arrive, poses out as they are known."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.atomic import check_partial, partial_path
from vip_factors.cli.options import (
    RERUN_FILE,
    UNPREFIXED,
    FailOn,
    Flag,
    Input,
    ManyOptions,
    Output,
    SettingsOptions,
    fail_on,
)
from vip_factors.cli.terminal import StatusLine, give_up_output, note, say
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.findings import verdict
from vip_factors.io.settings import LiveSourceSettings, SentPose
from vip_factors.ranges import Port
from vip_factors.settings import LiveSettings
from vip_factors.viz.viewer import check_display

if TYPE_CHECKING:
    from vip_factors.cli.stream_session import Interrupts, Session, Sink
    from vip_factors.io.live.source import LiveSource
    from vip_factors.io.live_server import LiveServer
    from vip_factors.sensors.scene import Scene
    from vip_factors.viz.live_rerun import LiveRerunSink

INSTEAD_OF_A_WINDOW = "--rerun-save FILE.rrd or --rerun-connect URL instead of --rerun"


@dataclass(frozen=True)
class StreamOptions(SettingsOptions, ManyOptions):
    """Track people live. Each frame gives the newest pose, and the smoothed pose of a lag earlier.

    SOURCE is one of:
    - FILE.mcap: a recording, played back, or followed while another program writes it (--follow).
    - ws://:PORT: a WebSocket for senders on this machine; ws://0.0.0.0:PORT for those in its networks.
    - -: standard input.

    Example: vip-factors stream ws://:5005 --web 8080 --out walk.estimate.mcap

    Ctrl-C or SIGTERM ends the stream and completes the files. Every setting is an option; --settings reads a file, and
    options override it.
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE"), Input()]
    """Where samples come from."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Estimate (.mcap) to write; FILE.partial.mcap until the stream ends, readable after a crash."""
    json: Flag = False
    """Write one line of JSON per frame to standard output."""
    rerun: Flag = False
    """Show the stream in Rerun."""
    rerun_save: Annotated[Path | None, RERUN_FILE] = None
    """Rerun file (.rrd) to write."""
    rerun_connect: str | None = None
    """Address of a running Rerun viewer or server, such as rerun+http://127.0.0.1:9876/proxy."""
    web: Port | None = None
    """Port of the web page; its /stream is a WebSocket with the answers as JSON."""
    web_host: str = "127.0.0.1"
    """Address of --web: 127.0.0.1 for this machine, 0.0.0.0 for all networks, with a token."""
    vmc: str | None = None
    """Send VMC messages for avatars to host:port (receivers usually use 39539); each further wearer uses the next
    port."""
    sent_pose: SentPose = SentPose.NEWEST
    """Pose in VMC messages: newest, or smoothed, which is one lag later."""
    real_time: Flag = False
    """Play a recording in real time instead of as fast as possible."""
    follow: Flag = False
    """Follow a file that another program is writing."""
    lag: float | None = None
    """Seconds between the newest pose and the smoothed one; the same as --lag-s."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""
    token_file: Path | None = None
    """File with the token that network clients must send; default: the environment variable VIP_FACTORS_TOKEN, or a
    generated token for networks and none on this machine."""
    limits: LiveSourceSettings = field(default_factory=LiveSourceSettings)
    settings: Annotated[LiveSettings, UNPREFIXED] = field(default_factory=LiveSettings)


def execute_stream(options: StreamOptions) -> None:
    """Run the command with its parsed options."""
    settings = options.settings if options.lag is None else replace(options.settings, lag_s=options.lag)
    _check(options)
    from threadpoolctl import threadpool_limits

    from vip_factors.cli.stream_session import Interrupts

    # Lines of JSON on the same terminal would run into the status.
    line = StatusLine(wanted=not (options.json and sys.stdout.isatty()))
    with Interrupts() as interrupts:
        try:
            # Products of small matrices: a second thread in each costs more than it brings.
            with line, threadpool_limits(limits=1, user_api="blas"):
                session, viewer_messages = _run(options, settings, interrupts, line)
        except KeyboardInterrupt:  # before the stream began, or a second time
            note("vip-factors: interrupted")
            raise SystemExit(interrupts.exit_code) from None
        except OSError as error:
            _tell_partial(options.out, options.rerun_save)
            raise error
        _conclude(options, settings, session, viewer_messages, interrupts)


def _check(options: StreamOptions) -> None:
    if options.rerun:
        check_display(INSTEAD_OF_A_WINDOW)
    if options.rerun_save is not None:
        check_partial(options.rerun_save, options.overwrite)
    if options.vmc is not None:
        from vip_factors.io.live_vmc import check_vmc

        check_vmc(options.vmc)
    if options.web is not None:
        import_module("vip_factors.io.live.network")
    if _wants_rerun(options):
        os.environ.setdefault("RUST_LOG", "off")  # Rerun's complaints about a viewer that was closed, line after line
        import_module("vip_factors.viz.live_rerun")  # takes seconds, better spent before a stream begins


def _run(
    options: StreamOptions, settings: LiveSettings, interrupts: "Interrupts", line: "StatusLine"
) -> tuple["Session", list[str]]:
    """Track until the end; returns what was counted, and what is to be said at last."""
    from vip_factors.cli.stream_session import Session
    from vip_factors.io.live.open import open_source, read_token

    with ExitStack() as stack:
        source: LiveSource = open_source(
            options.source,
            follow=options.follow,
            real_time=options.real_time,
            settings=options.limits,
            on_finding=lambda finding: line.note(f"note: {finding.sentence}"),
            token=read_token(options.token_file),
        )
        from vip_factors.live.stream import Stream  # takes a second: before the clock runs
        from vip_factors.sensors.live import VideoFrame

        stack.enter_context(source)
        if source.listens:
            line.note(f"note: {source.listens}")
        page = _live_page(options, source.awaits, stack, line)
        line.show("waiting for the stream to begin")
        setup = interrupts.waiting_for(lambda: source.setup)
        sinks = list(_sinks(options, settings, setup, stack, line))
        if page is not None:
            from vip_factors.report.page import live_page

            page.begin(setup, live_page(setup))
            sinks.append(page)
        viewers = _viewers(options, settings, setup, stack)
        session = Session(sinks, viewers, line)
        stream = Stream(setup, settings, real_time=not source.is_played, on_finding=session.report)
        interrupts.on_asked = stream.give_up
        for message in interrupts.until_asked(iter(source)):
            if isinstance(message, VideoFrame):
                session.write_video(message)
            session.write(stream.take(message, source.waited_s))
            if session.is_over:
                give_up_output()
                break
        session.write(stream.finish())
        sentences = [sentence for viewer in viewers for sentence in viewer.close()]
        session.lost = [viewer.lost for viewer in viewers if viewer.lost]
        dropped = sum(viewer.dropped for viewer in viewers)
        if dropped:
            sentences.append(f"{dropped} frames were not drawn: Rerun was busy")
    return session, sentences


def _wants_rerun(options: StreamOptions) -> bool:
    return options.rerun or options.rerun_save is not None or options.rerun_connect is not None


def _viewers(options: StreamOptions, settings: LiveSettings, setup: "Scene", stack: ExitStack) -> "list[LiveRerunSink]":
    if not _wants_rerun(options):
        return []
    from vip_factors.viz.live_rerun import LiveRerunSink

    viewers = [LiveRerunSink(setup, settings.frame_rate)] if options.rerun else []
    if options.rerun_save is not None:
        save, overwrite = options.rerun_save, options.overwrite
        viewers.append(LiveRerunSink(setup, settings.frame_rate, save=save, overwrite=overwrite))
    if options.rerun_connect is not None:
        viewers.append(LiveRerunSink(setup, settings.frame_rate, connect=options.rerun_connect))
    for viewer in viewers:
        stack.callback(viewer.close)
    return viewers


def _sinks(
    options: StreamOptions, settings: LiveSettings, setup: "Scene", stack: ExitStack, line: "StatusLine"
) -> "Iterator[Sink]":
    """Open all sinks of estimates except Rerun's viewers."""
    from vip_factors.io.live_json import LiveJsonSink

    if options.json:
        yield LiveJsonSink(sys.stdout, setup)
    if options.out is not None:
        from vip_factors.io.live_mcap import LiveMcapSink
        from vip_factors.settings import flatten

        sink = LiveMcapSink(options.out, setup, settings.frame_rate, flatten(settings), options.overwrite)
        yield stack.enter_context(sink)
    if options.vmc is not None:
        from vip_factors.io.live_vmc import LiveVmcSink

        avatars = LiveVmcSink(options.vmc, setup, options.sent_pose)
        stack.callback(lambda: list(map(line.note, avatars.close())))
        if len(avatars.ports) > 1:
            line.note(
                f"note: VMC messages: {', '.join(f'{name} on port {port}' for name, port in avatars.ports.items())}"
            )
        yield avatars


def _live_page(options: StreamOptions, awaits: str, stack: ExitStack, line: "StatusLine") -> "LiveServer | None":
    """The server of the live page, which says what the stream waits for until it begins."""
    if options.web is None:
        return None
    from vip_factors.io.live.open import read_token
    from vip_factors.io.live_server import LiveServer
    from vip_factors.report.page import waiting_page

    server = LiveServer(None, waiting_page(awaits), options.web, options.web_host, read_token(options.token_file))
    line.note(f"note: {stack.enter_context(server).listens}")
    return server


def _conclude(
    options: StreamOptions,
    settings: LiveSettings,
    session: "Session",
    findings: Sequence[str],
    interrupts: "Interrupts",
) -> None:
    """The summary; beside lines of JSON on stderr, where it is no part of them."""
    from vip_factors.cli.stream_session import summary

    for sentence in findings:
        note(f"note: {sentence}")
    tell = note if options.json else say
    if session.update_s:
        tell(summary(session.update_s, settings.frame_rate))
        tell(f"verdict: {verdict(session.findings.values())}")
        for path in (options.out, options.rerun_save):
            if path is not None and path.is_file():
                tell(path)
    elif not interrupts.asked:
        raise InputError(
            f"{options.source} ended before there was anything to answer: expected at least "
            f"{settings.start_s:g} s of samples of every placed sensor; nothing was written"
        )
    if session.lost:
        raise VipFactorsError("; ".join(session.lost))
    if interrupts.asked:
        raise SystemExit(interrupts.exit_code)
    fail_on(options.fail_on, verdict(session.findings.values()))


def _tell_partial(*wanted: Path | None) -> None:
    """Name the partial files of outputs that could not be completed."""
    for path in wanted:
        if path is not None and (partial := partial_path(path)).exists():
            note(f"note: what was written until then is in {partial}, which can be read")
