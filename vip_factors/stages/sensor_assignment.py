"""Sensors that are on one another's segments: reported, and exchanged on request, before anything is estimated.

Neighbours' accelerations tell most of it. But bodies are symmetric: with all left sensors on the right every joint is
as smooth as before, and six sensors have no neighbours. Two things tell these. How joints bend, and from where limbs
are accelerated: the start of headings and mountings is searched for with sides exchanged, or from the other pose, too,
and what it costs is compared. And the picture: the inertial tracker's limbs, with sides exchanged and as placed, are
held against the keypoints.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest

import numpy as np

from vip_factors.associate.hypothesis import CAUCHY, WearerPoints, hypotheses, keypoint_sigma, used_confidence
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import LIMBS, POSES
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.sensor_assignment import (
    LEAST_NATS,
    SECONDS,
    TURN_FRAMES,
    Exchange,
    Pair,
    exchanged,
    exchanged_sensors,
    spread_between,
)
from vip_factors.initialise.sensor_clocks import joint_signal
from vip_factors.initialise.start_search import Start
from vip_factors.sensors.calibration import Placement, SensorSite, site_name
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingSource, SceneSource
from vip_factors.settings import Settings
from vip_factors.stages.calibration_start import brisk_stretch, sensor_links
from vip_factors.stages.inertial import WearerStart, find_start, inertial_tracker
from vip_factors.stages.pauses import interval_between_pauses
from vip_factors.stages.sensor_checks import PreparedRecording
from vip_factors.stages.solver import Solver


def with_sensors_assigned(
    source: SceneSource, settings: Settings, times: Sequence[Array] = ()
) -> tuple[SceneSource, tuple[Finding, ...], tuple[WearerStart | None, ...]]:
    """The source with its sensors in each other's places where that is wanted.

    Args:
        source: of a scene.
        settings: of all rooms.
        times: ``(T,)`` seconds of each wearer's coarse frames; of short recordings starts are looked for there.

    Returns:
        The source, findings, and each wearer's start as the sensors are now, where it was looked for.
    """
    if not settings.assignment.check:
        return source, (), ()
    starts = list[WearerStart | None]()
    placements, findings, exchanges = list[Placement](), list[Finding](), 0
    for wearer, time in zip_longest(source.wearers, times):
        start, end = interval_between_pauses(wearer.head, wearer.interval)
        last_time = min(end, start + SECONDS)
        spare = (end - last_time) / 2
        head = replace(wearer.head, imus=dict(wearer.between(start + spare, end - spare)), pauses=())
        likely_exchanges = exchanges_of(head)
        placement = exchanged(head.placement, head.placed, likely_exchanges)
        beginning = replace(head, imus=dict(wearer.between(start, last_time))) if spare else head
        filmed = settings.fusion.use_camera and source.head.camera is not None
        camera = source.between(start, last_time).camera if filmed else None
        beginning = replace(beginning, placement=placement)
        is_whole = not spare and not wearer.head.pauses
        pose, sides, begun = against_declared(beginning, camera, settings, time if is_whole else None)
        starts.append(None if sides is not None or (likely_exchanges and not settings.assign) else begun)
        if pose is not None:
            findings.append(pose)
        if sides is not None:
            likely_exchanges = (*likely_exchanges, sides)
        findings += [exchange_finding(head, exchange, settings.assign) for exchange in likely_exchanges]
        findings += _on_one_bone(head)
        placements.append(exchanged(head.placement, head.placed, likely_exchanges))
        exchanges += len(likely_exchanges)
    if exchanges and settings.assign:
        source = ReplacedSource(source, tuple(placements))
    return source, tuple(findings), tuple(starts)


def exchanges_of(recording: Recording, least: float = LEAST_NATS) -> tuple[Exchange, ...]:
    """Exchanges of placed sensors, by their numbers, that explain a recording better, by ``least`` nats."""
    if len(recording.placed) < 2:
        return ()
    links = [
        (link.parent, link.child) for link in sensor_links(recording, recording.placed) if link.p_parent is not None
    ]
    signals = [joint_signal(recording.imus[name]) for name in recording.placed]
    return exchanged_sensors(signals, links, least)


def _on_one_bone(recording: Recording) -> Iterator[Finding]:
    """Sensors of thigh and shank that move as if they were on one bone."""
    step, least_rate = 0.05, 0.5  # s; rad/s: what hardly turns tells nothing
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
        time = np.arange(max(stream.time[0] for stream in streams), min(stream.time[-1] for stream in streams), step)
        frames = resample_streams(streams, time)
        R = frames.R_inertial_sensor[frames.orientation_valid.all(axis=1)]
        if len(R) < LEAST_SAMPLES + TURN_FRAMES:
            continue
        spread, rate = spread_between(R[:, 0], R[:, 1], step)
        if spread < least_bend and rate > least_rate:
            pair = f"{_named(above, recording)} and {_named(below, recording)}"
            yield Finding(
                "two on one bone",
                recording.subject.name,
                subject=below.sensor,
                numbers={"spread": float(np.rad2deg(spread))},
                words={"pair": pair},
            )


def exchange_finding(
    recording: Recording, exchange: Exchange, done: bool, advice: str = "--assign takes them for one another"
) -> Finding:
    """Two sensors in each other's places; whether they are exchanged, and what to do if not."""

    def pair(numbers: tuple[int, int]) -> str:
        first_site, second_site = (recording.placement.site(recording.placed[number]) for number in numbers)
        return f"{_named(first_site, recording)} and {_named(second_site, recording)}"

    words = {
        "pair": pair(exchange.sensors),
        "rivals": "".join(f", or {pair(rival)}" for rival in exchange.rivals),
        "done": "the first two are taken for one another" if done else advice,
    }
    words["pair"] += "".join(f", {pair(sensors)}" for sensors in exchange.others)
    words["evidence"] = exchange.evidence or "bones that share a joint are accelerated alike there"
    numbers = {"nats": exchange.nats}
    subject = recording.placed[exchange.sensors[0]]
    kind = "sensors put right" if done and not exchange.rivals else "sensors exchanged"
    return Finding(kind, recording.subject.name, subject=subject, numbers=numbers, words=words)


def _named(site: SensorSite, recording: Recording) -> str:
    where = (site_name(site, recording.subject.body()) or site.bone).replace("_", " ")
    return f"'{site.sensor}' ({where})"


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
        """Recordings with their other placements."""
        return tuple(map(PreparedRecording, self.source.wearers, self.placements))

    @property
    def video_start(self) -> float:
        """Seconds of the first video frame; infinite without one."""
        return self.source.video_start

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """Return the scene between two instants."""
        return self._placed(self.source.between(start, end))

    def detected(self, start: float, end: float, camera: str) -> int:
        """Count a camera's detections between two instants."""
        return self.source.detected(start, end, camera)

    def _placed(self, scene: Scene) -> Scene:
        wearers = zip(scene.wearers, self.placements, strict=True)
        return replace(scene, wearers=tuple(replace(wearer, placement=placement) for wearer, placement in wearers))


SHOWN = {"legs": ("knee", "ankle", "heel", "toe"), "arms": ("elbow", "wrist")}  # keypoints that their sensors move
LIKELIER = "the body bends and moves as people do"  # what speaks for an exchange, beside what is seen
LEAST_FRAMES = 15  # of the recording, and of the video
# Median misfit of the limbs' keypoints with sides exchanged, of what it is as placed, and share of the frames in which
# it is less: of six sound scenes none is below 1.3 or above 0.3, so that exchanged ones are below 0.77 and above 0.7.
BETTER, SHARE = 0.8, 0.7
TELLING = np.log(1.3)  # ratio of misfits


@dataclass(frozen=True)
class _Sides:
    """Left and right sensors that may be exchanged together.

    Attributes:
        limbs: that they are on, as :data:`SHOWN` names them.
        pairs: their numbers.
        recording: with them exchanged.
        start: the likeliest one of that.
        gain: nats by which it is likelier than the one as placed.
    """

    limbs: str
    pairs: tuple[Pair, ...]
    recording: Recording
    start: Start
    gain: float


def against_declared(
    recording: Recording, camera: Camera | None, settings: Settings, time: Array | None = None
) -> tuple[Finding | None, Exchange | None, WearerStart | None]:
    """Another pose that the recording starts from; and limbs whose left and right sensors are in each other's places.

    Nothing is looked at where a sensor has no orientation.

    Args:
        recording: from its start on, with a declared pose if there is one.
        camera: that films the wearer, if one does.
        settings: of all rooms.
        time: ``(T,)`` seconds of the frames that are looked at.

    Returns:
        The other pose, the exchange, and the start with neither, where it was looked for.
    """
    if any(stream.R_inertial_sensor is None for stream in recording.imus.values()):
        return None, None, None
    pairs, time = dict(_pairs(recording)), _times(recording, settings) if time is None else time
    if not pairs or len(time) < LEAST_FRAMES:
        return None, None, None
    frames = resample_streams([recording.imus[name] for name in recording.placed], time)
    looked = frames, brisk_stretch(recording, frames)
    calibration, starts = find_start(recording, frames, settings, lambda done: None, looked[1])
    if starts is None:
        return None, None, None
    begun, as_declared = WearerStart(time, calibration, starts), starts.best
    least = LEAST_NATS
    likeliest = [
        _likeliest(recording, limbs, limb_pairs, looked, as_declared, settings) for limbs, limb_pairs in pairs.items()
    ]
    together = sum(sides.gain for sides in likeliest)
    exchanged_sides = [sides for sides in likeliest if sides.gain >= least] or (likeliest if together >= least else [])
    nats = sum(sides.gain for sides in exchanged_sides)
    if "arms" in pairs and recording.initial_pose in POSES:
        other_pose = next(pose for pose in POSES if pose != recording.initial_pose)
        gain = as_declared.cost - _start(replace(recording, initial_pose=other_pose), looked, settings).cost
        if gain >= max(least, nats):  # arms that hang where they were to be held out, or the other way round
            words = {"declared": recording.initial_pose, "better": other_pose}
            return Finding("other pose", recording.subject.name, numbers={"nats": gain}, words=words), None, begun
    if exchanged_sides:
        return None, _exchange(exchanged_sides, LIKELIER, nats), begun
    doubtful = [sides for sides in likeliest if sides.gain > -least]
    if camera is None or not doubtful:
        return None, None, begun
    detections = _sampled(camera.timed_detections, time)
    return None, _seen_exchange(recording, as_declared, doubtful, detections, camera, settings), begun


def _likeliest(
    recording: Recording,
    limbs: str,
    pairs: Sequence[Pair],
    looked: tuple[ImuFrames, ImuFrames],
    as_placed: Start,
    settings: Settings,
) -> _Sides:
    """All pairs of a limb exchanged, or one of them where no accelerations of neighbours tell that."""
    choices = [tuple(pairs)]
    if len(pairs) > 1 and all(recording.imus[name].specific_force is None for name in recording.placed):
        choices += [(pair,) for pair in pairs]
    candidates = []
    for exchanged_pairs in choices:
        exchanges = [Exchange(pair, 0.0) for pair in exchanged_pairs]
        placement = exchanged(recording.placement, recording.placed, exchanges)
        candidate = replace(recording, placement=placement)
        start = _start(candidate, looked, settings)
        candidates.append(_Sides(limbs, exchanged_pairs, candidate, start, as_placed.cost - start.cost))
    return max(candidates, key=lambda sides: sides.gain)


def _exchange(exchanged_sides: Sequence[_Sides], evidence: str, nats: float = 0.0) -> Exchange:
    main_pair, *further_pairs = (pair for sides in exchanged_sides for pair in sides.pairs)
    return Exchange(main_pair, nats, (), tuple(further_pairs), evidence)


def _pairs(recording: Recording) -> Iterator[tuple[str, list[Pair]]]:
    """By limbs, numbers of the sensors of left and right bones."""
    number_of_bone = {recording.placement.site(name).bone: number for number, name in enumerate(recording.placed)}
    for limbs, bones in LIMBS.items():
        limb_pairs = [
            (number_of_bone[f"left_{bone}"], number_of_bone[f"right_{bone}"])
            for bone in bones
            if {f"left_{bone}", f"right_{bone}"} <= set(number_of_bone)
        ]
        # Without a pose the search takes seconds
        if len(limb_pairs) == 1 or (limb_pairs and recording.initial_pose != "none"):
            yield limbs, limb_pairs


def _times(recording: Recording, settings: Settings) -> Array:
    start, end = recording.interval
    seconds = min(end - start, SECONDS)
    return start + np.arange(int(seconds * settings.calibration_rate)) / settings.calibration_rate


def _start(recording: Recording, looked: tuple[ImuFrames, ImuFrames], settings: Settings) -> Start:
    """The likeliest start, by all frames and a brisk stretch of them; of infinite cost where none is searched for."""
    frames, stretch = looked
    calibration, starts = find_start(recording, frames, settings, lambda done: None, stretch)
    return Start("", calibration, np.inf) if starts is None else starts.best


def _seen_exchange(
    recording: Recording,
    as_placed: Start,
    doubtful: Sequence[_Sides],
    detections: Detections,
    camera: Camera,
    settings: Settings,
) -> Exchange | None:
    """The limbs that lie much better on the keypoints with their sides exchanged."""
    if len(detections.time) < LEAST_FRAMES:
        return None
    streams = [replace(recording.imus[name], specific_force=None) for name in recording.placed]
    frames = resample_streams(streams, detections.time)
    misfits_as_placed = _misfits(recording, as_placed, frames, detections, camera, settings)
    exchanged_sides, ratios = [], []
    for sides in doubtful:
        misfit, exchanged_misfit = (
            misfits_as_placed[sides.limbs],
            _misfits(sides.recording, sides.start, frames, detections, camera, settings)[sides.limbs],
        )
        # Of several people the one whom either fits best
        order = np.lexsort((np.minimum(misfit, exchanged_misfit), detections.frame))
        rows = order[np.r_[True, np.diff(detections.frame[order]) > 0]]
        misfit, exchanged_misfit = misfit[rows], exchanged_misfit[rows]
        telling = np.abs(np.log(exchanged_misfit / misfit)) > TELLING  # who stands still looks the same
        if telling.sum() < LEAST_FRAMES:
            continue
        ratio = float(np.median(exchanged_misfit) / np.median(misfit))
        if ratio < BETTER and np.mean(exchanged_misfit[telling] < misfit[telling]) > SHARE:
            exchanged_sides.append(sides)
            ratios.append(100 * ratio)
    missed = " and ".join(f"{ratio:.0f} %" for ratio in ratios)
    return (
        _exchange(exchanged_sides, f"they miss the picture by {missed} of what they miss it by as placed")
        if exchanged_sides
        else None
    )


def _sampled(detections: Detections, time: Array) -> Detections:
    """The detections of some video frames within the time looked at, and of these frames alone."""
    sample = 150  # video frames looked at: the inertial tracker is run at these instants alone
    frame_time = detections.time[detections.frame]
    frames = np.unique(detections.frame[(frame_time > time[0]) & (frame_time < time[-1])])
    if len(frames) > sample:
        frames = frames[np.linspace(0, len(frames) - 1, sample).astype(int)]
    chosen = detections.select(np.isin(detections.frame, frames))
    return replace(chosen, time=chosen.time[frames], frame=np.searchsorted(frames, chosen.frame))


def _misfits(
    recording: Recording, start: Start, frames: ImuFrames, detections: Detections, camera: Camera, settings: Settings
) -> Mapping[str, Array]:
    """By limbs, how far ``(N,)`` their keypoints lie off the inertial tracker's, in squared sigmas, robustly.

    ``frames`` are those of the video.
    """
    refused = 20.0  # squared sigmas, of a detection that no camera explains
    settled = 0.03  # relative decrease of the tracker's cost from which on misfits stay what they are, to 2 %
    solver = Solver(replace(settings.solve, relative_decrease=settled), lambda stage, done: None, name=settings.solver)
    unposed = replace(recording, initial_pose="none")  # it was held at other instants
    tracked = inertial_tracker(unposed, frames, settings, solver, start.calibration)
    skeleton, R = tracked.model.skeleton, tracked.state.R_parent_child
    body = forward_kinematics(skeleton, R, np.zeros((len(R), 3)))
    landmarks = [
        (k, landmark) for k, landmark in enumerate(detections.keypoints.on_body(skeleton)) if landmark is not None
    ]
    p_world_keypoint = np.full((len(R), len(detections.keypoints), 3), np.nan)
    p_world_keypoint[:, [k for k, _ in landmarks]] = body.points(
        np.array([landmark.bone for _, landmark in landmarks]),
        np.stack([landmark.p_bone_point for _, landmark in landmarks]),
    )
    points = WearerPoints(p_world_keypoint, body.p_world_joint[:, 0], R[:, 0], np.ones(len(R), bool))
    fitted = hypotheses(detections, camera.model.normalise(detections.pixels), [points])
    sigma, weight = keypoint_sigma(detections.keypoints), used_confidence(detections)[fitted.detection]
    square = np.sum(fitted.error**2, axis=-1) / sigma**2
    misfits = {}
    for limbs, names in SHOWN.items():
        is_shown = np.array([any(name in keypoint for name in names) for keypoint in detections.keypoints.keypoints])
        is_used = is_shown & np.isfinite(square)
        off = np.sum(np.where(is_used, weight * np.log1p(np.where(is_used, square, 0.0) / CAUCHY**2), 0.0), axis=1)
        misfit = np.full(len(detections), refused)
        total_weight = np.where(is_used, weight, 0.0).sum(axis=1)
        misfit[fitted.detection[total_weight > 0]] = off[total_weight > 0] / total_weight[total_weight > 0]
        misfits[limbs] = misfit
    return misfits
