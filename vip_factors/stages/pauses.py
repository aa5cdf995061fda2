"""Pauses of a recording, and headings that are others after them.

Where sensors say nothing for more than a second they may have been switched off: their filters begin anew, each with a
heading of its own, and a log's clock need not tell how long it was. The start of headings and mountings is searched for
in one stretch between pauses, and exchanged sensors are sought there; clocks are compared over all stretches. Headings
of the other stretches are searched for with the mountings of that one; where they explain a stretch much better than
those of its neighbour, headings step over the pause between them
(:class:`~vip_factors.factor_settings.HeadingWalkSettings`).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, rotation_z, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.start_candidates import START_RATE
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Pause, Recording
from vip_factors.sensors.sources import RecordingSource, SceneInMemory, SceneSource, frames_of, streams_between
from vip_factors.settings import CommonSettings, Settings
from vip_factors.stages.calibration_start import start_search
from vip_factors.stages.windows import is_long

LEAST_S = 4.0  # of a stretch that tells its headings: some steps; a shorter one has those of before
JUMP = np.deg2rad(20.0)  # a heading found this near is the one of before: mountings and posture leave as much open
SURE = 20.0  # nats by which other headings explain a stretch better: up to 13 where none had jumped
FEW = 3  # sensors that a finding names


def pauses_of(streams: Mapping[str, ImuStream]) -> tuple[Pause, ...]:
    """The pauses between stretches of some seconds, in the order of time; where those of sensors meet, they are one."""
    pause_s = 1.0  # packets lost by radio come back sooner
    gaps = [
        (float(start), float(end), name)
        for name, stream in streams.items()
        for start, end in stream.gaps
        if end - start > pause_s
    ]
    pauses = list[Pause]()
    for start, end, name in sorted(gaps):
        if pauses and start - pauses[-1].end < LEAST_S:
            previous = pauses[-1]
            pauses[-1] = Pause(previous.start, max(previous.end, end), previous.silent | {name})
        else:
            pauses.append(Pause(start, end, frozenset({name})))
    begin = min((float(stream.time[0]) for stream in streams.values()), default=0.0)
    finish = max((float(stream.time[-1]) for stream in streams.values()), default=0.0)
    return tuple(pause for pause in pauses if pause.start - begin >= LEAST_S and finish - pause.end >= LEAST_S)


def with_pauses(source: SceneSource, settings: Settings) -> tuple[SceneSource, tuple[Finding, ...]]:
    """The source whose recordings say where they pause, and findings on that.

    Recordings that are solved in windows stay as they are: findings name the times without any sample.
    """
    if any(is_long(recording.interval, settings) for recording in source.wearers):
        findings = (
            _pause_finding(recording.head, silences_of(recording), len(recording.sensors))
            for recording in source.wearers
        )
        return source, tuple(finding for finding in findings if finding.numbers)
    scene = source.between()
    wearers = tuple(
        replace(recording, pauses=pauses_of({name: recording.imus[name] for name in recording.placed}))
        for recording in scene.wearers
    )
    paused = [recording for recording in wearers if recording.pauses]
    if not paused:
        return source, ()
    findings = (_pause_finding(recording, recording.pauses, len(recording.placed)) for recording in paused)
    return SceneInMemory(replace(scene, wearers=wearers)), tuple(findings)


def silences_of(recording: RecordingSource) -> tuple[Pause, ...]:
    """Times of some seconds in which no sensor measured anything; the samples are read a minute at a time."""
    minute = 60.0
    start, end = recording.interval
    last_time, silences = start, list[Pause]()
    for begin in np.arange(start, end, minute):
        streams = recording.between(float(begin), float(begin + minute)).values()
        time = np.unique(np.concatenate([[last_time], *(stream.time for stream in streams)]))
        for row in np.flatnonzero(np.diff(time) > LEAST_S):
            silences.append(Pause(float(time[row]), float(time[row + 1]), frozenset(recording.sensors)))
        last_time = float(time[-1])
    return tuple(silences)


def _pause_finding(recording: Recording, pauses: Sequence[Pause], sensors: int) -> Finding:
    seconds = {f"{_named(pause.silent, sensors)} at {pause.start:.1f} s": pause.end - pause.start for pause in pauses}
    return Finding("pauses", recording.subject.name, numbers=seconds)


def between_pauses(recording: Recording) -> Recording:
    """The stretch of a recording in which sensors are compared: without pauses all of it."""
    if not recording.pauses:
        return recording
    start, end = interval_between_pauses(recording, recording.interval)
    return replace(recording, imus=streams_between(recording.imus, recording.placed, start, end), pauses=())


def frames_between_pauses(recording: Recording, frames: ImuFrames) -> ImuFrames:
    """The frames of that stretch."""
    if not recording.pauses:
        return frames
    start, end = interval_between_pauses(recording, recording.interval)
    return frames.window(slice(*np.searchsorted(frames.time, (start, end)).tolist()))


def interval_between_pauses(recording: Recording, interval: tuple[float, float]) -> tuple[float, float]:
    """Seconds from and until which that stretch of a recording goes; the recording itself goes for an ``interval``."""
    stretches = _stretches(recording, interval)
    start, end = stretches[_compared(recording, stretches)].tolist()
    return start, end


def _stretches(recording: Recording, interval: tuple[float, float]) -> Array:
    """Seconds ``(P + 1, 2)`` from and until which the stretches between pauses go."""
    edges = [time for pause in recording.pauses for time in (pause.start, pause.end)]
    return np.array([interval[0], *edges, interval[1]]).reshape(-1, 2)


def _compared(recording: Recording, stretches: Array) -> int:
    """Which of the stretches headings and mountings are found in: the longest, or that with the declared pose."""
    return 0 if recording.initial_pose != "none" else int(np.argmax(np.diff(stretches, axis=1)))


def headings_after_pauses(
    recording: Recording, sensors: Sequence[str], calibration: InitialCalibration, settings: CommonSettings
) -> tuple[Array, Array]:
    """Pauses over which headings step, ``(P, 2)`` seconds, and headings ``(P + 1, S)`` before, between and after them.

    Args:
        recording: with its pauses.
        sensors: that it has placed.
        calibration: of the stretch of :func:`between_pauses`.
        settings: of the search.
    """
    options = settings.calibration
    if len(sensors) < 2 or not recording.pauses or not options.estimate_headings or options.from_truth:
        return np.zeros((0, 2)), calibration.headings[None]
    stretches = _stretches(recording, recording.interval)
    reference = _compared(recording, stretches)
    headings = np.tile(calibration.headings, (len(stretches), 1))
    for order, neighbour in ((range(reference + 1, len(stretches)), -1), (range(reference - 1, -1, -1), 1)):
        for number in order:
            near = replace(calibration, headings=headings[number + neighbour], R_world_bone=None)
            headings[number] = _headings_in(recording, sensors, stretches[number], near, settings)
    differences = zip(recording.pauses, np.diff(headings, axis=0), strict=True)
    jumps = np.stack([_jumps(pause, sensors, jumped) for pause, jumped in differences])
    path = np.vstack([np.zeros(len(sensors)), np.cumsum(jumps, axis=0)])
    steps = np.flatnonzero(jumps.any(axis=1))
    edges = np.array([(pause.start, pause.end) for pause in recording.pauses])
    return edges[steps], (calibration.headings + path - path[reference])[np.r_[0, steps + 1]]


def _headings_in(
    recording: Recording,
    sensors: Sequence[str],
    stretch: Array,
    neighbour_calibration: InitialCalibration,
    settings: CommonSettings,
) -> Array:
    """Headings ``(S,)`` that explain a stretch, seconds from and until; the neighbour's where those do as well."""
    start, end = stretch.tolist()
    time = np.arange(start, end, 1 / START_RATE)
    frames = frames_of(streams_between(recording.imus, sensors, start, end), sensors, time)
    turn = rotation_z(neighbour_calibration.headings)
    frames = replace(
        frames,
        R_inertial_sensor=turn @ frames.R_inertial_sensor,
        specific_force_inertial=np.einsum("sij,tsj->tsi", turn, frames.specific_force_inertial),
    )
    search = start_search(recording, frames, settings, known_mountings=True)
    same = InitialCalibration(
        np.zeros(len(sensors)), np.full(len(sensors), np.inf), neighbour_calibration.R_bone_sensor
    )
    turned = wrap_angle(search.best(same, same.R_bone_sensor).best.calibration.headings)
    jumped = replace(same, headings=np.where(np.abs(turned) > JUMP, turned, 0.0))
    sure = search.cost(same) - search.cost(jumped) > SURE
    return neighbour_calibration.headings + sure * turned


def _jumps(pause: Pause, sensors: Sequence[str], jumped: Array) -> Array:
    """``(S,)`` radians by which headings are more after a pause, of those ``(S,)`` of which only differences are known.

    Most sensors that measured on, or of all most sensors, are taken to have kept their headings.
    """
    silent = np.array([name in pause.silent for name in sensors])
    reference = jumped if silent.all() else jumped[~silent]
    moved = np.abs(wrap_angle(jumped - reference[:, None])) > JUMP
    jumps = wrap_angle(jumped - reference[int(np.argmin(moved.sum(axis=1)))])
    return np.where(silent & (np.abs(jumps) > JUMP), jumps, 0.0)


def jump_findings(wearer: str, calibration: Mapping[str, SensorCalibration], restarts: Array) -> Iterator[Finding]:
    """Return findings about headings that step over pauses ``(P, 2)`` in seconds."""
    far = dict[str, float]()
    for pause in restarts:
        jumps = {name: float(np.abs(np.diff(sensor.heading_at(pause))[0])) for name, sensor in calibration.items()}
        jumped = [name for name, jump in jumps.items() if jump > JUMP]
        if jumped:
            far[f"{_named(jumped, len(calibration))} at {pause[1]:.1f} s"] = float(np.rad2deg(max(jumps.values())))
    if far:
        yield Finding("headings after pauses", wearer, numbers=far)


def _named(sensors: Collection[str], count: int) -> str:
    if len(sensors) <= FEW:
        return ", ".join(sorted(sensors))
    return "all sensors" if len(sensors) == count else f"{len(sensors)} of {count} sensors"
