"""An estimate file written as it goes: readable up to the last half second whatever happens to the program.

The smoothed poses are an ordinary estimate of a scene; the newest ones stand on topics of their own beside it.
"""

import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from types import TracebackType

import numpy as np

from vip_factors.atomic import check_partial, check_target
from vip_factors.errors import naming_file
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.findings import Finding, sentences
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_estimate import LONG_CHUNK_BYTES, POSE, SINGLE, WEARER, EstimateWriter
from vip_factors.io.mcap_frames import MODEST_FRAMES, camera_pose_messages, pose_messages
from vip_factors.io.mcap_messages import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.mcap_recording import wearer_topics
from vip_factors.io.schemas.live_update_pb2 import LiveUpdate
from vip_factors.live_estimate import LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate, motion_of, path_of
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene

LIVE, LIVE_WEARER = "/estimate/live", "/estimate/live/wearer/"
LIVE_UPDATE, LIVE_CAMERA = "/estimate/live/update", "/estimate/live/camera/pose"
METHOD = "fixed lag"
FLUSH_S = 0.5  # seconds of wall time or of the stream, whichever ends first: what a crash may cost
BATCH_S = 0.1  # seconds of the stream that are written at once: cheaper than one by one, and short beside an update
MOST_FINDINGS = 200  # different sentences kept for the estimate; all of them are on LIVE_UPDATE


class LiveMcapSink:
    """Writes ``NAME.partial.mcap`` and calls it ``NAME.mcap`` at a normal end. A context manager, whose end after an
    exception (but not after Ctrl-C) leaves the partial file, readable up to the last whole chunk. So does a full disk.

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
        self._wearers = [_SmoothedPoses(wearer, rate) for wearer in setup.wearers]
        self.frames = 0  # taken in so far
        self._waiting: list[LiveEstimate] = []
        self._last: LiveEstimate | None = None
        self._batch, self._chunk = max(1, round(BATCH_S * rate)), max(1, round(FLUSH_S * rate))
        self._unflushed = 0  # frames since the last flush
        self._findings: dict[str, Finding] = {}  # ordered, each once
        self._written_info: tuple[int, int] = (0, 0)  # wearers and findings in the last EstimateInfo of the whole
        self._file = open(self.partial, "wb")  # noqa: SIM115 — open as long as the stream
        self._writer = MessageWriter(self._file, LONG_CHUNK_BYTES)  # more than comes in half a second
        prefixes = wearer_topics(names, SINGLE, WEARER)
        clock_s = setup.wearers[0].clock_s
        self._out = EstimateWriter(self._writer, prefixes, setup.start_ns, MODEST_FRAMES, clock_s)
        self._has_camera = False  # whether its poses have begun
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
            (end_ns,) = nanoseconds([self._last.time], self._setup.start_ns)
            for index, answer in enumerate(self._last.wearers):
                self._out.write_calibration(index, answer.calibration, end_ns)
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
        """All of the file, still under its partial name; nothing is left of one without frames."""
        with self._closed_on_error(), self._file:
            self._flush()
            self._out.finish()
            if self._out.wearer_count:
                self._write_info(self._setup.start_ns)
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
        for index, smoothed in enumerate(self._wearers):
            for chunk, missing in smoothed.chunks([estimate.wearers[index] for estimate in estimates]):
                self._add_findings(missing)
                if chunk.motion.start == smoothed.start:
                    self._out.begin_wearer(index, chunk.frames(slice(0, 0)))
                self._out.write_frames({index: chunk})
        self._write_camera(estimates)
        info = (self._out.wearer_count, len(self._findings))
        if info[0] and info != self._written_info:
            self._write_info(*nanoseconds([estimates[0].time], self._setup.start_ns))
            self._written_info = info

    def _newest_poses(self, estimates: list[LiveEstimate]) -> Iterator[Iterable[TimedMessage]]:
        """Poses at the newest frames, which follow one another."""
        first_frame, start_ns = estimates[0].frame, self._setup.start_ns
        for index, (topic, smoothed) in enumerate(zip(self._newest, self._wearers, strict=True)):
            chunk = smoothed.estimate([estimate.wearers[index].newest for estimate in estimates], estimates[0].time)
            yield pose_messages(self._writer, topic, chunk.motion, start_ns, chunk.covariance, first_frame)
        poses = [estimate.camera for estimate in estimates if estimate.camera is not None]
        if poses and self._setup.camera is not None:
            first_frame = next(estimate.frame for estimate in estimates if estimate.camera is not None)
            path = camera_estimate(self._setup.camera, poses)
            yield camera_pose_messages(self._writer, LIVE_CAMERA, path.path, start_ns, path.covariance, first_frame)

    def _write_camera(self, estimates: list[LiveEstimate]) -> None:
        """Smoothed poses of the camera; one that is known to stand still has a single pose."""
        camera = self._setup.camera
        smoothed = [estimate.smoothed_camera for estimate in estimates if estimate.smoothed_camera is not None]
        if camera is None or not smoothed:
            return
        stands = not camera.moving and camera.known_path is not None
        chunk = camera_estimate(camera, smoothed[:1] if stands else smoothed)
        if not self._has_camera:
            self._has_camera = True
            self._out.begin_camera(chunk.start, 1 if stands else None)
        self._out.write_frames({}, [chunk])

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
        times_ns = nanoseconds([estimate.time for estimate in estimates], self._setup.start_ns)
        return self._writer.stamped(LIVE_UPDATE, LiveUpdate, times_ns, messages)

    def _add_findings(self, findings: Iterable[Finding]) -> None:
        for finding in findings:
            if len(self._findings) < MOST_FINDINGS:
                self._findings[str(finding)] = finding

    def _write_info(self, time_ns: int) -> None:
        findings = tuple(self._findings.values())
        estimate = Estimate(self._setup.name, METHOD, (), findings=findings, settings=self._settings)
        self._out.write_info(estimate, time_ns)


class _SmoothedPoses:
    """Numbers the smoothed poses of a wearer, and makes chunks of an estimate of them.

    Frames are numbered by their times at a constant rate: where none came, numbers are left out. A pose that comes a
    second time is left out.

    Attributes:
        start: seconds of the first pose.
    """

    def __init__(self, wearer: Recording, rate: float) -> None:
        self.start = 0.0
        self._wearer, self._skeleton, self._rate = wearer, wearer.subject.body(), rate
        self._next_frame = 0

    def chunks(self, answers: Sequence[LiveWearerEstimate]) -> Iterator[tuple[WearerEstimate, list[Finding]]]:
        """Poses a frame apart, and how many frames are missing before them."""
        run: list[LivePose] = []
        first_frame, missing = self._next_frame, 0
        for answer in answers:
            self._skeleton = answer.skeleton or self._skeleton
            pose = answer.smoothed
            if pose is None:
                continue
            if self._next_frame == 0:
                self.start = pose.time
            frame = round((pose.time - self.start) * self._rate)
            if frame > self._next_frame:
                if run:
                    yield self._chunk(run, first_frame, missing)
                run, first_frame, missing = [], frame, frame - self._next_frame
            if frame >= self._next_frame:
                run.append(pose)
                self._next_frame = frame + 1
        if run:
            yield self._chunk(run, first_frame, missing)

    def _chunk(self, poses: list[LivePose], first_frame: int, missing: int) -> tuple[WearerEstimate, list[Finding]]:
        estimate = self.estimate(poses, self.start + first_frame / self._rate)
        if not missing:
            return estimate, []
        words = {"when": f"in {missing} frames before {poses[0].time:.2f} s", "reason": "nothing was answered there"}
        return estimate, [Finding("no poses", self._wearer.subject.name, numbers={"frames": missing}, words=words)]

    def estimate(self, poses: list[LivePose], start: float) -> WearerEstimate:
        """An estimate of poses a frame apart, the first of them at ``start`` seconds."""
        name, sensors = self._wearer.subject.name, tuple(site.sensor for site in self._wearer.placement.sites)
        joints, roots = _if_all(poses, "joint_covariance"), _if_all(poses, "root_covariance")
        covariance = None if joints is None or roots is None else PoseCovariance(joints, roots)
        motion = motion_of(poses, self._skeleton, self._rate, name, start)
        return WearerEstimate(name, METHOD, motion, {}, covariance, sensors=sensors)


def camera_estimate(camera: Camera, poses: Sequence[LiveCameraPose]) -> CameraEstimate:
    """The estimate of a camera at some poses."""
    return CameraEstimate(camera.name, camera.model, path_of(poses), covariance=_if_all(poses, "covariance"))


def _if_all(poses: Sequence[LivePose | LiveCameraPose], name: str) -> Array | None:
    """An attribute of poses as an array; None if one of them has none."""
    values = [getattr(pose, name) for pose in poses]
    return None if any(value is None for value in values) else np.array(values, float)
