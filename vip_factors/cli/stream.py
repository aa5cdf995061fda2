"""``vip-factors stream``: samples in as they arrive, poses out as they are known."""

import os
import sys
import time
from array import array
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

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
from vip_factors.cli.terminal import Interrupts, StatusLine, give_up_output, note, say
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.findings import Finding, verdict
from vip_factors.io.settings import LiveSourceSettings, SentPose
from vip_factors.ranges import Port
from vip_factors.settings import LiveSettings
from vip_factors.viz.viewer import check_display

if TYPE_CHECKING:
    import numpy as np

    from vip_factors.io.live_server import LiveServer
    from vip_factors.live_estimate import LiveEstimate
    from vip_factors.sensors.scene import Scene
    from vip_factors.viz.live_rerun import LiveRerunSink

RECENT = 600  # updates, ten seconds, that the line's figures are of
LINE_S = 0.25  # seconds between looks of the line: it is read, not watched


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

    # Lines of JSON on the same terminal would run into the status.
    line = StatusLine(wanted=not (options.json and sys.stdout.isatty()))
    with Interrupts() as interrupts:
        try:
            # Products of small matrices: a second thread in each costs more than it brings.
            with line, threadpool_limits(limits=1, user_api="blas"):
                session = _run(options, settings, interrupts, line)
        except KeyboardInterrupt:  # before the stream began, or a second time
            note("vip-factors: interrupted")
            raise SystemExit(interrupts.exit_code) from None
        except OSError:
            for path in (options.out, options.rerun_save):
                if path is not None and (partial := partial_path(path)).exists():
                    note(f"note: what was written until then is in {partial}, which can be read")
            raise
        _conclude(options, settings, session, interrupts)


def _check(options: StreamOptions) -> None:
    if options.rerun:
        check_display("--rerun-save FILE.rrd or --rerun-connect URL instead of --rerun")
    if options.rerun_save is not None:
        check_partial(options.rerun_save, options.overwrite)
    if options.vmc is not None:
        from vip_factors.io.live_vmc import check_vmc

        check_vmc(options.vmc)
    if options.web is not None:
        import_module("vip_factors.io.live_network")
    if options.rerun or options.rerun_save is not None or options.rerun_connect is not None:
        os.environ.setdefault("RUST_LOG", "off")  # Rerun's complaints about a viewer that was closed, line after line
        import_module("vip_factors.viz.live_rerun")  # takes seconds, better spent before a stream begins


def _run(options: StreamOptions, settings: LiveSettings, interrupts: Interrupts, line: StatusLine) -> "Session":
    """Track until the end; returns what was counted."""
    from vip_factors.io.live_open import open_source, read_token

    with ExitStack() as stack:
        token = read_token(options.token_file)
        source = open_source(options.source, options.follow, options.real_time, options.limits, token=token)
        source.on_finding = lambda finding: line.note(f"note: {finding.sentence}")
        from vip_factors.live.stream import Stream  # takes a second: before the clock runs
        from vip_factors.sensors.live import VideoFrame

        stack.enter_context(source)
        if source.listens:
            line.note(f"note: {source.listens}")
        page = _live_page(options, source.awaits, token, stack, line)
        line.show("waiting for the stream to begin")
        setup = interrupts.waiting_for(lambda: source.setup)
        sinks = list(_sinks(options, settings, setup, stack, line))
        if page is not None:
            from vip_factors.report.page import live_page

            page.begin(setup, live_page(setup))
            sinks.append(page)
        session = Session(sinks, list(_viewers(options, settings, setup, stack)), line)
        stream = Stream(setup, settings, real_time=not source.is_played, on_finding=session.report)
        interrupts.on_asked = stream.give_up
        for message in interrupts.until_asked(iter(source)):
            if isinstance(message, VideoFrame):
                for viewer in session.viewers:
                    viewer.write(message)
            session.write(stream.take(message, source.waited_s))
            if session.is_over:
                give_up_output()
                break
        session.write(stream.finish())
        session.close()
    return session


def _viewers(
    options: StreamOptions, settings: LiveSettings, setup: "Scene", stack: ExitStack
) -> "Iterator[LiveRerunSink]":
    """Open the viewers of Rerun."""
    save, connect = options.rerun_save, options.rerun_connect
    wanted = ((options.rerun, None, None), (save is not None, save, None), (connect is not None, None, connect))
    for is_wanted, path, address in wanted:
        if is_wanted:
            from vip_factors.viz.live_rerun import LiveRerunSink

            viewer = LiveRerunSink(setup, settings.frame_rate, path, address, options.overwrite)
            stack.callback(viewer.close)
            yield viewer


def _sinks(
    options: StreamOptions, settings: LiveSettings, setup: "Scene", stack: ExitStack, line: StatusLine
) -> "Iterator[Sink]":
    """Open all sinks of estimates except Rerun's viewers."""
    if options.json:
        from vip_factors.io.live_json import LiveJsonSink

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
            ports = ", ".join(f"{name} on port {port}" for name, port in avatars.ports.items())
            line.note(f"note: VMC messages: {ports}")
        yield avatars


def _live_page(
    options: StreamOptions, awaits: str, token: str, stack: ExitStack, line: StatusLine
) -> "LiveServer | None":
    """The server of the live page, which says what the stream waits for until it begins."""
    if options.web is None:
        return None
    from vip_factors.io.live_server import LiveServer
    from vip_factors.report.page import waiting_page

    server = LiveServer(None, waiting_page(awaits), options.web, options.web_host, token)
    line.note(f"note: {stack.enter_context(server).listens}")
    return server


def _conclude(options: StreamOptions, settings: LiveSettings, session: "Session", interrupts: Interrupts) -> None:
    """The summary; beside lines of JSON on stderr, where it is no part of them."""
    for sentence in session.sentences:
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


class Sink(Protocol):
    """Destination of estimates."""

    def write(self, estimate: "LiveEstimate") -> None:
        """Take in the answer to one frame."""


class Session:
    """Outputs of a stream: hands answers to the sinks, reports findings, and keeps count.

    Attributes:
        viewers: sinks that show video frames too.
        update_s: what each update took.
        is_over: whether nobody reads the JSON lines any more.
        findings: the last one of each kind.
        sentences: of the viewers, about their end.
        lost: a sentence for each output that was wanted and is not there.
    """

    def __init__(self, sinks: "Sequence[Sink]", viewers: "Sequence[LiveRerunSink]", line: StatusLine) -> None:
        self._sinks, self.viewers, self._line = list(sinks), viewers, line
        self.update_s = array("d")
        self.is_over = False
        self.sentences: list[str] = []
        self.lost: list[str] = []
        self.findings: dict[str, Finding] = {}
        self._shown_at = -LINE_S

    def report(self, finding: Finding) -> None:
        """Report a finding of the source or of the tracker."""
        self.findings[finding.kind] = finding
        self._line.note(f"{finding.severity}: {finding}")

    def write(self, estimates: "list[LiveEstimate]") -> None:
        """Hand answers to all sinks."""
        for estimate in estimates:
            self.update_s.append(estimate.seconds)
            for sink in [*self._sinks, *self.viewers]:
                try:
                    sink.write(estimate)
                except BrokenPipeError:  # the reader of the JSON lines, ``head`` say, has seen enough
                    self.is_over = True
                    self._sinks.remove(sink)
        moment = time.monotonic()
        if estimates and moment - self._shown_at >= LINE_S:
            self._shown_at = moment
            for viewer in self.viewers:
                for sentence in viewer.findings():
                    self._line.note(f"note: {sentence}")
            if self._line.shown:
                self._line.show(status(estimates[-1], self.update_s[-RECENT:]))

    def close(self) -> None:
        """End the viewers, and ask what they could not show."""
        self.sentences = [sentence for viewer in self.viewers for sentence in viewer.close()]
        self.lost = [viewer.lost for viewer in self.viewers if viewer.lost]
        dropped = sum(viewer.dropped for viewer in self.viewers)
        if dropped:
            self.sentences.append(f"{dropped} frames were not drawn: Rerun was busy")


def status(estimate: "LiveEstimate", update_s: "Sequence[float] | np.ndarray") -> str:
    """Status line: time of the stream, duration of updates, visible wearers, uncertainty of headings."""
    import numpy as np

    median, late = 1e3 * np.percentile(update_s, [50, 99])
    phrases = [f"frame {estimate.frame}", f"{estimate.time:.1f} s", f"update {median:.1f} ms, p99 {late:.1f} ms"]
    if estimate.preliminary:
        phrases.append("preliminary")
    if estimate.cameras:
        names_in_view = [wearer.name for wearer in estimate.wearers if wearer.detection is not None]
        phrases.append(f"seen: {', '.join(names_in_view) or 'nobody'}")
    sigmas = {
        sensor: sensor_calibration.heading_sigma
        for wearer in estimate.wearers
        for sensor, sensor_calibration in wearer.calibration.items()
        if np.isfinite(sensor_calibration.heading_sigma)
    }
    if sigmas:
        least_certain = max(sigmas, key=lambda sensor: sigmas[sensor])
        typical, largest = np.rad2deg([np.median(list(sigmas.values())), sigmas[least_certain]])
        phrases.append(f"headings ±{typical:.1f}°, {least_certain} ±{largest:.1f}°")
    return " | ".join(phrases)


def summary(update_s: Sequence[float], frame_rate: float) -> str:
    """Number of frames and distribution of the updates' durations."""
    import numpy as np

    median, longest, late = 1e3 * np.percentile(update_s, [50, 95, 99])
    return (
        f"{len(update_s)} frames; update: median {median:.1f} ms, 95 % {longest:.1f} ms, 99 % {late:.1f} ms, "
        f"worst {1e3 * max(update_s):.1f} ms (a frame lasts {1e3 / frame_rate:.1f} ms)"
    )
