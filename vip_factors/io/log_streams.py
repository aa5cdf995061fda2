"""Steps between the streams of logs and a recording.

Logs of one session are joined; a calibration pose that was held in another log or in one row is put before the
recording; gaps, early ends and unequal rates are noted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.errors import InputError, RecordingError, nearest
from vip_factors.geometry.rotations import Array, mean_rotation
from vip_factors.io.importers.shared import GRAVITY, UP, ImportedLog
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.imu_stream import FORCE_LIMIT, ImuStream, with_orientation
from vip_factors.sensors.multi_file import join_recordings
from vip_factors.sensors.recording import Recording, Subject

MEAN_S = 1.0  # of the other log's start: people hold a pose for longer, and sway within it
HOLD_S = 1.0  # that the pose is held in the recording: as long as a declared pose is believed
TURN_S = 2.0  # without samples, to turn around in and begin: any way of facing is reached in it
LEAD_S = HOLD_S + TURN_S


def pose_source(text: str) -> tuple[Path, int | None]:
    """Parse the source of a pose: ``LOG``, on average over its first second, or ``LOG:SAMPLE``, from 1 on.

    Raises:
        InputError: for a sample that is no number from 1 on.
    """
    path, colon, sample = text.rpartition(":")
    if not colon or Path(text).exists():
        return Path(text), None
    if not sample.isdecimal() or int(sample) < 1:
        raise InputError(f"pose from '{text}': sample '{sample}': expected LOG, or LOG:SAMPLE with a number from 1 on")
    return Path(path), int(sample)


def held_orientations(imus: Mapping[str, ImuStream], path: Path, sample: int | None) -> dict[str, Array]:
    """``R_inertial_sensor (3, 3)`` of each sensor of the log ``path`` in the pose, as :func:`pose_source` says.

    Raises:
        InputError: if a sensor has no orientation of its own, or not that many samples.
    """
    pose = {}
    for name, stream in imus.items():
        R = stream.R_inertial_sensor
        if R is None:
            raise InputError(
                f"{path}: sensor '{name}' has no orientation: a pose held in another log needs the sensors' own "
                "orientations, since one found from their other samples has another heading in every log"
            )
        if sample is None:
            pose[name] = mean_rotation(R[stream.time <= stream.time[0] + MEAN_S])
        elif sample > len(R):
            raise InputError(f"{path}: sensor '{name}' has {len(R)} samples: there is no sample {sample}")
        else:
            pose[name] = R[sample - 1]
    return pose


def without_sample(imus: Mapping[str, ImuStream], sample: int) -> dict[str, ImuStream]:
    """The streams after the sample in which the pose was held, with time 0 at the first sample.

    Raises:
        InputError: if a sensor has no other samples.
    """
    later = {}
    for name, stream in imus.items():
        if len(stream) <= sample:
            raise InputError(f"sensor '{name}' has {len(stream)} samples: none is left after the pose's, {sample}")
        later[name] = stream.cut(stream.time[sample], np.inf)
    start = min(stream.time[0] for stream in later.values())
    return {name: replace(stream, time=stream.time - start) for name, stream in later.items()}


def after_pose(imus: Mapping[str, ImuStream], held: Mapping[str, Array], notes: list[str]) -> dict[str, ImuStream]:
    """The streams :data:`LEAD_S` later, each with the pose before it; sensors whose pose is unknown are left out.

    Raises:
        InputError: if no sensor's pose is known.
    """
    joined = {}
    for name, stream in imus.items():
        if name not in held:
            notes.append(f"sensor '{name}' is not in the log of the held pose{nearest(name, held)}: left out")
            continue
        if stream.R_inertial_sensor is None:
            notes.append(f"sensor '{name}' has no orientation of its own to compare with the held pose: left out")
            continue
        R, step = held[name], 1 / stream.rate if stream.rate else HOLD_S
        time = np.arange(0.0, HOLD_S + step / 2, step)
        count = len(time)
        force, rate = stream.specific_force, stream.angular_rate
        joined[name] = replace(
            stream,
            time=np.concatenate([time, stream.time + LEAD_S]),
            R_inertial_sensor=np.concatenate([np.tile(R, (count, 1, 1)), stream.R_inertial_sensor]),
            specific_force=None if force is None else np.concatenate([np.tile(GRAVITY * R.T @ UP, (count, 1)), force]),
            angular_rate=None if rate is None else np.concatenate([np.zeros((count, 3)), rate]),
        )
    if not joined:
        raise InputError(f"none of the sensors {', '.join(imus)} is in the held pose, which has {', '.join(held)}")
    notes.append(
        f"the pose held before stands at 0 to {HOLD_S:g} s; what was recorded begins at {LEAD_S:g} s (add that to a "
        "video's times too), and how the wearer got from one to the other is made up"
    )
    return joined


LEAP_S = 86_400.0  # nobody pauses for a day within one recording: a clock was set, or a row is no sample
LONG_GAP_S = 1.0  # shorter ones are bridged by the neighbours; over longer ones a limb can have done anything
MISSING_END_S = 1.0  # sensors are switched off within a second of each other
UNEQUAL_RATE = 0.02


def coverage_notes(imus: Mapping[str, ImuStream]) -> list[str]:
    """Sentences on sensors that start late, stop early, lack seconds in between, or run at another rate."""
    if not imus:
        return []
    notes = []
    first, last = min(s.time[0] for s in imus.values()), max(s.time[-1] for s in imus.values())
    for name, stream in imus.items():
        start, end = float(stream.time[0]), float(stream.time[-1])
        if start - first > MISSING_END_S:
            notes.append(f"sensor '{name}' starts {start - first:.1f} s after the first one")
        if last - end > MISSING_END_S:
            notes.append(f"sensor '{name}' stops at {end:.1f} s, {last - end:.1f} s before the last one")
        if spikes := int(np.count_nonzero(~stream.force_measured_mask)) if stream.specific_force is not None else 0:
            notes.append(f"sensor '{name}' gives more than {FORCE_LIMIT:g} m/s² in {spikes} samples: interpolated")
        gaps = stream.gaps
        long = gaps[gaps[:, 1] - gaps[:, 0] > LONG_GAP_S]
        if len(long):
            longest = float(np.max(long[:, 1] - long[:, 0]))
            notes.append(
                f"sensor '{name}' has {len(long)} gaps longer than {LONG_GAP_S:g} s, the longest of {longest:.1f} s, "
                f"the first at {long[0, 0]:.1f} s"
            )
    # A low percentile of the steps, which losses do not lengthen.
    rates = {
        name: 1 / float(np.percentile(np.diff(stream.time), 10)) for name, stream in imus.items() if len(stream) > 1
    }
    if rates:
        slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
        if rates[fast] > rates[slow] * (1 + UNEQUAL_RATE):
            notes.append(
                f"sensors run at different rates: '{slow}' at {rates[slow]:.1f} Hz, '{fast}' at {rates[fast]:.1f} Hz"
            )
    return notes


def check_leaps(imus: Mapping[str, ImuStream]) -> None:
    """Check for leaps in time, as where a pose held before stands at 0 s in a log of Unix time.

    Raises:
        InputError: if all sensors have no sample for a day.
    """
    if not imus:
        return
    time = np.unique(np.concatenate([stream.time for stream in imus.values()]))
    leaps = np.flatnonzero(np.diff(time) > LEAP_S)
    if len(leaps):
        before, after = time[leaps[0]], time[leaps[0] + 1]
        rows = max(int(np.sum(stream.time <= before)) for stream in imus.values())
        raise InputError(
            f"all sensors' times leap from {before:.2f} to {after:.2f} s after row {rows} of a sensor: no recording "
            f"pauses for days; leave out what is before with --start-s {np.floor(100 * after) / 100:.2f}, or, if it is "
            "a pose that was held before, say --initial-pose n-pose (or t-pose) and --pose-from LOG:1"
        )


def log_in_parts(logs: Sequence[ImportedLog], sources: Sequence[str]) -> ImportedLog:
    """Join logs by absolute starts, others by their own clock, which must not restart; the truth is dropped.

    Raises:
        InputError: as :func:`~vip_factors.sensors.multi_file.join_sources`, with the names in ``sources``.
    """
    clocks = [0.0 if log.start_ns or log.clock_s is None else log.clock_s for log in logs]
    recordings = []
    for log, clock, source in zip(logs, clocks, sources, strict=True):
        imus = {name: replace(imu, time=imu.time + (clock - min(clocks))) for name, imu in log.imus.items()}
        recordings.append(Recording(source, Subject(), imus, Placement(), start_ns=log.start_ns))
    joined = join_recordings(recordings, sources)
    first = logs[[part.name for part in recordings].index(joined.name)]
    notes = dict.fromkeys(note for log in logs for note in log.notes)
    return replace(first, imus=joined.imus, truth_motion=None, notes=(f"parts: {', '.join(sources)}", *notes))


def with_orientations(imus: Mapping[str, ImuStream], notes: list[str]) -> dict[str, ImuStream]:
    """The streams, with orientations from acceleration and angular rate where the log has none.

    Raises:
        RecordingError: if no stream has an orientation, for the reason of the first that could have one.
    """
    oriented, filtered, errors = {}, [], list[RecordingError]()
    for name, stream in imus.items():
        oriented[name] = stream
        if stream.R_inertial_sensor is not None:
            continue
        if stream.angular_rate is None or stream.specific_force is None:
            notes.append(f"sensor '{name}' has no orientation and no angular rate to find it from: it cannot be used")
            continue
        try:
            oriented[name] = with_orientation(stream)
            filtered.append(name)
        except RecordingError as error:
            errors.append(error)
            notes.append(f"sensor '{name}' has no orientation, and none can be found: {error}")
    if errors and all(stream.R_inertial_sensor is None for stream in oriented.values()):
        raise errors[0]
    if filtered:
        notes.append(f"orientation from acceleration and angular rate (VQF), heading arbitrary: {', '.join(filtered)}")
    return oriented
