"""Sensors that are on one another's segments: told, and exchanged if that is wanted, before anything is estimated."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.body.pose_prior import load_joint_limits, load_pose_prior
from vip_factors.findings import Finding
from vip_factors.initialise.sensor_assignment import (
    LEAST_NATS,
    SECONDS,
    TURN_FRAMES,
    Exchange,
    exchanged,
    exchanged_sensors,
    spread_between,
)
from vip_factors.initialise.sensor_faults import joint_signal
from vip_factors.initialise.sensor_tree import Link, sensor_tree
from vip_factors.initialise.start_candidates import BONE_SIGMA
from vip_factors.sensors.calibration import Placement, SensorSite, site_name
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingSource, SceneSource
from vip_factors.settings import Settings
from vip_factors.stages.declared_checks import LIKELIER, against_declared


def with_sensors_assigned(source: SceneSource, settings: Settings) -> tuple[SceneSource, tuple[Finding, ...]]:
    """The source with its sensors in each other's places where that is wanted, and what was found."""
    if not settings.assignment.check:
        return source, ()
    placements, findings, exchanges = list[Placement](), list[Finding](), 0
    for one in source.wearers:
        start, end = one.interval
        until = min(end, start + SECONDS)
        spare = (end - until) / 2
        head = replace(one.head, imus=dict(one.between(start + spare, end - spare)))
        found = exchanges_of(head, settings)
        placement = exchanged(head.placement, head.placed, found)
        beginning = replace(head, imus=dict(one.between(start, until))) if spare else head
        filmed = settings.fusion.use_camera and source.head.camera is not None
        camera = source.between(start, until).camera if filmed else None
        pose, sides = against_declared(replace(beginning, placement=placement), camera, settings)
        if pose is not None:
            findings.append(pose)
        if sides is not None:
            found = (*found, sides)
        findings += [exchange_finding(head, exchange, settings.assign) for exchange in found]
        findings += _on_one_bone(head)
        placements.append(exchanged(head.placement, head.placed, found))
        exchanges += len(found)
    if exchanges and settings.assign:
        source = ReplacedSource(source, tuple(placements))
    return source, tuple(findings)


def exchanges_of(recording: Recording, settings: Settings, least: float = LEAST_NATS) -> tuple[Exchange, ...]:
    """Exchanges of placed sensors, by their numbers, that explain a recording better, by ``least`` nats."""
    if len(recording.placed) < 2:
        return ()
    links = [(one.parent, one.child) for one in placed_links(recording, settings) if one.p_parent is not None]
    signals = [joint_signal(recording.imus[name]) for name in recording.placed]
    return exchanged_sensors(signals, links, least)


STEP, LEAST_RATE = 0.05, 0.5  # s; rad/s: what hardly turns tells nothing


def _on_one_bone(recording: Recording) -> Iterator[Finding]:
    """Sensors of thigh and shank that move as if they were on one bone."""
    # RMS by which sensors of thigh and shank turn against each other: 9.7° or more in 58 recordings and scenes; two
    # on one bone have what soft tissue leaves, two to four. Elbows are not looked at: one of those recordings holds
    # one stiff.
    least_bend = np.deg2rad(5.0)
    sites = [recording.placement.site(name) for name in recording.placed]
    sensors = {site.bone: site for site in sites if recording.imus[site.sensor].R_inertial_sensor is not None}
    for side in ("left", "right"):
        above, below = sensors.get(f"{side}_hip"), sensors.get(f"{side}_knee")
        if above is None or below is None:
            continue
        streams = [recording.imus[site.sensor] for site in (above, below)]
        time = np.arange(max(one.time[0] for one in streams), min(one.time[-1] for one in streams), STEP)
        frames = resample_streams(streams, time)
        R = frames.R_inertial_sensor[frames.orientation_valid.all(axis=1)]
        if len(R) < LEAST_SAMPLES + TURN_FRAMES:
            continue
        spread, rate = spread_between(R[:, 0], R[:, 1], STEP)
        if spread < least_bend and rate > LEAST_RATE:
            pair = f"{_named(above, recording)} and {_named(below, recording)}"
            yield Finding(
                "two on one bone", recording.subject.name, subject=below.sensor,
                numbers={"spread": float(np.rad2deg(spread))}, words={"pair": pair},
            )  # fmt: skip


def placed_links(recording: Recording, settings: Settings) -> tuple[Link, ...]:
    """The tree of a recording's placed sensors, by their numbers."""
    sites = [recording.placement.site(name) for name in recording.placed]
    return sensor_tree(
        [site.bone_index for site in sites], np.stack([site.p_bone_sensor for site in sites]),
        recording.subject.body(), load_pose_prior(), load_joint_limits(),
        BONE_SIGMA,
    )  # fmt: skip


def exchange_finding(
    recording: Recording, exchange: Exchange, done: bool, advice: str = "--assign takes them for one another"
) -> Finding:
    """Two sensors in each other's places; whether they are exchanged, and what to do if not."""

    def pair(numbers: tuple[int, int]) -> str:
        one, other = (recording.placement.site(recording.placed[number]) for number in numbers)
        return f"{_named(one, recording)} and {_named(other, recording)}"

    words = {
        "pair": pair(exchange.sensors),
        "rivals": "".join(f", or {pair(one)}" for one in exchange.rivals),
        "done": "the first two are taken for one another" if done else advice,
    }
    words["pair"] += "".join(f", {pair(one)}" for one in exchange.others)
    words["evidence"] = exchange.evidence or LIKELIER
    numbers = {"nats": exchange.nats}
    subject = recording.placed[exchange.sensors[0]]
    kind = "sides exchanged" if exchange.evidence else "sensors exchanged"
    kind = "sensors put right" if done and not exchange.rivals else kind
    return Finding(kind, recording.subject.name, subject=subject, numbers=numbers, words=words)


def _named(site: SensorSite, recording: Recording) -> str:
    where = (site_name(site, recording.subject.body()) or site.bone).replace("_", " ")
    return f"'{site.sensor}' ({where})"


@dataclass(frozen=True)
class ReplacedRecording:
    """A recording with another placement; see :class:`~vip_factors.sensors.sources.RecordingSource`."""

    source: RecordingSource
    placement: Placement

    @cached_property
    def head(self) -> Recording:
        """The recording without what was measured."""
        return replace(self.source.head, placement=self.placement)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        own = self.source.sensors
        return tuple(site.sensor for site in self.placement.sites if site.sensor in own)

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of their first and last sample."""
        return self.source.interval

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """What was measured from one instant to another."""
        return self.source.between(start, end)


@dataclass(frozen=True)
class ReplacedSource:
    """A scene whose wearers have other placements; see :class:`~vip_factors.sensors.sources.SceneSource`."""

    source: SceneSource
    placements: tuple[Placement, ...]

    @cached_property
    def head(self) -> Scene:
        """The scene without what was measured."""
        return self._placed(self.source.head)

    @cached_property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """The recordings."""
        return tuple(map(ReplacedRecording, self.source.wearers, self.placements))

    @property
    def video_start(self) -> float:
        """Seconds of the first video frame; infinite without one."""
        return self.source.video_start

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """What was measured from one instant to another."""
        return self._placed(self.source.between(start, end))

    def detected(self, start: float, end: float) -> int:
        """How many people were detected between two instants."""
        return self.source.detected(start, end)

    def _placed(self, scene: Scene) -> Scene:
        wearers = zip(scene.wearers, self.placements, strict=True)
        return replace(scene, wearers=tuple(replace(one, placement=placement) for one, placement in wearers))
