"""A stream within a program: samples are pushed as they arrive, and every frame gets an answer."""

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

    The first answers come together after a second of samples, then one for every frame. :meth:`push` works in the
    calling thread, :meth:`follow` beside the event loop.

    Args:
        setup: sensors of a wearer (:meth:`Recording.worn`), or a scene of several wearers and cameras; without samples,
            or with samples that are ignored.
        settings: settings of a stream.
        extra_factors: makes a user's GTSAM factors, as for ``smooth``.
        real_time: whether the stream does not wait for calibrations. If false they are waited for, and the answers are
            reproducible.
        on_finding: called once with every finding: of a source as it comes, of the tracker with its answer.

    Raises:
        RecordingError: if no sensor is placed, or two carriers have the same name.
    """

    def __init__(
        self,
        setup: Recording | Scene,
        settings: LiveSettings = DEFAULT,
        extra_factors: ExtraFactors | None = None,
        real_time: bool = True,
        on_finding: Callable[[Finding], None] | None = None,
    ) -> None:
        head = setup if isinstance(setup, Scene) else Scene(setup.name, (setup,))
        self._tracker = FixedLagTracker(stream_head(head), settings, extra_factors, real_time)
        self._on_finding = on_finding or (lambda _: None)
        self._pending: list[Finding] = []  # of the source, for the next answer

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
        """Push one sample of one sensor; returns the answers that it completes.

        A sample that cannot be used is left out, and the next answer reports it in its findings.

        Args:
            time: seconds on the clock of the stream.
            sensor: name of the sensor in the placement.
            orientation: ``(3, 3)`` R_inertial_sensor or ``(4,)`` unit quaternion w, x, y, z; if absent, it is estimated
                from gyroscope and acceleration (VQF, no magnetometer).
            acceleration: ``(3,)`` m/s² in the sensor's axes, with gravity.
            gyroscope: ``(3,)`` rad/s in the sensor's axes.
            wearer: name of the wearer, or of the camera that carries the sensor; the only wearer if absent.

        Raises:
            InputError: if no wearer is named and there are several.
        """
        R = None if orientation is None else np.asarray(orientation, float)
        if R is not None and R.shape == (4,):
            R = rotations_of(R[None])[0]
        force, rate = (None if values is None else np.asarray(values, float) for values in (acceleration, gyroscope))
        names = self._tracker.head.names
        if wearer is None and len(names) > 1:
            raise InputError(f"a sample of a wearer without a name: the stream has {', '.join(names)}")
        return self.take(ImuSample(wearer or names[0], sensor, time, R, force, rate))

    def push_poses(
        self, time: float, pixels: ArrayLike, confidence: ArrayLike | None = None, camera: str | None = None
    ) -> list[LiveEstimate]:
        """Push the 2D poses of all people in one video frame, which may be none; returns the answers as :meth:`push`.

        Args:
            time: seconds on the clock of the stream.
            pixels: ``(P, K, 2)`` of the camera's keypoints; NaN for missing ones.
            confidence: ``(P, K)`` in [0, 1]; if absent, 1 for keypoints that are not NaN.
            camera: name of the camera; the only camera if absent.

        Raises:
            InputError: if no camera is named and there is not exactly one.
        """
        cameras = [camera_head.name for camera_head in self._tracker.head.cameras]
        if camera is None and len(cameras) != 1:
            raise InputError(f"2D poses of a camera without a name: the stream has {', '.join(cameras) or 'none'}")
        image_points = np.asarray(pixels, float)
        is_visible = np.all(np.isfinite(image_points), axis=-1)
        sure: Array = is_visible.astype(float) if confidence is None else np.asarray(confidence, float)
        return self.take(VideoFrame(camera or cameras[0], time, image_points, sure))

    def take(self, sample: LiveItem, waited_s: float = 0.0) -> list[LiveEstimate]:
        """Take a sample of a source, or a report of lost ones for the next answer's findings.

        In real time, fewer frames are solved if ``waited_s``, the time that the sample has waited, is too long.
        """
        if isinstance(sample, LiveFinding):
            if isinstance(sample, LiveLoss):
                self._tracker.note_loss()
            if not (isinstance(sample, LiveLoss) and sample.is_repeat):
                self._pending.append(bare(sample.sentence))
                self._on_finding(self._pending[-1])
            return []
        self._tracker.note_behind(waited_s)
        return self._with_findings(self._tracker.push(sample))

    def give_up(self) -> None:
        """Stop waiting for calibrations, because the end was requested; a signal handler may call it."""
        self._tracker.give_up()

    def finish(self) -> list[LiveEstimate]:
        """End the stream: answers to the last frames."""
        return self._with_findings(self._tracker.finish())

    def estimates(self, samples: Iterable[LiveItem]) -> Iterator[LiveEstimate]:
        """Answers to all samples of an iterable, to its end."""
        for sample in samples:
            yield from self.take(sample)
        yield from self.finish()

    async def follow(self, samples: AsyncIterable[LiveItem]) -> AsyncIterator[LiveEstimate]:
        """Answers to all samples of an asynchronous iterable, to its end; computed beside the event loop."""
        async for sample in samples:
            for answer in await asyncio.to_thread(self.take, sample):
                yield answer
        for answer in await asyncio.to_thread(self.finish):
            yield answer

    def _with_findings(self, estimates: list[LiveEstimate]) -> list[LiveEstimate]:
        for finding in (finding for estimate in estimates for finding in estimate.findings):
            self._on_finding(finding)
        if estimates and self._pending:
            estimates[0] = replace(estimates[0], findings=(*self._pending, *estimates[0].findings))
            self._pending = []
        return estimates
