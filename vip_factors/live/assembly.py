"""From samples in any order to evenly spaced frames, as soon as each is complete."""

import math
from bisect import insort
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from vip_factors.errors import InputError
from vip_factors.findings import Finding, FindingLog
from vip_factors.live.frames import LiveFrame
from vip_factors.live.sensor_samples import SampleError, SensorBuffer, checked_imu, checked_video
from vip_factors.live.source_clocks import SensorPresence, StreamClocks
from vip_factors.sensors.imu_stream import AttitudeFilter
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame
from vip_factors.sensors.scene import Camera
from vip_factors.settings import AssemblySettings

REPEAT_S = 10.0  # between equal findings about the same sensor
MOST_JUMPS = 10  # clock jumps after which these are reported no more often either
GATHER_S = 0.3  # of the stream, in which clocks that jump together are reported together


class VideoQueue:
    """Queue of video frames in the order of time."""

    def __init__(self) -> None:
        compared = 128  # recent frames, to detect repeated ones
        self._waiting: list[tuple[float, str, int, VideoFrame]] = []
        self._recent: deque[tuple[str, float]] = deque(maxlen=compared)
        self._arrived = 0

    @property
    def first_time(self) -> float:
        """Seconds of the earliest waiting frame; infinite without one."""
        return self._waiting[0][0] if self._waiting else math.inf

    def add(self, time: float, frame: VideoFrame) -> None:
        """Add a frame at ``time`` on the stream's clock, unless it is there already."""
        same_time = 1e-6  # s
        most_waiting = 1024  # half a minute of one camera at 30 Hz
        if any(camera == frame.camera and abs(moment - time) <= same_time for camera, moment in self._recent):
            return
        self._recent.append((frame.camera, time))
        if len(self._waiting) >= most_waiting:
            self._waiting.pop(0)
        self._arrived += 1
        insort(self._waiting, (time, frame.camera, self._arrived, frame))

    def take(self, end: float) -> list[tuple[float, VideoFrame]]:
        """Take the frames earlier than ``end``, in the order of time."""
        count = sum(entry[0] < end for entry in self._waiting)
        due, self._waiting = self._waiting[:count], self._waiting[count:]
        return [(time, frame) for time, _, _, frame in due]


ROUNDING = 1e-7  # s: a sample so little before a frame counts as at the frame


class FrameAssembler:
    """Puts the samples of a stream onto frames at ``start + k / rate``.

    Frames begin at the first sample of any sensor, in step with the video if there is any by then. A frame is made as
    soon as every active sensor has reached it, or when the others are :attr:`AssemblySettings.patience` past it. The
    measurements equal :func:`vip_factors.sensors.frames.resample_streams` of the same streams. Samples that cannot be
    used are left out and reported in findings; no sample raises an error.
    """

    def __init__(
        self,
        columns: Sequence[tuple[str, str]],
        rate: float,
        settings: AssemblySettings | None = None,
        cameras: Sequence[Camera] = (),
        lag_frames: int = 15,
    ) -> None:
        """Create an assembler without samples.

        Args:
            columns: carrier and name of each sensor, in the order of the first axis of measurements.
            rate: frames per second.
            settings: waiting times.
            cameras: the cameras of the stream.
            lag_frames: number of frames after which video comes too late; the default is a quarter of a second at 60
                Hz.
        """
        self._settings = settings or AssemblySettings()
        self._rate, self._lag_frames = rate, lag_frames
        # Sources are numbered, cameras after sensors.
        self._columns = {(carrier, sensor): number for number, (carrier, sensor) in enumerate(columns)}
        self._cameras = {camera.name: (len(columns) + number, camera) for number, camera in enumerate(cameras)}
        sensors = [f"sensor '{sensor}' of '{carrier}'" for carrier, sensor in columns]
        self._labels = [*sensors, *(f"camera '{camera.name}'" for camera in cameras)]
        self._log = FindingLog(REPEAT_S)
        self._clocks = StreamClocks(len(columns), len(cameras), self._settings)
        self._presence = SensorPresence(sensors, self._settings, self._log)
        self._buffer = SensorBuffer(len(columns))
        self._attitudes = [AttitudeFilter() for _ in columns]
        self._videos = VideoQueue()
        self._unknown: set[str] = set()
        self._first_sample = math.inf  # s, at which the grid begins
        self._start: float | None = None  # s, of grid point 0
        self._point = 0  # grid point of the next frame
        self._left_out = 0  # grid points without a frame so far
        self._first_point = 0  # since the last restart
        self._restart = False
        self._lost_at = -math.inf  # s, when samples were dropped last

    def push(self, sample: LiveSample) -> list[LiveFrame]:
        """Take one sample; returns the frames that it completes, in order.

        Raises:
            InputError: for an object that is no sample.
        """
        if isinstance(sample, ImuSample):
            return self._push_imu(sample)
        if isinstance(sample, VideoFrame):
            self._push_video(sample)
            return []
        raise InputError(f"a {type(sample).__name__} in the stream: expected an ImuSample or a VideoFrame")

    def note_loss(self) -> None:
        """Note that samples were dropped on their way; no sensor is to blame for a gap that begins soon."""
        self._lost_at = self._presence.lost_at = self._clocks.present

    def flush(self) -> list[LiveFrame]:
        """End the stream: the frames up to its newest sample, without waiting."""
        present = self._clocks.present
        if math.isfinite(present) and self._start is None:
            self._begin()
        frames = self._frames_until(present)
        self._log.close()
        return frames

    def take_findings(self) -> tuple[Finding, ...]:
        """Findings since the last call."""
        return self._log.take(self._clocks.present)

    def _push_imu(self, sample: ImuSample) -> list[LiveFrame]:
        column = self._columns.get((sample.carrier, sample.sensor))
        if column is None:
            self._refuse_unknown(f"sensor '{_short(sample.sensor)}' of '{_short(sample.carrier)}'")
            return []
        try:
            sample_time, values = checked_imu(sample, self._attitudes[column])
        except SampleError as reason:
            self._refuse(column, str(reason))
            return []
        past = self._clocks.present
        time = self._admitted(column, sample_time)
        if time is None:
            return []
        frames = self._after_silence(past, time)
        # The acceleration window of the next frame begins two frames before it.
        if self._start is not None and time <= self._time(self._point - 2) - ROUNDING:
            self._refuse(column)
            self._presence.note_late(column, time, self._clocks.present)
        elif self._buffer.insert(column, time, values):
            self._presence.note(column, time, self._clocks.present, self._start is not None)
        return frames + self._frames_due()

    def _push_video(self, frame: VideoFrame) -> None:
        source, camera = self._cameras.get(frame.camera, (0, None))
        if camera is None:
            self._refuse_unknown(f"camera '{_short(frame.camera)}'")
            return
        try:
            checked = checked_video(frame, camera)
        except SampleError as reason:
            self._refuse(source, str(reason))
            return
        time = self._admitted(source, checked.time)
        if time is not None:
            self._videos.add(time, replace(checked, time=time))

    def _admitted(self, source: int, sample_time: float) -> float | None:
        """Time of a sample on the stream's clock; None if it is refused."""
        time, finding = self._clocks.admit(source, sample_time, self._presence.is_awaited)
        if finding is not None:
            reported = replace(finding, subject=self._labels[source])

            def with_others(count: int) -> Finding:
                addition = f"; so did {count - 1} more" if count > 1 else ""
                return replace(reported, words={**reported.words, "others": addition})

            # One key for all sources: clocks seldom jump alone.
            self._log.tally(("clock", time is None), self._clocks.present, with_others, GATHER_S, MOST_JUMPS)
        return time

    def _time(self, point: int) -> float:
        assert self._start is not None
        return self._start + point / self._rate

    def _after_silence(self, past: float, present: float) -> list[LiveFrame]:
        """React to a silence of all sensors between two times of the stream."""
        if present > past - self._settings.jump:
            self._first_sample = min(self._first_sample, present)
        if not math.isfinite(past) or present - past <= self._settings.patience:
            return []
        self._presence.resumed = present
        if present - past >= self._settings.dead_after:
            what = f"were silent for {present - past:.1f} s from {past:.2f} s on"
            is_lost = past - self._lost_at <= REPEAT_S
            if is_lost:
                what += ", as the tracker did not keep up and their samples were dropped"
            consequence = "tracking starts again" if present - past > self._settings.longest_pause else "going on"
            numbers, words = {"seconds": present - past, "begin": past}, {"what": what, "then": consequence}
            finding = Finding("silent", subject="all sensors", numbers=numbers, words=words)
            if is_lost:  # at intervals, while the tracker does not keep up
                self._log.tally("lost", present, lambda _: finding)
            else:
                self._log.add(finding)
        if present - past <= self._settings.longest_pause:
            return []
        if self._start is None:
            self._first_sample = present
            return []
        frames = self._frames_until(past)
        point = math.ceil((present - self._start) * self._rate - 1e-6)
        self._left_out += point - self._point
        self._point = self._first_point = point
        self._restart = True
        return frames

    def _frames_due(self) -> list[LiveFrame]:
        """Make every frame that need not wait any longer."""
        present = self._clocks.present
        self._presence.find_silent(present)
        if self._start is None:
            if present - self._first_sample < self._settings.settle:
                return []
            self._begin()
        due = self._time(self._point) - ROUNDING
        if present < due or self._presence.waits(due, present):
            return []
        return self._frames_until(self._presence.complete_until())

    def _frames_until(self, time: float) -> list[LiveFrame]:
        frames = []
        while self._start is not None and self._time(self._point) <= time + ROUNDING:
            point, time_of_frame, step = self._point, self._time(self._point), 1 / self._rate
            measured = self._buffer.measure(time_of_frame, step)
            number, video = point - self._left_out, self._take_videos(point)
            frames.append(LiveFrame(number, time_of_frame, *measured, video, self._restart))
            self._restart = False
            self._point += 1
            self._buffer.needed_from = time_of_frame - step  # start of the next frame's window
        return frames

    def _begin(self) -> None:
        """Set the grid: from the first sample on, in step with the first video frame."""
        start, video = self._first_sample, self._videos.first_time
        if math.isfinite(video):
            start = video + math.ceil((start - video) * self._rate - 1e-6) / self._rate
        self._start = start
        self._presence.report_missing()

    def _take_videos(self, point: int) -> tuple[VideoFrame, ...]:
        assert self._start is not None
        frames = []
        for time, video in self._videos.take(self._time(point) + 0.5 / self._rate):
            nearest = min(round((time - self._start) * self._rate), point)
            if nearest >= max(self._first_point, point - self._lag_frames):
                frames.append(replace(video, frame=nearest - self._left_out))
            elif nearest >= self._first_point:  # a frame from before the first one is no loss
                source, _ = self._cameras[video.camera]
                self._refuse(source)
        return tuple(frames)

    def _refuse(self, source: int, reason: str = "") -> None:
        """Count a sample that is unusable for a ``reason``, or that came too late."""
        noun = "sample" if source < len(self._columns) else "video frame"
        what = f"skipped: {reason}" if reason else "came too late"

        def finding(count: int) -> Finding:
            words = {"what": f"{count} {noun}{'s' if count > 1 else ''} {what}"}
            return Finding("samples unusable", subject=self._labels[source], words=words)

        self._log.tally((source, bool(reason)), self._clocks.present, finding)

    def _refuse_unknown(self, label: str) -> None:
        most_names = 100  # of undeclared sensors and cameras that are reported
        if label in self._unknown or len(self._unknown) > most_names:
            return
        self._unknown.add(label)
        what = "not declared in the stream's set-up, ignored; check the name"
        if len(self._unknown) > most_names:
            label = f"more than {most_names} names"
            what = "are not declared in the stream's set-up; further ones are not reported"
        self._log.add(Finding("samples unusable", subject=label, words={"what": what}))


def _short(name: object) -> str:
    """Shorten a name that is not declared."""
    longest_name = 80  # characters
    return str(name)[:longest_name]
