"""Pauses of a recording, and headings that are others after them.

Where sensors say nothing for more than a second they may have been switched off: their filters begin anew, each with a
heading of its own, and a log's clock need not tell how long it was. So every stretch between pauses has its headings
looked for, as a start's are, with the mountings that one stretch tells. Where they explain it much better than those of
before, its samples are turned into the inertial frames of before; what is left of it the fit finds, for over
such a pause its headings may walk (:class:`~vip_factors.factor_settings.HeadingWalkSettings`).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.start_candidates import START_RATE
from vip_factors.sensors.frames import resample
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sources import SceneInMemory, SceneSource, frames_of, streams_between
from vip_factors.settings import Settings
from vip_factors.stages.calibration_start import start_search
from vip_factors.stages.inertial import find_start
from vip_factors.stages.windows import is_long

LEAST_S = 4.0  # of a stretch that tells its headings: some steps; a shorter one has those of before
JUMP = np.deg2rad(20.0)  # a heading found this near is the one of before: mountings and posture leave as much open
SURE = 20.0  # nats by which other headings explain a stretch better: up to 13 where none had jumped


@dataclass(frozen=True)
class Pause:
    """A time without samples, and what headings did over it.

    Attributes:
        start, end: seconds.
        silent: sensors that said nothing.
        jumps: radians by which the headings of these are less after it; empty where they are those of before.
    """

    start: float
    end: float
    silent: frozenset[str]
    jumps: Mapping[str, float]


def pauses_of(streams: Mapping[str, ImuStream]) -> list[Pause]:
    """The pauses between stretches of some seconds, in the order of time; where those of sensors meet, they are one."""
    pause_s = 1.0  # packets lost by radio come back sooner
    gaps = [
        (float(start), float(end), name)
        for name, stream in streams.items()
        for start, end in stream.gaps
        if end - start > pause_s
    ]
    found = list[Pause]()
    for start, end, name in sorted(gaps):
        if found and start - found[-1].end < LEAST_S:
            last = found[-1]
            found[-1] = Pause(last.start, max(last.end, end), last.silent | {name}, {})
        else:
            found.append(Pause(start, end, frozenset({name}), {}))
    begin = min((float(one.time[0]) for one in streams.values()), default=0.0)
    finish = max((float(one.time[-1]) for one in streams.values()), default=0.0)
    return [one for one in found if one.start - begin >= LEAST_S and finish - one.end >= LEAST_S]


def with_restarts(
    source: SceneSource, settings: Settings
) -> tuple[SceneSource, tuple[tuple[Pause, ...], ...], tuple[Finding, ...]]:
    """The source with samples after pauses in the inertial frames of before, the pauses of each wearer, and findings.

    Of recordings that are solved in stretches nothing is looked at.
    """
    none = tuple(() for _ in source.wearers), ()
    if any(is_long(one.interval, settings) for one in source.wearers):
        return source, *none
    scene = source.between()
    pauses = [tuple(headings_after_pauses(one, settings)) for one in scene.wearers]
    if not any(pauses):
        return source, *none
    wearers = tuple(_in_first_frames(one, own) for one, own in zip(scene.wearers, pauses, strict=True))
    findings = tuple(finding for one, own in zip(wearers, pauses, strict=True) for finding in _findings(one, own))
    return SceneInMemory(replace(scene, wearers=wearers)), tuple(pauses), findings


def headings_after_pauses(recording: Recording, settings: Settings) -> list[Pause]:
    """The pauses of a recording's placed sensors, with what their headings did."""
    names = recording.placed
    streams = {name: recording.imus[name] for name in names}
    pauses = pauses_of(streams)
    if len(names) < 2 or not pauses or not settings.calibration.estimate_headings or settings.calibration.from_truth:
        return pauses
    ends = np.r_[-np.inf, [time for one in pauses for time in (one.start, one.end)], np.inf].reshape(-1, 2)
    stretches = [_cut(recording, start, end) for start, end in ends]
    first = 0 if recording.initial_pose != "none" else int(np.argmax([_turned(one) for one in stretches]))
    rate = settings.calibration_rate
    start, _ = find_start(stretches[first], resample(stretches[first], rate, names), settings, lambda fraction: None)
    headings = np.tile(start.headings, (len(stretches), 1))
    for order in (range(first + 1, len(stretches)), range(first - 1, -1, -1)):
        for number in order:
            before = number - 1 if number > first else number + 1
            known = replace(start, headings=headings[before], R_world_bone=None)
            headings[number] = _headings_in(stretches[number], names, known, settings)
    return [_with_jumps(one, names, jumped) for one, jumped in zip(pauses, np.diff(headings, axis=0), strict=True)]


def _cut(recording: Recording, start: float, end: float) -> Recording:
    return replace(recording, imus=streams_between(recording.imus, recording.placed, start, end))


def _turned(stretch: Recording) -> float:
    """How much sensors turn in a stretch, radians in all."""
    return sum(
        float(np.sum(angle_between(one.R_inertial_sensor[:-1], one.R_inertial_sensor[1:])))
        for one in stretch.imus.values()
        if one.R_inertial_sensor is not None
    )


def _headings_in(
    stretch: Recording, names: Sequence[str], before: InitialCalibration, settings: Settings
) -> Array:  # fmt: skip
    """Headings ``(S,)`` that explain a stretch; those ``before`` where those do as well."""
    start, end = stretch.interval
    time = np.arange(start, end, 1 / START_RATE)
    frames = frames_of(stretch.imus, names, time)
    turn = rotation_z(before.headings)
    frames = replace(
        frames, R_inertial_sensor=turn @ frames.R_inertial_sensor,
        specific_force_inertial=np.einsum("sij,tsj->tsi", turn, frames.specific_force_inertial),
    )  # fmt: skip
    search = start_search(stretch, frames, settings, known_mountings=True)
    kept = InitialCalibration(np.zeros(len(names)), np.full(len(names), np.inf), before.R_bone_sensor)
    turned = wrap_angle(search.best(kept, kept.R_bone_sensor).best.calibration.headings)
    jumped = replace(kept, headings=np.where(np.abs(turned) > JUMP, turned, 0.0))
    sure = search.cost(kept) - search.cost(jumped) > SURE
    return before.headings + sure * turned


def _with_jumps(pause: Pause, names: Sequence[str], jumped: Array) -> Pause:
    """The pause with the jumps of its silent sensors, of ``(S,)`` of all: only their differences are known.

    Most sensors that measured on, or of all most sensors, are taken to have kept their headings.
    """
    silent = np.array([name in pause.silent for name in names])
    against = jumped if silent.all() else jumped[~silent]
    moved = np.abs(wrap_angle(jumped - against[:, None])) > JUMP
    jumps = wrap_angle(jumped - against[int(np.argmin(moved.sum(axis=1)))])
    far = {name: float(jump) for name, jump, own in zip(names, jumps, silent, strict=True) if own and abs(jump) > JUMP}
    return replace(pause, jumps=far)


def _turned_by(name: str, pauses: Sequence[Pause]) -> Array:
    """Radians ``(P + 1,)`` by which a sensor's heading is more than at first, in every stretch."""
    return np.cumsum([0.0, *(one.jumps.get(name, 0.0) for one in pauses)])


def _in_first_frames(recording: Recording, pauses: Sequence[Pause]) -> Recording:
    """The recording with samples after pauses turned into the inertial frames of before."""
    imus, ends = dict(recording.imus), [one.end for one in pauses]
    for name in recording.placed:
        stream, more = imus[name], _turned_by(name, pauses)
        if np.any(more) and stream.R_inertial_sensor is not None:
            turn = rotation_z(more[np.searchsorted(ends, stream.time, side="right")])
            imus[name] = replace(stream, R_inertial_sensor=turn @ stream.R_inertial_sensor)
    return replace(recording, imus=imus, restarts=tuple((one.start, one.end) for one in pauses if one.jumps))


def in_own_frames(estimate: Estimate, pauses: Sequence[Sequence[Pause]]) -> Estimate:
    """The estimate with headings of the inertial frames as they were measured; the pauses of each wearer."""
    wearers = tuple(_own_headings(*both) for both in zip(estimate.wearers, pauses, strict=True))
    return replace(estimate, wearers=wearers)


def _own_headings(wearer: WearerEstimate, pauses: Sequence[Pause]) -> WearerEstimate:
    jumped = [one for one in pauses if one.jumps]
    if not jumped:
        return wearer
    edges = np.array([(one.start, one.end) for one in jumped])
    calibration = dict(wearer.calibration)
    for name, one in calibration.items():
        time = np.unique(np.concatenate([edges.ravel(), one.heading_time]))
        more = _turned_by(name, jumped)[np.searchsorted(edges[:, 1], time, side="right")]
        calibration[name] = replace(one, heading_time=time, heading_path=one.heading_at(time) + more)
    return replace(wearer, calibration=calibration)


FEW = 3  # sensors that are told by name


def _findings(recording: Recording, pauses: Sequence[Pause]) -> Iterator[Finding]:
    wearer, count = recording.subject.name, len(recording.placed)
    seconds = {f"{_named(one.silent, count)} at {one.start:.1f} s": one.end - one.start for one in pauses}
    if seconds:
        yield Finding("pauses", wearer, numbers=seconds)
    jumps = {
        f"{_named(one.jumps, count)} at {one.end:.1f} s": float(np.rad2deg(max(map(abs, one.jumps.values()))))
        for one in pauses
        if one.jumps
    }
    if jumps:
        yield Finding("headings after pauses", wearer, numbers=jumps)


def _named(sensors: Collection[str], count: int) -> str:
    if len(sensors) <= FEW:
        return ", ".join(sorted(sensors))
    return "all sensors" if len(sensors) == count else f"{len(sensors)} of {count} sensors"
