"""A stream within a program: samples are pushed as they come; an answer to every frame."""

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.errors import InputError
from vip_factors.factor_graph.extra import ExtraFactors
from vip_factors.findings import Finding, bare
from vip_factors.geometry.rotations import Array
from vip_factors.live.tracker import DEFAULT, FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.imu_stream import rotations_of
from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame, stream_head
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings


class Stream:
    """Tracks wearers while samples of their sensors are pushed.

    The first answers come after a second of samples, all at once; then one for every frame. Work is done in the thread
    that pushes; :meth:`follow` does it beside the event loop.

    Args:
        worn: who wears what (:meth:`Recording.worn`), or a scene of several and the cameras that film them. Samples in
            it are not looked at.
        settings: of all rooms.
        extra_factors: makes GTSAM factors of your own, as of ``smooth``.
        real_time: whether samples come by themselves; else what is found anew of a calibration is waited for, and the
            answers are the same each time.
        on_finding: gets every finding once: of a source as it comes, of the tracker with its answer.

    Raises:
        RecordingError: if nothing is placed, or two carriers have one name.
    """

    def __init__(
        self, worn: Recording | Scene, settings: LiveSettings = DEFAULT, extra_factors: ExtraFactors | None = None,
        real_time: bool = True, on_finding: Callable[[Finding], None] | None = None,
    ) -> None:  # fmt: skip
        head = worn if isinstance(worn, Scene) else Scene(worn.name, (worn,))
        self._tracker = FixedLagTracker(stream_head(head), settings, extra_factors, real_time)
        self._on_finding = on_finding
        self._pending: list[Finding] = []  # findings of the source, for the next answer to carry

    def push(
        self,
        time: float,
        sensor: str,
        *,
        orientation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gyroscope: ArrayLike | None = None,
        wearer: str | None = None,
    ) -> list[LiveEstimate]:
        """One sample of one sensor; the answers that it allows.

        A sample that cannot be used is left out, and the next answer's findings say so.

        Args:
            time: seconds on the clock of the stream.
            sensor: its name in the placement.
            orientation: ``(3, 3)`` R_inertial_sensor or ``(4,)`` unit quaternion w, x, y, z; absent, it is found from
                gyroscope and acceleration (VQF, no magnetometer).
            acceleration: ``(3,)`` m/s² in the sensor's axes, gravity included.
            gyroscope: ``(3,)`` rad/s in the sensor's axes.
            wearer: who wears it, or the camera that it sits on; the only wearer if absent.

        Raises:
            InputError: without a wearer's name where there are several.
        """
        R = None if orientation is None else np.asarray(orientation, float)
        if R is not None and R.shape == (4,):
            R = rotations_of(R[None])[0]
        force, rate = (None if one is None else np.asarray(one, float) for one in (acceleration, gyroscope))
        return self.take(ImuSample(self._carrier(wearer), sensor, time, R, force, rate))

    def push_poses(
        self, time: float, pixels: ArrayLike, confidence: ArrayLike | None = None, camera: str | None = None
    ) -> list[LiveEstimate]:
        """The 2D poses of everybody in one video frame; nobody is an answer too.

        Args:
            time: seconds on the clock of the stream.
            pixels: ``(P, K, 2)`` of the camera's keypoints; NaN where one was not found.
            confidence: ``(P, K)`` in [0, 1]; one wherever there is a keypoint, if absent.
            camera: its name; the only camera if absent.

        Raises:
            InputError: without a name where there is not one camera.
        """
        cameras = [one.name for one in self._tracker.head.cameras]
        if camera is None and len(cameras) != 1:
            raise InputError(f"2D poses of a camera without a name: the stream has {', '.join(cameras) or 'none'}")
        at = np.asarray(pixels, float)
        found = np.all(np.isfinite(at), axis=-1)
        sure: Array = found.astype(float) if confidence is None else np.asarray(confidence, float)
        return self.take(VideoFrame(camera or cameras[0], time, at, sure))

    def take(self, item: LiveItem, waited_s: float = 0.0) -> list[LiveEstimate]:
        """What a source brings: a sample, or a sentence about those that were lost, which the next answer carries.

        Of samples that have waited for too long, in a stream in real time, fewer frames are solved.
        """
        if isinstance(item, LiveFinding):
            if isinstance(item, LiveLoss):
                self._tracker.note_loss()
            if not (isinstance(item, LiveLoss) and item.is_repeat):
                finding = bare(item.sentence)
                self._pending.append(finding)
                self._report(finding)
            return []
        self._tracker.note_behind(waited_s)
        return self._with_findings(self._tracker.push(item))

    def give_up(self) -> None:
        """Wait for no calibration any more, as the end was asked for; a signal handler may call it."""
        self._tracker.give_up()

    def finish(self) -> list[LiveEstimate]:
        """The end: answers to the last frames."""
        return self._with_findings(self._tracker.finish())

    def answers(self, items: Iterable[LiveItem]) -> Iterator[LiveEstimate]:
        """The answers to all samples of an iterable, to its end."""
        for item in items:
            yield from self.take(item)
        yield from self.finish()

    async def follow(self, items: AsyncIterable[LiveItem]) -> AsyncIterator[LiveEstimate]:
        """The answers to all samples of an asynchronous iterable, to its end; worked out beside the event loop."""
        async for item in items:
            for answer in await asyncio.to_thread(self.take, item):
                yield answer
        for answer in await asyncio.to_thread(self.finish):
            yield answer

    def _carrier(self, wearer: str | None) -> str:
        names = self._tracker.head.names
        if wearer is None and len(names) > 1:
            raise InputError(f"a sample of a wearer without a name: the stream has {', '.join(names)}")
        return wearer or names[0]

    def _report(self, *findings: Finding) -> None:
        if self._on_finding is not None:
            for finding in findings:
                self._on_finding(finding)

    def _with_findings(self, answers: list[LiveEstimate]) -> list[LiveEstimate]:
        for answer in answers:
            self._report(*answer.findings)
        if answers and self._pending:
            answers[0] = replace(answers[0], findings=(*self._pending, *answers[0].findings))
            self._pending = []
        return answers
