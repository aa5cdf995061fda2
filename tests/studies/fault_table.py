"""Faults of whole recordings: functions that put one into a sound scene, and the kinds of findings that tell it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array, exp, rotation_z, transpose
from vip_factors.initialise.sensor_assignment import Exchange, exchanged
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import FORCE_LIMIT, ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

SEED = 7
Faulty = tuple[Scene, tuple[str, ...]]
"""The scene with the fault, and what the sentence that tells it must name."""


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        name: of its row.
        put: it into a scene; given another scene to take from, too. None where the scene has no place for it.
        kinds: of findings that tell what is the matter.
        refusal: what the sentence holds that the recording is rightly refused with.
    """

    name: str
    put: Callable[[Scene, Scene], Faulty | None]
    kinds: tuple[str, ...]
    refusal: str = "nothing but the cause"


def _wearer(scene: Scene, change: Callable[[Recording], Recording]) -> Scene:
    return replace(scene, wearers=(change(scene.wearers[0]), *scene.wearers[1:]))


def _exchanged(one: str, other: str) -> Callable[[Scene, Scene], Faulty | None]:
    def put(scene: Scene, _: Scene) -> Faulty | None:
        recording = scene.wearers[0]
        numbers = {recording.placement.site(name).bone: n for n, name in enumerate(recording.placed)}
        if one not in numbers or other not in numbers:
            return None
        pair = Exchange((numbers[one], numbers[other]), 0.0)
        placement: Placement = exchanged(recording.placement, recording.placed, [pair])
        return _wearer(scene, lambda own: replace(own, placement=placement)), tuple(
            recording.placed[number] for number in pair.sensors
        )

    return put


def _sides_for_each_other(scene: Scene, _: Scene) -> Faulty | None:
    """Whoever put the sensors on took the wearer's left for his right."""
    own = scene.wearers[0]
    numbers = {own.placement.site(name).bone: n for n, name in enumerate(own.placed)}
    pairs = [(numbers[bone], numbers[f"right{bone[4:]}"]) for bone in numbers
             if bone.startswith("left") and f"right{bone[4:]}" in numbers]  # fmt: skip
    if not pairs:
        return None
    placement = exchanged(own.placement, own.placed, [Exchange(pair, 0.0) for pair in pairs])
    return _wearer(scene, lambda one: replace(one, placement=placement)), ()


def _stream(
    change: Callable[[ImuStream], ImuStream], bone: str = "left_knee"
) -> Callable[[Scene, Scene], Faulty | None]:
    """One sensor's samples changed."""

    def put(scene: Scene, _: Scene) -> Faulty | None:
        own = scene.wearers[0]
        names = [name for name in own.placed if own.placement.site(name).bone == bone]
        if not names:
            return None
        imus = dict(own.imus) | {names[0]: change(own.imus[names[0]])}
        return _wearer(scene, lambda one: replace(one, imus=imus)), (names[0],)

    return put


def _streams(change: Callable[[ImuStream], ImuStream]) -> Callable[[Scene, Scene], Faulty | None]:
    """All sensors' samples changed."""

    def put(scene: Scene, _: Scene) -> Faulty | None:
        imus = {name: change(one) for name, one in scene.wearers[0].imus.items()}
        return _wearer(scene, lambda own: replace(own, imus=imus)), ()

    return put


def _in_axes(R: Array, vectors: Array | None) -> Array | None:
    return None if vectors is None else np.clip(np.einsum("nji,nj->ni", R, vectors), -FORCE_LIMIT, FORCE_LIMIT)


def _turned(by: Array, late: bool = False) -> Callable[[ImuStream], ImuStream]:
    """The sensor turned on its bone by a rotation vector; from the middle on."""

    def change(stream: ImuStream) -> ImuStream:
        after = stream.time > (np.mean(stream.time[[0, -1]]) if late else -np.inf)
        R = exp(by * after[:, None])
        return replace(
            stream,
            R_inertial_sensor=None if stream.R_inertial_sensor is None else stream.R_inertial_sensor @ R,
            specific_force=_in_axes(R, stream.specific_force),
            angular_rate=_in_axes(R, stream.angular_rate),
        )

    return change


def _heading_jumps(stream: ImuStream) -> ImuStream:
    assert stream.R_inertial_sensor is not None
    by = rotation_z(np.deg2rad(50.0) * (stream.time > np.mean(stream.time[[0, -1]])))
    return replace(stream, R_inertial_sensor=by @ stream.R_inertial_sensor)


def _heading_off_in_pose(stream: ImuStream) -> ImuStream:
    """Metal close by while the pose was held."""
    if stream.R_inertial_sensor is None:
        return stream
    by = rotation_z(np.deg2rad(60.0) * (stream.time < stream.time[0] + 2.0))
    return replace(stream, R_inertial_sensor=by @ stream.R_inertial_sensor)


def _heading_drifts(stream: ImuStream) -> ImuStream:
    if stream.R_inertial_sensor is None:
        return stream
    by = rotation_z(np.deg2rad(60.0) * (stream.time - stream.time[0]) / (stream.time[-1] - stream.time[0]))
    return replace(stream, R_inertial_sensor=by @ stream.R_inertial_sensor)


def _with_force(factor: Array) -> Callable[[ImuStream], ImuStream]:
    def change(stream: ImuStream) -> ImuStream:
        return (
            stream if stream.specific_force is None else replace(stream, specific_force=stream.specific_force * factor)
        )

    return change


def _without_gravity(stream: ImuStream) -> ImuStream:
    if stream.specific_force is None or stream.R_inertial_sensor is None:
        return stream
    return replace(stream, specific_force=stream.specific_force - 9.81 * stream.R_inertial_sensor[:, 2])


def _rows(stream: ImuStream, rows: np.ndarray, time: Array) -> ImuStream:
    values = {name: own[rows] for name, own in vars(stream).items() if isinstance(own, np.ndarray)}
    return replace(stream, **(values | {"time": time}))


def _stuck(stream: ImuStream) -> ImuStream:
    rows = np.minimum(np.arange(len(stream)), len(stream) // 3)
    return _rows(stream, rows, stream.time)


def _samples_lost(stream: ImuStream) -> ImuStream:
    kept = np.flatnonzero(np.random.default_rng(SEED).random(len(stream)) > 0.2)
    return _rows(stream, kept, stream.time[kept])


def _second_dropped(stream: ImuStream) -> ImuStream:
    """From the middle on the log's clock has gone on as if nothing had been lost."""
    middle, lost = len(stream) // 2, round(stream.rate)
    kept = np.r_[0:middle, middle + lost : len(stream)]
    return _rows(stream, kept, stream.time[: len(kept)])


def _without_start(scene: Scene, _: Scene) -> Faulty | None:
    own = scene.wearers[0]
    start, end = own.interval
    if own.initial_pose == "none" or end - start < 8:
        return None
    imus = {name: one.cut(start + 0.4 * (end - start), end) for name, one in own.imus.items()}
    return _wearer(scene, lambda one: replace(one, imus=imus)), ()


def _other_pose(scene: Scene, _: Scene) -> Faulty | None:
    pose = {"n-pose": "t-pose", "t-pose": "n-pose"}.get(scene.wearers[0].initial_pose)
    return None if pose is None else (_wearer(scene, lambda own: replace(own, initial_pose=pose)), ())


def _one_bone(scene: Scene, _: Scene) -> Faulty | None:
    """The shank's sensor sits on the thigh: another instrument there, turned otherwise, on tissue that moves."""
    own = scene.wearers[0]
    at = {own.placement.site(name).bone: name for name in own.placed}
    if not {"left_hip", "left_knee"} <= set(at):
        return None
    thigh, shank = own.imus[at["left_hip"]], at["left_knee"]
    random = np.random.default_rng(SEED)
    slow = np.cumsum(random.normal(size=(len(thigh), 3)), axis=0)
    sway = np.deg2rad(2.0) * slow / np.abs(slow).max()
    moved = replace(_turned(np.array([0.4, 1.1, 0.3]))(thigh), name=shank)
    if moved.R_inertial_sensor is not None:
        moved = replace(
            moved, R_inertial_sensor=rotation_z(np.full(len(thigh), 1.0)) @ moved.R_inertial_sensor @ exp(sway)
        )
    if moved.specific_force is not None:
        moved = replace(moved, specific_force=moved.specific_force + random.normal(0, 0.1, (len(thigh), 3)))
    return _wearer(scene, lambda one: replace(one, imus=dict(one.imus) | {shank: moved})), (shank,)


def _stature(by: float) -> Callable[[Scene, Scene], Faulty | None]:
    def put(scene: Scene, _: Scene) -> Faulty | None:
        own = scene.wearers[0]
        if own.subject.stature_m is None:
            return None
        ratio = 1 + by / own.subject.stature_m
        sites = tuple(replace(site, p_bone_sensor=ratio * site.p_bone_sensor) for site in own.placement.sites)
        subject = replace(own.subject, stature_m=own.subject.stature_m + by)
        placement = replace(own.placement, sites=sites)
        return _wearer(scene, lambda one: replace(one, subject=subject, placement=placement)), ()

    return put


def _video(change: Callable[[Detections, Scene, Scene], Detections]) -> Callable[[Scene, Scene], Faulty | None]:
    def put(scene: Scene, other: Scene) -> Faulty | None:
        if scene.camera is None or other.camera is None:
            return None
        camera = replace(scene.camera, detections=change(scene.camera.detections, scene, other), truth=None)
        return replace(scene, cameras=(camera,)), ()

    return put


def _width(scene: Scene) -> float:
    assert scene.camera is not None
    return float(scene.camera.model.width)


def _mirrored(seen: Detections, scene: Scene, _: Scene) -> Detections:
    """What a detector says of a mirrored film: who raises the left hand raises the right one there."""
    order = seen.keypoints.mirrored
    pixels = seen.pixels[:, order] * [-1.0, 1.0] + [_width(scene) - 1, 0.0]
    return replace(seen, pixels=pixels, confidence=seen.confidence[:, order])


def _sides_exchanged(seen: Detections, _: Scene, __: Scene) -> Detections:
    order = seen.keypoints.mirrored
    return replace(seen, pixels=seen.pixels[:, order], confidence=seen.confidence[:, order])


def _foreign(seen: Detections, _: Scene, other: Scene) -> Detections:
    assert other.camera is not None
    found = other.camera.detections
    return replace(found, time=found.time - found.time[0] + seen.time[0])


def _foreign_later(seen: Detections, scene: Scene, other: Scene) -> Detections:
    """From the middle on somebody else is seen."""
    found, half = _foreign(seen, scene, other), len(seen.time) // 2
    if len(found.time) < half or len(found.keypoints) != len(seen.keypoints):
        return seen
    first, then = seen.frame < half, (found.frame >= half) & (found.frame < len(seen.time))
    return Detections(
        seen.keypoints, seen.time, np.concatenate([seen.frame[first], found.frame[then]]),
        np.concatenate([seen.pixels[first], found.pixels[then]]),
        np.concatenate([seen.confidence[first], found.confidence[then]]),
    )  # fmt: skip


def _half_rate(seen: Detections, _: Scene, __: Scene) -> Detections:
    return replace(seen, time=2 * seen.time - seen.time[0])


def _zoom(scene: Scene, _: Scene) -> Faulty | None:
    if scene.camera is None:
        return None
    fx, fy = scene.camera.model.focal
    model = replace(scene.camera.model, focal=(1.3 * fx, 1.3 * fy))
    return replace(scene, cameras=(replace(scene.camera, model=model, truth=None),)), ()


UNLIKE_POSE = ("placement contradicted", "not settled")
EXCHANGED = ("sensors exchanged",)
NOT_OF_IT = ("video mismatch", "scatter", "leap", "video unused")
FAULTS = (
    Fault("thighs exchanged", _exchanged("left_hip", "right_hip"), EXCHANGED),
    Fault("shanks exchanged", _exchanged("left_knee", "right_knee"), EXCHANGED),
    Fault("feet exchanged", _exchanged("left_ankle", "right_ankle"), EXCHANGED),
    Fault("forearms exchanged", _exchanged("left_elbow", "right_elbow"), EXCHANGED),
    Fault("upper arms exchanged", _exchanged("left_shoulder", "right_shoulder"), EXCHANGED),
    Fault("thigh and shank exchanged", _exchanged("left_hip", "left_knee"), ("sensors exchanged",)),
    Fault("shank and foot exchanged", _exchanged("right_knee", "right_ankle"), ("sensors exchanged",)),
    Fault("left side for right", _sides_for_each_other, EXCHANGED),
    Fault("two on one bone", _one_bone, ("two on one bone", "sensors exchanged")),
    Fault("upside down", _stream(_turned(np.array([0, 0, np.pi]))), UNLIKE_POSE),
    Fault("turned midway by 50°", _stream(_turned(np.array([0, 0.87, 0]), late=True)), ("sensor turned",)),
    Fault("heading jumps by 50°", _stream(_heading_jumps), ("sensor turned", "heading drift")),
    Fault("heading off in the pose", _stream(_heading_off_in_pose), ("impossible posture", "sensor turned")),
    Fault("heading drifts by 60°", _stream(_heading_drifts, "left_hip"), ("heading drift", "sensor turned")),
    Fault("axis reversed", _stream(_with_force(np.array([1, 1, -1]))),
          ("accelerometer axis", "accelerometer corrected")),
    Fault("g for m/s²", _streams(_with_force(np.array(1 / 9.81))), ("accelerometer corrected",)),
    Fault("gravity left out", _streams(_without_gravity), ("accelerometer corrected",), "gravity"),
    Fault("orientations inverted", _streams(lambda one: one if one.R_inertial_sensor is None else
          replace(one, R_inertial_sensor=transpose(one.R_inertial_sensor))), (*UNLIKE_POSE, "accelerometer corrected"),
          "inverted"),
    Fault("stuck", _stream(_stuck), ("sensor stuck",)),
    Fault("a fifth lost", _stream(_samples_lost), ()),
    Fault("a second dropped", _stream(_second_dropped),
          ("clock jumped", "clock corrected", "clocks disagree")),
    Fault("clock 40 ms late", _stream(lambda one: replace(one, time=one.time + 0.04)),
          ("clock corrected", "clocks disagree")),
    Fault("stature +15 cm", _stature(0.15), ("body size",)),
    Fault("stature -15 cm", _stature(-0.15), ("body size",)),
    Fault("other pose declared", _other_pose, (*UNLIKE_POSE, "other pose", "unusual posture")),
    Fault("pose not held", _without_start, UNLIKE_POSE),
    Fault("video mirrored", _video(_mirrored), ("keypoint order", "video mismatch")),
    Fault("keypoints' sides exchanged", _video(_sides_exchanged), ("keypoint order",)),
    Fault("video of another", _video(_foreign), NOT_OF_IT),
    Fault("another from midway", _video(_foreign_later), (*NOT_OF_IT, "hardly seen")),
    Fault("video rate halved", _video(_half_rate),
          (*NOT_OF_IT, "video clock")),
    Fault("video 0.5 s late", _video(lambda seen, _, __: seen.shifted(0.5)), ("video clock", *NOT_OF_IT)),
    Fault("focal length 1.3 times", _zoom, ("body size", "scatter")),
    Fault("half the resolution", _video(lambda seen, _, __: replace(seen, pixels=seen.pixels / 2)), ("image size",)),
)  # fmt: skip
