"""A stream at the command line: its outputs, its status, and an orderly end whatever ends it."""

import signal
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from vip_factors.cli.terminal import Ending, StatusLine
from vip_factors.findings import Finding
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveItem, VideoFrame

if TYPE_CHECKING:
    from vip_factors.viz.live_rerun import LiveRerunSink

T = TypeVar("T")
RECENT = 600  # updates, ten seconds, that the line's figures are of
LINE_S = 0.25  # seconds between looks of the line: it is read, not watched


class Sink(Protocol):
    """Destination of estimates."""

    def write(self, estimate: LiveEstimate) -> None:
        """Take in the answer to one frame."""


class Interrupts(Ending):
    """Ctrl-C or SIGTERM end a stream between two samples, not within an update or half a line.

    A second one interrupts whatever goes on.

    Attributes:
        on_asked: called by the first one, wherever the program is.
    """

    is_exclusive = True

    def __init__(self) -> None:
        super().__init__()
        self.on_asked: Callable[[], None] = lambda: None
        self._waiting = False

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self.number != 0

    def until_asked(self, source: Iterator[LiveItem]) -> Iterator[LiveItem]:
        """The items of a source, until it ends or one of the signals comes."""
        while True:
            try:
                message = self.waiting_for(lambda: next(source))
            except StopIteration:
                return
            except KeyboardInterrupt:
                self.number = self.number or signal.SIGINT
                return
            yield message

    def waiting_for(self, wait: Callable[[], T]) -> T:
        """Return the result of ``wait``, which the signals interrupt.

        Raises:
            KeyboardInterrupt: then.
        """
        self._waiting = True
        try:
            if self.asked:  # looked at after that, lest one between the two be waited over
                raise KeyboardInterrupt
            return wait()
        finally:
            self._waiting = False

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Signal handler: request the end of the stream."""
        is_repeated, self.number = self.asked, number
        if not is_repeated:
            self.on_asked()
        if self._waiting or is_repeated:
            raise KeyboardInterrupt


class Session:
    """Outputs of a stream: hands answers to the sinks, tells findings, and keeps count.

    Attributes:
        update_s: what each update took.
        is_over: whether nobody reads the JSON lines any more.
        findings: the last one of each kind.
        lost: a sentence for each output that was wanted and is not there.
    """

    def __init__(self, sinks: Sequence[Sink], viewers: "Sequence[LiveRerunSink]", line: StatusLine) -> None:
        self._sinks, self._viewers, self._line = list(sinks), viewers, line
        self.update_s = array("d")
        self.is_over = False
        self.lost: list[str] = []
        self.findings: dict[str, Finding] = {}
        self._shown_at = -LINE_S

    def report(self, finding: Finding) -> None:
        """Tell a finding of the source or of the tracker."""
        self.findings[finding.kind] = finding
        self._line.note(f"{finding.severity}: {finding}")

    def write_video(self, frame: VideoFrame) -> None:
        """Show a video frame in the viewers."""
        for viewer in self._viewers:
            viewer.write(frame)

    def write(self, estimates: list[LiveEstimate]) -> None:
        """Hand answers to all sinks."""
        for estimate in estimates:
            self.update_s.append(estimate.seconds)
            for sink in [*self._sinks, *self._viewers]:
                self._write(sink, estimate)
        moment = time.monotonic()
        if estimates and moment - self._shown_at >= LINE_S:
            self._shown_at = moment
            for viewer in self._viewers:
                for sentence in viewer.findings():
                    self._line.note(f"note: {sentence}")
            if self._line.shown:
                self._line.show(status(estimates[-1], np.array(self.update_s[-RECENT:])))

    def _write(self, sink: Sink, estimate: LiveEstimate) -> None:
        try:
            sink.write(estimate)
        except BrokenPipeError:  # the reader of the JSON lines, ``head`` say, has seen enough
            self.is_over = True
            self._sinks.remove(sink)


def status(estimate: LiveEstimate, update_s: np.ndarray) -> str:
    """Status line: time of the stream, duration of updates, visible wearers, uncertainty of headings."""
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
    median, longest, late = 1e3 * np.percentile(np.asarray(update_s), [50, 95, 99])
    return (
        f"{len(update_s)} frames; update: median {median:.1f} ms, 95 % {longest:.1f} ms, 99 % {late:.1f} ms, "
        f"worst {1e3 * max(update_s):.1f} ms (a frame lasts {1e3 / frame_rate:.1f} ms)"
    )
