"""Memory and time that a long recording takes, read, solved and written in windows: in a process of its own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Literal

import numpy as np

from tests.studies.long_stream import IMU_RATE, LEAST_SCENE_S, LEAST_STEP, resting, without_white_noise
from tests.studies.processes import apart, peak_memory
from tests.studies.scenes import POSE, straps_and_sensors
from tests.studies.study import MB, Study, Tell, table
from vip_factors.atomic import atomic_open
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp
from vip_factors.io.mcap_estimate_writer import write_estimate
from vip_factors.io.mcap_recording import IMU, recording_messages
from vip_factors.io.mcap_samples import sample_messages
from vip_factors.io.mcap_source import open_source
from vip_factors.io.mcap_writer import MessageWriter
from vip_factors.pipeline import smooth_chunks
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.settings import Settings
from vip_factors.simulate.recording import simulate_recording

CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class LongRun:
    """One recording.

    Attributes:
        frames: of the estimate.
        seconds, cpu_seconds: of wall and of processors, from opening the recording to the estimate's name.
        before, peak: resident bytes before the recording was opened, and at most.
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
            yield apart(smoothed, recording, estimate)

    def write(self, path: Path) -> None:
        """The recording lap by lap, without its truth: in even laps forwards, in odd ones backwards."""
        motion, errors = resting(self.clip_s), replace(without_white_noise(IMU_RATE), angular_rate=False)
        clip = simulate_recording(motion, preset(self.sensors, motion.skeleton), errors, 0, "long recording", POSE)
        clip, random, seconds = replace(clip, truth=None), np.random.default_rng(0), 3600 * self.hours
        end = clip.interval[1]
        with atomic_open(path, "wb") as file, MessageWriter(file, CHUNK_BYTES) as writer:
            recording_messages(writer, clip)
            for lap in range(int(np.ceil(seconds / end))):
                streams = [played for one in clip.imus.values() for played in _played(one, lap, end, seconds, random)]
                writer.add_in_order(*(sample_messages(writer, IMU + one.name, one, clip.start_ns) for one in streams))

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
            (one.peak / MB, one.before / MB, one.seconds, one.seconds / self.hours, one.cpu_seconds / self.hours,
             one.recording_bytes / MB, one.estimate_bytes / MB) for one in rows
        )  # fmt: skip
        yield table(head, [[r.frames, *(f"{n:.0f}" for n in own)] for r, own in zip(rows, numbers, strict=True)])


def _played(
    stream: ImuStream, lap: int, end: float, seconds: float, random: np.random.Generator
) -> Iterator[ImuStream]:
    """A stream in one lap; nothing if the recording ends before."""
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
    force = stream.specific_force[order][kept] + noise.acceleration_white * random.standard_normal((N, 3))
    yield ImuStream(stream.name, time[kept], force, stream.R_inertial_sensor[order][kept] @ turn)


def smoothed(recording: Path, estimate: Path) -> LongRun:
    """As ``vip-factors smooth`` does."""
    before, begin, cpu = peak_memory(), perf_counter(), process_time()
    chunks = smooth_chunks(open_source([recording], Settings().windows.above_s))
    write_estimate(chunks, estimate)
    seconds, cpu_seconds = perf_counter() - begin, process_time() - cpu
    sizes = (path.stat().st_size for path in (recording, estimate))
    return LongRun(chunks.frames[0], seconds, cpu_seconds, before, peak_memory(), *sizes)
