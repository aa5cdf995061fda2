"""A stream or a recording of any length from a scene of a minute: played forwards and backwards, with new noise.

Mechanics has no direction of time: played backwards, orientations and specific forces are still those of one and the
same motion, and the video shows it. The wearer rests at both ends, so nothing jolts where the direction turns. What is
drawn slowly (calibration, filter errors, straps, the detector's habits) repeats with the scene; white noise is new.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.studies.scenes import HOLD_S, PLACEMENT, POSE, straps_and_sensors
from tests.studies.study import Study
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import ImuSample, LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import CameraKind, SceneSettings
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose

REST_POSE, REST_S, BLEND_S = "n-pose", 1.0, 1.0  # at the end of the scene
LEAST_SCENE_S = 8.0  # the poses at both ends, their blends, and something to see in between
LEAST_STEP = 0.25  # of the period of a stream: samples nearer than that to the turn are not sent twice
IMU_RATE = 60.0  # Hz, each sensor at its own instants


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


@dataclass(frozen=True, kw_only=True)
class LongStreamStudy(Study):
    """Options of studies on such a stream."""

    minutes: float = 10.0
    """Of the simulated stream: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    scene_s: float = 60.0
    """Of the scene that is played forwards and backwards, with new noise."""
    camera: CameraKind = "hand-held"
    """What films."""

    @property
    def stream(self) -> LongStreamTrials:
        return LongStreamTrials(60 * self.minutes, self.scene_s, self.camera)


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
    return replace(straps_and_sensors(), imu_rate=imu_rate, filter_white_deg=0.0, acceleration_white=0.0)


def stream_scene(trials: LongStreamTrials) -> Scene:
    """The scene, at rest at both ends, without white noise of the IMUs: :class:`LongStream` adds it."""
    motion = resting(trials.scene_s)
    settings = SceneSettings.realistic(
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
        imus = [one for one in self._samples if isinstance(one, ImuSample)]
        self._R = np.stack([np.eye(3) if one.R_inertial_sensor is None else one.R_inertial_sensor for one in imus])

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
        noise = straps_and_sensors()
        turns = exp(np.deg2rad(noise.filter_white_deg) * random.standard_normal((len(self._R), 3)))
        R = self._R @ turns
        force = noise.acceleration_white * random.standard_normal((len(self._R), 3))
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
