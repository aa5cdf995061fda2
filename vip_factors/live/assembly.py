"""From samples in any order to evenly spaced frames, as soon as each is complete."""

import math
from bisect import insort
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from vip_factors.errors import InputError
from vip_factors.findings import Finding, FindingLog
from vip_factors.live.measurement import LiveFrame
from vip_factors.live.sensor_samples import SensorBuffer, checked_imu, checked_video
from vip_factors.live.source_clocks import Admitted, SensorPresence, StreamClocks
from vip_factors.sensors.imu_stream import AttitudeFilter
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame
from vip_factors.sensors.scene import Camera
from vip_factors.settings import AssemblySettings

MOST_GIVEN_OUT = 64  # video frames given out before, to detect repeated ones
REPEAT_S = 10.0  # between equal findings about the same sensor
MOST_JUMPS = 10  # clock jumps after which these are reported no more often either
GATHER_S = 0.3  # of the stream, in which clocks that jump together are reported together


class VideoQueue:
    """Queue of video frames in the order of time."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, str, int, VideoFrame]] = []
        self._given_out: deque[tuple[str, float]] = deque(maxlen=MOST_GIVEN_OUT)
        self._newest: dict[str, float] = {}  # s, by camera
        self._arrived = 0

    @property
    def first_time(self) -> float:
        """Seconds of the earliest waiting frame; infinite without one."""
        return self._waiting[0][0] if self._waiting else math.inf

    def add(self, time: float, frame: VideoFrame) -> bool:
        """Add a frame at ``time`` on the stream's clock; False if it is there already."""
        same_time = 1e-6  # s
        most_waiting = 1024  # half a minute of one camera at 30 Hz
        newest = self._newest.get(frame.camera, -math.inf)
        if time <= newest + same_time:  # otherwise it is new: frames mostly come in order
            waiting = [(camera, moment) for moment, camera, _, _ in self._waiting[-MOST_GIVEN_OUT:]]
            for camera, moment in (*waiting, *self._given_out):
                if camera == frame.camera and abs(moment - time) <= same_time:
                    return False
        self._newest[frame.camera] = max(newest, time)
        if len(self._waiting) >= most_waiting:
            self._waiting.pop(0)
        self._arrived += 1
        insort(self._waiting, (time, frame.camera, self._arrived, frame))
        return True

    def take(self, end: float) -> list[tuple[float, VideoFrame]]:
        """Take the frames earlier than ``end``, in the order of time."""
        count = sum(entry[0] < end for entry in self._waiting)
        due, self._waiting = self._waiting[:count], self._waiting[count:]
        self._given_out.extend((camera, time) for time, camera, _, _ in due)
        return [(time, frame) for time, _, _, frame in due]


ROUNDING = 1e-7  # s: a sample so little before a frame counts as at the frame


class FrameAssembler:
    """Puts the samples of a stream onto frames at ``start + k / rate``.

    Frames begin at the first sample of any sensor, in step with the video if there is any by then. A frame is made as
    soon as every active sensor has reached it, or when the others are :attr:`AssemblySettings.patience` past it. The
    measurements equal :func:`vip_factors.sensors.frames.resample_streams` of the same streams. Samples that cannot be
    used are left out, counted in :attr:`counts` and reported in findings; no sample raises an error.

    Attributes:
        counts: by kind, number of unused samples: ``duplicate``, ``late``, ``unusable``, ``clock``, ``unknown``.
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

        Raises:
            InputError: without columns, if one is repeated, or if rate or lag are not positive.
        """
        if not columns or len(set(columns)) < len(columns):
            raise InputError(f"frames of the sensors {list(columns)}: expected at least one, none of them twice")
        if not 0 < rate < math.inf or lag_frames < 0:
            raise InputError(f"frames at {rate:g} Hz with a lag of {lag_frames}: expected a positive rate and lag")
        self.counts: Counter[str] = Counter()
        self._settings = settings or AssemblySettings()
        self._rate, self._lag_frames = rate, lag_frames
        self._columns = {(carrier, sensor): number for number, (carrier, sensor) in enumerate(columns)}
        self._labels = [f"sensor '{sensor}' of '{carrier}'" for carrier, sensor in columns]
        self._cameras = {camera.name: (len(columns) + number, camera) for number, camera in enumerate(cameras)}
        self._log = FindingLog(REPEAT_S)
        self._clocks = StreamClocks(len(columns), len(cameras), self._settings)
        self._presence = SensorPresence(self._labels, self._settings, self._log)
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
        self._lost_at = self._clocks.present
        self._presence.note_loss(self._lost_at)

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
        checked = checked_imu(sample, self._attitudes[column])
        if isinstance(checked, str):
            self._refuse("unusable", column, self._labels[column], "sample", checked)
            return []
        time, values = checked
        past = self._clocks.present
        admitted = self._clocks.admit(column, time, self._presence.is_awaited)
        self._remark_on_clock(column, self._labels[column], admitted)
        if admitted.time is None:
            return []
        frames = self._after_silence(past, admitted.time)
        if admitted.time <= self._too_late:
            self._refuse("late", column, self._labels[column], "sample")
            self._presence.note_late(column, admitted.time, self._clocks.present)
        elif self._buffer.insert(column, admitted.time, values):
            self._presence.note(column, admitted.time, self._clocks.present, self._start is not None)
        else:
            self.counts["duplicate"] += 1
        return frames + self._frames_due()

    def _push_video(self, frame: VideoFrame) -> None:
        source, camera = self._cameras.get(frame.camera, (0, None))
        if camera is None:
            self._refuse_unknown(f"camera '{_short(frame.camera)}'")
            return
        label = f"camera '{camera.name}'"
        checked = checked_video(frame, camera)
        if isinstance(checked, str):
            self._refuse("unusable", source, label, "video frame", checked)
            return
        admitted = self._clocks.admit(source, checked.time, self._presence.is_awaited)
        self._remark_on_clock(source, label, admitted)
        if admitted.time is None:
            return
        if not self._videos.add(admitted.time, replace(checked, time=admitted.time)):
            self.counts["duplicate"] += 1

    @property
    def _too_late(self) -> float:
        """Time (s) up to which samples come too late: the beginning of the next frame's acceleration window."""
        return -math.inf if self._start is None else self._time(self._point - 2) - ROUNDING

    def _time(self, point: int) -> float:
        assert self._start is not None
        return self._start + point / self._rate

    def _after_silence(self, past: float, present: float) -> list[LiveFrame]:
        """React to a silence of all sensors between two times of the stream."""
        if present > past - self._settings.jump:
            self._first_sample = min(self._first_sample, present)
        if not math.isfinite(past) or present - past <= self._settings.patience:
            return []
        self._presence.resume(present)
        if present - past >= self._settings.dead_after:
            what = f"were silent for {present - past:.1f} s from {past:.2f} s on"
            is_lost = past - self._lost_at <= REPEAT_S
            if is_lost:
                what += ", as the tracker did not keep up and their samples were dropped"
            consequence = "tracking starts again" if present - past > self._settings.longest_pause else "going on"
            numbers, words = {"seconds": present - past, "begin": past}, {"what": what, "then": consequence}
            finding = Finding("silent", subject="all sensors", numbers=numbers, words=words)
            if is_lost:
                self._log.tally(
                    "lost", present, lambda _: finding
                )  # repeated at intervals while the tracker does not keep up
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
            frames.append(self._make_frame())
        return frames

    def _begin(self) -> None:
        """Set the grid: from the first sample on, in step with the first video frame."""
        start, video = self._first_sample, self._videos.first_time
        if math.isfinite(video):
            start = video + math.ceil((start - video) * self._rate - 1e-6) / self._rate
        self._start = start
        self._presence.report_missing(self._clocks.present)

    def _make_frame(self) -> LiveFrame:
        point, step = self._point, 1 / self._rate
        time = self._time(point)
        measured = self._buffer.measure(time, step)
        frame = LiveFrame(point - self._left_out, time, *measured, self._take_videos(point), self._restart)
        self._restart = False
        self._point += 1
        self._buffer.needed_from = time - step  # start of the next frame's window
        return frame

    def _take_videos(self, point: int) -> tuple[VideoFrame, ...]:
        assert self._start is not None
        frames = []
        for time, video in self._videos.take(self._time(point) + 0.5 / self._rate):
            nearest = min(round((time - self._start) * self._rate), point)
            if nearest >= max(self._first_point, point - self._lag_frames):
                frames.append(replace(video, frame=nearest - self._left_out))
            elif self._first_point > nearest:
                self.counts["early"] += 1  # from before the first frame: no loss
            else:
                source, _ = self._cameras[video.camera]
                self._refuse("late", source, f"camera '{video.camera}'", "video frame")
        return tuple(frames)

    def _refuse(self, kind: str, source: int, label: str, noun: str, reason: str = "") -> None:
        self.counts[kind] += 1

        def finding(count: int) -> Finding:
            what = "came too late" if kind == "late" else f"skipped: {reason}"
            words = {"what": f"{count} {noun}{'s' if count > 1 else ''} {what}"}
            return Finding("samples unusable", subject=label, words=words)

        self._log.tally((kind, source), self._clocks.present, finding)

    def _refuse_unknown(self, label: str) -> None:
        most_names = 100  # of undeclared sensors and cameras that are reported
        self.counts["unknown"] += 1
        if label in self._unknown or len(self._unknown) > most_names:
            return
        self._unknown.add(label)
        what = "not declared in the stream's set-up, ignored; check the name"
        if len(self._unknown) > most_names:
            label, what = (
                f"more than {most_names} names",
                "are not declared in the stream's set-up; further ones are not reported",
            )
        self._log.add(Finding("samples unusable", subject=label, words={"what": what}))

    def _remark_on_clock(self, source: int, label: str, admitted: Admitted) -> None:
        if admitted.time is None:
            self.counts["clock"] += 1
        if admitted.finding is not None:
            key = ("clock", admitted.time is None)  # for all sources: clocks seldom jump alone
            finding = partial(_with_others, replace(admitted.finding, subject=label))
            self._log.tally(key, self._clocks.present, finding, GATHER_S, MOST_JUMPS)


def _with_others(finding: Finding, count: int) -> Finding:
    addition = f"; so did {count - 1} more" if count > 1 else ""
    return replace(finding, words={**finding.words, "others": addition})


def _short(name: object) -> str:
    """Shorten a name that is not declared."""
    longest_name = 80  # characters
    return str(name)[:longest_name]
