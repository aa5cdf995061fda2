"""Estimate file of a stream, readable up to the last half second even after a crash.

The smoothed poses are an estimate like that of a recording; the newest poses are on their own topics.
"""

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from types import TracebackType

from vip_factors.atomic import check_partial, check_target
from vip_factors.errors import naming_file
from vip_factors.estimate import Estimate
from vip_factors.findings import Finding, sentences
from vip_factors.io.mcap_estimate import LONG_CHUNK_BYTES, POSE, SINGLE, WEARER, EstimateWriter
from vip_factors.io.mcap_frames import camera_pose_messages, pose_messages
from vip_factors.io.mcap_messages import MessageWriter, TimedMessage
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.schemas.live_update_pb2 import LiveUpdate
from vip_factors.live_estimate import METHOD, LiveEstimate, estimate_of
from vip_factors.sensors.scene import Scene

LIVE, LIVE_WEARER = "/estimate/live", "/estimate/live/wearer/"
LIVE_UPDATE = "/estimate/live/update"
LIVE_CAMERA = "/estimate/live/camera/pose"  # of the set-up's first camera
LIVE_CAMERAS = "/estimate/live/cameras/"  # of the others; a name and /pose follow
FLUSH_S = 0.5  # seconds of wall time or of the stream, whichever ends first: what a crash may cost
BATCH_S = 0.1  # seconds of the stream that are written at once: cheaper than one by one, and short beside an update
MOST_FINDINGS = 200  # different sentences kept for the estimate; all of them are on LIVE_UPDATE


class LiveMcapSink:
    """Writes ``NAME.partial.mcap``, renamed ``NAME.mcap`` at a normal end. A context manager.

    An exception other than Ctrl-C, or a full disk, leaves the partial file, readable up to the last whole chunk.

    Args:
        path: of the file.
        setup: of the stream.
        rate: frames per second of the tracker.
        settings: the effective settings as text.
        overwrite: whether an existing file, or what a crash left of one, may be replaced.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        setup: Scene,
        rate: float,
        settings: Mapping[str, str] | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path = check_target(path, overwrite)
        self.partial = check_partial(self.path, overwrite)
        self._setup, self._settings, self._overwrite = setup, dict(settings or {}), overwrite
        names = [wearer.subject.name for wearer in setup.wearers]
        self._newest = [prefix + POSE for prefix in wearer_topics(names, LIVE, LIVE_WEARER)]
        self._rate = rate
        self._start, self._next_frame = 0.0, 0  # of the smoothed frames: seconds of the first, and the next number
        self.frames = 0  # taken in so far
        self._waiting: list[LiveEstimate] = []
        self._last: LiveEstimate | None = None
        self._batch, self._chunk = max(1, round(BATCH_S * rate)), max(1, round(FLUSH_S * rate))
        self._unflushed = 0  # frames since the last flush
        self._findings: dict[str, Finding] = {}  # ordered, each once
        self._written_findings = -1  # in the last EstimateInfo of the scene
        self._file = open(self.partial, "wb")  # noqa: SIM115 — open as long as the stream
        self._writer = MessageWriter(self._file, setup.start_ns, LONG_CHUNK_BYTES)  # more than comes in half a second
        prefixes = wearer_topics(names, SINGLE, WEARER)
        self._out = EstimateWriter(self._writer, prefixes, setup.wearers[0].clock_s)
        self._begun_cameras = set[str]()
        self._live_cameras = {
            camera.name: LIVE_CAMERA if number == 0 else f"{LIVE_CAMERAS}{camera.name.replace('/', '_')}/pose"
            for number, camera in enumerate(setup.cameras)
        }
        with self._closed_on_error():
            self._writer.flush()
            self._file.flush()
        self._flushed = time.monotonic()

    def __enter__(self) -> "LiveMcapSink":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if kind is None or issubclass(kind, KeyboardInterrupt):
            self.close()
        elif not self._file.closed:
            self._complete()

    def write(self, estimate: LiveEstimate) -> None:
        """Take in the answer to one frame. A file that cannot be written is closed, and the OSError names it."""
        with self._closed_on_error():
            if self._waiting and estimate.frame != self._waiting[-1].frame + 1:
                self._write_waiting()  # the frames of a batch follow each other
            self._waiting.append(estimate)
            self._last = estimate
            self.frames += 1
            self._unflushed += 1
            if self._unflushed >= self._chunk or time.monotonic() - self._flushed >= FLUSH_S:
                self._flush()
            elif len(self._waiting) >= self._batch:
                self._write_waiting()

    def _flush(self) -> None:
        self._write_waiting()
        if self._unflushed and self._last is not None:
            for index, answer in enumerate(self._last.wearers):
                self._out.write_calibration(index, answer.calibration, self._last.time)
        self._writer.flush()
        self._file.flush()
        self._flushed, self._unflushed = time.monotonic(), 0

    def close(self) -> None:
        """Complete the file and give it its name, or remove it if nothing was written; a second call does nothing.

        If a file of that name has appeared, what was written stays under its partial name (InputError).
        """
        if self._file.closed:
            return
        self._complete()
        if self.frames:
            check_target(self.path, self._overwrite)
            os.replace(self.partial, self.path)

    @contextmanager
    def _closed_on_error(self) -> Iterator[None]:
        """Errors name the file; it is closed then, and removed if it has no frame."""
        try:
            with naming_file(self.partial):
                yield
        except OSError:
            with suppress(OSError):  # what is in its buffer still cannot be written
                self._file.close()
            if not self.frames:
                self.partial.unlink()
            raise

    def _complete(self) -> None:
        """Complete the file under its partial name; remove it if it has no frame."""
        with self._closed_on_error(), self._file:
            self._flush()
            self._out.finish()
            if self._out.wearer_count:
                self._write_info()
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
        if not self.frames:
            self.partial.unlink()

    def _write_waiting(self) -> None:
        estimates, self._waiting = self._waiting, []
        if not estimates:
            return
        self._writer.add_in_order(self._updates(estimates), *self._newest_poses(estimates))
        for estimate in estimates:
            self._add_findings(estimate.findings)
        for first_frame, consecutive in self._smoothed_runs(estimates):
            self._write_smoothed(consecutive, first_frame)
        if self._out.wearer_count and len(self._findings) != self._written_findings:
            self._write_info(estimates[0].time)
            self._written_findings = len(self._findings)

    def _newest_poses(self, estimates: list[LiveEstimate]) -> Iterator[Iterable[TimedMessage]]:
        """Poses at the newest frames, which follow one another."""
        chunk = estimate_of(estimates, self._setup, self._rate)
        for topic, wearer in zip(self._newest, chunk.wearers, strict=True):
            yield pose_messages(self._writer, topic, wearer.motion, wearer.covariance, estimates[0].frame)
        for camera in chunk.cameras:
            first_frame = next(
                estimate.frame for estimate in estimates if camera.name in {row.name for row in estimate.cameras}
            )
            topic = self._live_cameras[camera.name]
            yield camera_pose_messages(self._writer, topic, camera.path, camera.covariance, first_frame)

    def _smoothed_runs(self, estimates: list[LiveEstimate]) -> Iterator[tuple[int, list[LiveEstimate]]]:
        """Answers whose smoothed frames follow each other, with the number of the first of these.

        Smoothed frames are numbered by their times at a constant rate. Numbers are left out where none came, and a
        frame that comes a second time is left out.
        """
        run: list[LiveEstimate] = []
        first_frame = self._next_frame
        for estimate in estimates:
            time_s = estimate.smoothed_time
            if time_s is None:
                continue
            if self._next_frame == 0:
                self._start = time_s
            frame = round((time_s - self._start) * self._rate)
            if frame > self._next_frame:
                if run:
                    yield first_frame, run
                self._add_missing(frame - self._next_frame, time_s)
                run, first_frame = [], frame
            if frame >= self._next_frame:
                run.append(estimate)
                self._next_frame = frame + 1
        if run:
            yield first_frame, run

    def _write_smoothed(self, estimates: list[LiveEstimate], first_frame: int) -> None:
        """Write smoothed frames; a camera that is known to stand still has a single pose."""
        start = self._start + first_frame / self._rate
        chunk = estimate_of(estimates, self._setup, self._rate, is_smoothed=True, start=start)
        if not self._out.wearer_count:
            for index, wearer in enumerate(chunk.wearers):
                self._out.begin_wearer(index, wearer.frames(slice(0, 0)))
        is_standing = {
            camera.name: not camera.moving and camera.known_path is not None for camera in self._setup.cameras
        }
        cameras = [camera.frames(slice(0, 1)) if is_standing[camera.name] else camera for camera in chunk.cameras]
        for camera in cameras:
            if camera.name not in self._begun_cameras:
                self._begun_cameras.add(camera.name)
                is_first = camera.name == self._setup.cameras[0].name
                self._out.begin_camera(camera.start, 1 if is_standing[camera.name] else None, is_first=is_first)
        self._out.write_frames(dict(enumerate(chunk.wearers)), cameras)

    def _add_missing(self, frames: int, time_s: float) -> None:
        """Report missing frames before a time."""
        words = {"when": f"in {frames} frames before {time_s:.2f} s", "reason": "nothing was answered there"}
        for name in self._setup.names:
            self._add_findings([Finding("no poses", name, numbers={"frames": frames}, words=words)])

    def _updates(self, estimates: list[LiveEstimate]) -> Iterator[TimedMessage]:
        messages = (
            LiveUpdate(
                frame=estimate.frame,
                update_s=estimate.seconds,
                detection_of_wearer=[-1 if row.detection is None else row.detection for row in estimate.wearers],
                findings=sentences(estimate.findings),
                preliminary=estimate.preliminary,
            )
            for estimate in estimates
        )
        return self._writer.stamped(LIVE_UPDATE, LiveUpdate, [estimate.time for estimate in estimates], messages)

    def _add_findings(self, findings: Iterable[Finding]) -> None:
        for finding in findings:
            if len(self._findings) < MOST_FINDINGS:
                self._findings[str(finding)] = finding

    def _write_info(self, seconds: float = 0.0) -> None:
        findings = tuple(self._findings.values())
        estimate = Estimate(self._setup.name, METHOD, (), findings=findings, settings=self._settings)
        self._out.write_info(estimate, seconds)
