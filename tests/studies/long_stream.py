"""A stream of any length from a scene of a minute, played forwards and backwards with new noise; and what memory and
time a recording of hours takes that is made so.

Mechanics has no direction of time: played backwards, orientations and specific forces are still those of one and the
same motion, and the video shows it. The wearer rests at both ends, so nothing jolts where the direction turns. What is
drawn slowly (calibration, filter errors, straps, the detector's habits) repeats with the scene; white noise is new.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Literal

import numpy as np

from tests.studies.processes import apart, peak_memory
from tests.studies.scenes import HOLD_S, PLACEMENT, POSE, straps_and_sensors
from tests.studies.study import MB, Study, Tell, group, table
from vip_factors.atomic import atomic_open
from vip_factors.body.kinematics import Motion
from vip_factors.cli.workers import windows_elsewhere
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp
from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.io.mcap_frames import sample_messages
from vip_factors.io.mcap_messages import MessageWriter
from vip_factors.io.mcap_recording import IMU, recording_messages
from vip_factors.io.mcap_source import open_source
from vip_factors.pipeline import smooth_chunks
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import ImuSample, LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import WHITE_DEG, WHITE_FORCE, simulate_recording
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings, SimulateSettings
from vip_factors.simulate.staging import with_initial_pose

REST_POSE, REST_S, BLEND_S = "n-pose", 1.0, 1.0  # at the end of the scene
LEAST_SCENE_S = 8.0  # the poses at both ends, their blends, and something to see in between
LEAST_STEP = 0.25  # of the period of a stream: samples nearer than that to the turn are not sent twice
IMU_RATE = 60.0  # Hz, each sensor at its own instants
CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class LongStreamTrials:
    """The stream that speed is measured on: one wearer of 13 sensors before a camera with an IMU on it."""

    seconds: float = 600.0
    scene_s: float = 60.0  # of the scene that is played forwards and backwards
    camera: CameraKind = "hand-held"
    placement: str = PLACEMENT
    imu_rate: float = IMU_RATE
    video_rate: float = 30.0  # Hz
    keypoints: str = "openpose18"  # COCO-18
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.scene_s >= LEAST_SCENE_S:
            raise InputError(f"a scene of {self.scene_s:g} s: expected at least {LEAST_SCENE_S:g} s")
        if not self.seconds > 0:
            raise InputError(f"a stream of {self.seconds:g} s: expected more than nothing")


def resting(seconds: float) -> Motion:
    """Gestures from a T-pose to an N-pose, at rest at both ends."""
    walk = gestures(seconds - HOLD_S - REST_S)
    motion = with_initial_pose(backwards(walk), REST_POSE, REST_S, BLEND_S)
    return with_initial_pose(backwards(motion), POSE, HOLD_S)


def backwards(motion: Motion) -> Motion:
    """The motion from its end to its start."""
    return replace(motion, R_parent_child=motion.R_parent_child[::-1], p_world_pelvis=motion.p_world_pelvis[::-1])


def without_white_noise(imu_rate: float) -> SimulateSettings:
    """Sensors of which every lap adds the noise."""
    return replace(straps_and_sensors(), imu_rate=imu_rate, white_noise=0.0)


def stream_scene(trials: LongStreamTrials) -> Scene:
    """The scene, at rest at both ends, without white noise of the IMUs: :class:`LongStream` adds it."""
    motion = resting(trials.scene_s)
    settings = SceneSettings(
        camera=trials.camera, video_rate=trials.video_rate, keypoints=trials.keypoints,
        imu=without_white_noise(trials.imu_rate),
    )  # fmt: skip
    performer = Performer("wearer", motion, preset(trials.placement, motion.skeleton), POSE)
    return simulate_scene([performer], settings, trials.seed, "long stream")


class LongStream:
    """The samples of a scene, over and over; the same each time that they are asked for.

    Args:
        scene: at rest at both ends, of streams without white noise.
        trials: how long, and its noise.
    """

    def __init__(self, scene: Scene, trials: LongStreamTrials) -> None:
        self.setup, self._trials = stream_head(scene), trials
        self._samples = list(live_samples(scene))
        self._end = max(sample.time for sample in self._samples)
        imus = [sample for sample in self._samples if isinstance(sample, ImuSample)]
        self._R = np.stack([np.eye(3) if imu.R_inertial_sensor is None else imu.R_inertial_sensor for imu in imus])

    def __iter__(self) -> Iterator[LiveSample]:
        lap, random, last = 0, np.random.default_rng(self._trials.seed), dict[tuple[str, str], float]()
        while lap * self._end < self._trials.seconds:
            for sample in self._lap(lap, random):
                if sample.time > self._trials.seconds:
                    return
                if isinstance(sample, ImuSample):
                    key, rate = (sample.carrier, sample.sensor), self._trials.imu_rate
                else:
                    key, rate = (sample.camera, ""), self._trials.video_rate
                if sample.time - last.get(key, -1.0) >= LEAST_STEP / rate:
                    last[key] = sample.time
                    yield sample
            lap += 1

    def _lap(self, lap: int, random: np.random.Generator) -> Iterator[LiveSample]:
        turns = exp(np.deg2rad(WHITE_DEG) * random.standard_normal((len(self._R), 3)))
        R = self._R @ turns
        force = WHITE_FORCE * random.standard_normal((len(self._R), 3))
        there = lap % 2 == 0
        imu = 0 if there else len(self._R) - 1
        for sample in self._samples if there else reversed(self._samples):
            time = lap * self._end + (sample.time if there else self._end - sample.time)
            if not isinstance(sample, ImuSample):
                yield replace(sample, time=time)
                continue
            measured = None if sample.specific_force is None else sample.specific_force + force[imu]
            own = None if sample.R_inertial_sensor is None else R[imu].copy()
            yield replace(sample, time=time, R_inertial_sensor=own, specific_force=measured)
            imu += 1 if there else -1


@dataclass(frozen=True)
class LongRun:
    """One recording.

    Attributes:
        frames: of the estimate.
        seconds, cpu_seconds: of wall, and of processors by this process alone, from opening the recording to the
            estimate's name.
        before, peak: resident bytes before the recording was opened, and at most; of this process alone.
        recording_bytes, estimate_bytes: of the files.
    """

    frames: int
    seconds: float
    cpu_seconds: float
    before: int
    peak: int
    recording_bytes: int
    estimate_bytes: int


@dataclass(frozen=True, kw_only=True)
class Long(Study):
    """What memory and time a recording of hours takes, solved window by window: simulated, and written to disk."""

    hours: float = 0.25
    """Of the simulated recording, of IMUs at 60 Hz; an hour takes half a GB of disk, with its estimate."""
    sensors: Literal["sip6", "tnt10", "totalcapture13", "mvn17"] = "totalcapture13"
    """Which sensors."""
    clip_s: float = 60.0
    """Of the clip that is played forwards and backwards, with new noise."""
    jobs: int = 1
    """Processes that solve windows."""

    def __post_init__(self) -> None:
        if not self.clip_s >= LEAST_SCENE_S:
            raise InputError(f"a clip of {self.clip_s:g} s: expected at least {LEAST_SCENE_S:g} s")
        if not self.hours > 0:
            raise InputError(f"a recording of {self.hours:g} hours: expected more than nothing")

    def rows(self, tell: Tell) -> Iterator[LongRun]:
        with TemporaryDirectory(prefix="vip_factors_") as folder:
            recording, estimate = Path(folder) / "long.mcap", Path(folder) / "long.estimate.mcap"
            tell("making the recording", 0.0)
            apart(self.write, recording)
            tell("smoothing", 0.1)
            yield apart(smoothed, recording, estimate, self.jobs)

    def write(self, path: Path) -> None:
        """The recording lap by lap, without its truth."""
        motion, errors = resting(self.clip_s), replace(without_white_noise(IMU_RATE), angular_rate=False)
        clip = simulate_recording(motion, preset(self.sensors, motion.skeleton), errors, 0, "long recording", POSE)
        clip, seconds = replace(clip, truth=None), 3600 * self.hours
        stream = LongStream(Scene(clip.name, (clip,)), LongStreamTrials(seconds, self.clip_s))
        with atomic_open(path, "wb") as file, MessageWriter(file, clip.start_ns, CHUNK_BYTES) as writer:
            recording_messages(writer, clip)
            for _, samples in groupby(stream, lambda sample: int(sample.time / clip.interval[1])):
                own = group(
                    (sample for sample in samples if isinstance(sample, ImuSample)), lambda sample: sample.sensor
                )
                streams = [_imu_stream(name, several) for name, several in own.items()]
                writer.add_in_order(*(sample_messages(writer, IMU + stream.name, stream) for stream in streams))

    def tables(self, rows: Sequence[LongRun]) -> Iterator[str]:
        yield f"{self.hours:g} h of {self.sensors}, a clip of {self.clip_s:g} s repeated"
        head = [
            "frames",
            "peak MB",
            "of which before",
            "s",
            "s an hour",
            "CPU s an hour",
            "recording MB",
            "estimate MB",
        ]
        numbers = (
            (row.peak / MB, row.before / MB, row.seconds, row.seconds / self.hours, row.cpu_seconds / self.hours,
             row.recording_bytes / MB, row.estimate_bytes / MB) for row in rows
        )  # fmt: skip
        yield table(head, [[r.frames, *(f"{n:.0f}" for n in own)] for r, own in zip(rows, numbers, strict=True)])


def _imu_stream(name: str, samples: Sequence[ImuSample]) -> ImuStream:
    force, R = (np.array([getattr(sample, of) for sample in samples]) for of in ("specific_force", "R_inertial_sensor"))
    return ImuStream(name, np.array([sample.time for sample in samples]), force, R)


def smoothed(recording: Path, estimate: Path, jobs: int = 1) -> LongRun:
    """As ``vip-factors smooth`` does."""
    before, begin, cpu = peak_memory(), perf_counter(), process_time()
    with windows_elsewhere(jobs, None) as each:
        chunks = smooth_chunks(open_source([recording], Settings().windows.above_s), map_fn=each)
        write_estimate(chunks, estimate)
        seconds = perf_counter() - begin
    cpu_seconds = process_time() - cpu
    sizes = (path.stat().st_size for path in (recording, estimate))
    return LongRun(chunks.frames[0], seconds, cpu_seconds, before, peak_memory(), *sizes)
