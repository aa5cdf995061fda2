"""A recording of hours from a clip of a minute, written as a stream: played forwards and backwards, with new noise.

Why that is a recording, and what of it repeats, is told in :mod:`tests.studies.long_stream`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies.long_stream import BLEND_S, LEAST_SCENE_S, LEAST_STEP, REST_POSE, REST_S, backwards
from tests.studies.scenes import HOLD_S, POSE, straps_and_sensors
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp
from vip_factors.io.atomic import atomic_open
from vip_factors.io.mcap_imu import sample_messages
from vip_factors.io.mcap_recording import IMU, recording_messages
from vip_factors.io.mcap_writer import MessageWriter
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.stance import with_initial_pose

IMU_RATE = 60.0  # Hz, each sensor at its own instants
CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class LongRecordingTrials:
    """How long a recording, of which sensors."""

    hours: float = 0.25
    sensors: str = "totalcapture13"  # a placement's name
    clip_s: float = 60.0  # of the clip that is played forwards and backwards
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.clip_s >= LEAST_SCENE_S:
            raise InputError(f"a clip of {self.clip_s:g} s: expected at least {LEAST_SCENE_S:g} s")
        if not self.hours > 0:
            raise InputError(f"a recording of {self.hours:g} hours: expected more than nothing")


def clip(trials: LongRecordingTrials) -> Recording:
    """A wearer at rest at both ends, with sensors without white noise: laps add it."""
    walk = gestures(trials.clip_s - HOLD_S - REST_S)
    motion = with_initial_pose(backwards(walk), REST_POSE, REST_S, BLEND_S)
    motion = with_initial_pose(backwards(motion), POSE, HOLD_S)
    errors = replace(
        straps_and_sensors(), imu_rate=IMU_RATE, angular_rate=False, filter_white_deg=0.0, acceleration_white=0.0
    )
    placement = preset(trials.sensors, motion.skeleton)
    return simulate_recording(motion, placement, errors, trials.seed, "long recording", POSE)


def write_long_recording(trials: LongRecordingTrials, path: Path) -> float:
    """Write it lap by lap, without its truth; returns its length in seconds."""
    recording = replace(clip(trials), truth=None)
    random = np.random.default_rng(trials.seed)
    end = recording.interval[1]
    with atomic_open(path, "wb") as file, MessageWriter(file, CHUNK_BYTES) as writer:
        recording_messages(writer, recording)
        for lap in range(int(np.ceil(3600 * trials.hours / end))):
            streams = [
                played
                for stream in recording.imus.values()
                for played in _played(stream, lap, end, 3600 * trials.hours, random)
            ]
            writer.add_in_order(*(sample_messages(writer, IMU + one.name, one, recording.start_ns) for one in streams))
    return 3600 * trials.hours


def _played(
    stream: ImuStream, lap: int, end: float, seconds: float, random: np.random.Generator
) -> Iterator[ImuStream]:
    """A stream in one lap: forwards in even ones, backwards in odd ones; nothing if the recording ends before."""
    order = slice(None, None, -1 if lap % 2 else 1)
    time = (lap + 1) * end - stream.time[order] if lap % 2 else lap * end + stream.time
    # Samples that are nearly as old as the last one of the lap before are left out.
    kept = (time - lap * end >= (LEAST_STEP / IMU_RATE if lap else 0.0)) & (time <= seconds)
    if not kept.any():
        return
    noise, N = straps_and_sensors(), int(np.count_nonzero(kept))
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    turn = exp(np.deg2rad(noise.filter_white_deg) * random.standard_normal((N, 3)))
    yield ImuStream(
        stream.name,
        time[kept],
        stream.specific_force[order][kept] + noise.acceleration_white * random.standard_normal((N, 3)),
        stream.R_inertial_sensor[order][kept] @ turn,
    )
