"""The data of a report: an estimate, and the recording and its truth where they are given."""

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property

import numpy as np

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import TRUTH_COLOUR, side_of
from vip_factors.body.skeleton import PARENTS, Skeleton
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.viz.colours import hexadecimal, side_colours, wearer_mark
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer, check_frames, drawn_scene, floor_height


@dataclass(frozen=True)
class ReportWearer:
    """One of the wearers, with the recording if it is there."""

    index: int
    name: str
    estimate: WearerEstimate
    recording: Recording | None


@dataclass(frozen=True)
class ReportData:
    """The estimate of a scene, and the scene if there is one.

    Attributes:
        estimate: of one wearer or several.
        scene: what was measured, with the truth if it is known; None if there is the estimate alone.
    """

    estimate: Estimate
    scene: Scene | None = None

    @cached_property
    def wearers(self) -> tuple[ReportWearer, ...]:
        """The wearers, in the scene's order."""
        recordings = self.scene.wearers if self.scene is not None else (None,) * len(self.estimate.wearers)
        return tuple(
            ReportWearer(
                index,
                recording.subject.name if recording is not None else estimate.motion.name or f"wearer {index + 1}",
                estimate,
                recording,
            )
            for index, (estimate, recording) in enumerate(zip(self.estimate.wearers, recordings, strict=True))
        )

    @property
    def names(self) -> list[str]:
        """Names of the wearers."""
        return [wearer.name for wearer in self.wearers]

    @property
    def date(self) -> str:
        """The local day of the recording's start, or of this report if the recording's clock tells none; which of both
        comes first.
        """
        start_ns = 0 if self.scene is None else self.scene.start_ns
        day = datetime.fromtimestamp(start_ns / 1e9) if start_ns else datetime.now()
        return f"{'recorded' if start_ns else 'reported'} {day:%d %B %Y}".replace(" 0", " ")

    @cached_property
    def drawn(self) -> DrawnScene:
        """In the truth's world where that is known, on the recording's clock."""
        return drawn_scene(self.scene, self.estimate)

    @property
    def has_truth(self) -> bool:
        """Whether there is something to compare with."""
        return self.scene is not None and any(wearer.truth is not None for wearer in self.scene.wearers)


def report_data(estimate: Estimate, scene: Scene | None = None, truth: Scene | None = None) -> ReportData:
    """Put together what there is.

    Args:
        estimate: with one wearer at least.
        scene: what it was made from.
        truth: a scene whose truth counts instead of that scene's.

    Raises:
        InputError: if they do not hold the same number of wearers, or there is no wearer, one without frames, or no
            truth where one is asked for.
    """
    if not estimate.wearers:
        raise InputError(f"estimate '{estimate.name}' has no wearer: expected at least one")
    for wearer in estimate.wearers:
        check_frames(wearer.motion)
    for source in (scene, truth):
        if source is not None and len(source.wearers) != len(estimate.wearers):
            raise InputError(
                f"estimate of {len(estimate.wearers)} wearers beside '{source.name}' of {len(source.wearers)}: "
                "expected the same; is it the estimate of this recording?"
            )
    if truth is None:
        return ReportData(estimate, scene)
    if all(wearer.truth is None for wearer in truth.wearers):
        raise InputError(f"'{truth.name}' holds no truth: expected that of one wearer at least")
    if scene is None:
        return ReportData(estimate, truth)
    wearers = tuple(
        replace(wearer, truth=true_wearer.truth)
        for wearer, true_wearer in zip(scene.wearers, truth.wearers, strict=True)
    )
    cameras = scene.cameras
    if [len(camera.detections) for camera in cameras] == [len(camera.detections) for camera in truth.cameras]:
        cameras = tuple(
            replace(camera, truth=true_camera.truth) for camera, true_camera in zip(cameras, truth.cameras, strict=True)
        )
    return ReportData(estimate, replace(scene, wearers=wearers, cameras=cameras))


def motion_data(data: ReportData) -> dict[str, object]:
    """The data of the viewer, as JSON; see ``viewer/viewer.js``."""
    bodies = list(_bodies(data))
    motions, estimated = [motion for _, motion, _ in bodies], [motion for _, motion, is_ghost in bodies if not is_ghost]
    start = min(float(motion.time[0]) for motion in motions)
    end = max(float(motion.time[-1]) for motion in motions)
    fastest = 30.0  # Hz, as films: faster is not seen, and would double the file
    most_poses = 9000  # 2.4 MB: five minutes of one wearer; longer motions are shown at a lower rate
    rate = min(fastest, max(motion.rate for motion in motions))
    frames = int((end - start) * rate + 1e-6) + 1
    max_poses = max(2, most_poses // len(bodies))
    if frames > max_poses:
        rate, frames = (max_poses - 1) / (end - start), max_poses
    time = start + np.arange(frames) / rate
    places = np.concatenate([_poses_at(motion, time)[1] for motion in estimated])
    low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    skins: list[Skeleton] = []
    numbers = list[int]()  # of skins; an estimate and the truth of the same body share one
    for motion in motions:
        mesh = body_mesh(motion.skeleton)
        number = next((number for number, skin in enumerate(skins) if body_mesh(skin) is mesh), len(skins))
        skins += [motion.skeleton] * (number == len(skins))
        numbers.append(number)
    return {
        "start": start,
        "rate": rate,
        "frames": frames,
        "shown": start + 0.6 * (end - start),
        "floor": float(np.median([floor_height(motion) for motion in estimated])),
        "centre": [round(float(place), 3) for place in (low + high) / 2],
        "extent": round(float((high - low).max()), 3),
        "bodies": [
            body_data(
                f"{wearer.name}, truth" if is_ghost else wearer.name,
                motion.skeleton,
                (wearer.index, len(data.wearers)),
                is_ghost,
            )
            | poses_data(*_poses_at(motion, time))
            | {"mesh": number, "sensors": [] if is_ghost else _sensors(wearer)}
            for (wearer, motion, is_ghost), number in zip(bodies, numbers, strict=True)
        ],
        "meshes": [mesh_data(skeleton) for skeleton in skins],
        "cameras": [
            {"name": camera.name, "corners": corners(camera.model)}
            | poses_data(camera.path.at(time).R_world_camera, camera.path.at(time).p_world_camera)
            for camera in data.drawn.cameras
            if camera.path is not None
        ],
    }


def _bodies(data: ReportData) -> Iterator[tuple[DrawnWearer, Motion, bool]]:
    """The bodies to draw, with their motions: the estimated ones, and the truth as ghosts."""
    for wearer in data.drawn.wearers:
        if wearer.shown is not None:
            yield wearer, wearer.shown, False
        if wearer.motion is not None and wearer.truth is not None:
            yield wearer, wearer.truth, True


def _sensors(wearer: DrawnWearer) -> list[dict[str, object]]:
    """Mountings and positions of a wearer's sensors: calibrated, else as declared."""
    sensors: list[dict[str, object]] = []
    if wearer.recording is None:
        return sensors
    calibration = wearer.estimate.calibration if wearer.estimate is not None else {}
    for site in wearer.recording.placement.sites:
        sensor_calibration = calibration.get(site.sensor)
        R_bone_sensor = site.R_bone_sensor if sensor_calibration is None else sensor_calibration.R_bone_sensor
        rotation = quaternion_from_matrix(R_bone_sensor, Order.XYZW).round(4).tolist()
        sensors.append({"bone": site.bone_index, "position": _rounded(site.p_bone_sensor), "rotation": rotation})
    return sensors


def _poses_at(motion: Motion, time: Array) -> tuple[Array, Array]:
    """Joint rotations ``(T, 24, 3, 3)`` and places ``(T, 3)`` at the nearest frames."""
    frame = np.clip(np.round((time - motion.start) * motion.rate), 0, len(motion) - 1).astype(int)
    return motion.R_parent_child[frame], motion.p_world_pelvis[frame]


def body_data(name: str, skeleton: Skeleton, number: tuple[int, int], is_ghost: bool = False) -> dict[str, object]:
    """A body without its poses; ``number`` is which of how many it is, for its colours."""
    colours = side_colours(*number)
    truth = hexadecimal(TRUTH_COLOUR)
    return {
        "name": name,
        "ghost": is_ghost,
        "mark": wearer_mark(*number),
        "parents": list(PARENTS),
        "offsets": [_rounded(offset) for offset in skeleton.p_parent_joint],
        "colours": [truth if is_ghost else colours[side_of(bone)] for bone in range(len(PARENTS))],
    }


def mesh_data(skeleton: Skeleton) -> dict[str, str]:
    """The skin: tenths of millimetres, triangles, the four bones that move a vertex most with their shares of 255, and
    the joint rotations in which it was made.
    """
    mesh = body_mesh(skeleton)
    bones, shares = mesh.four_bones()
    R_parent = mesh.R_bind_bone[[max(parent, 0) for parent in PARENTS]]
    R_parent[0] = np.eye(3)
    return {
        "points": _base64(np.round(1e4 * mesh.p_bind).astype("<i2")),
        "faces": _base64(mesh.faces.astype("<u4" if len(mesh.p_bind) >= 1 << 16 else "<u2")),
        "bones": _base64(bones),
        "shares": _base64(shares),
        "pose": _quaternions(transpose(R_parent) @ mesh.R_bind_bone),
    }


def poses_data(R: Array, p: Array) -> dict[str, object]:
    """Rotations ``(T, …, 3, 3)`` and places ``(T, 3)`` at frames."""
    return {"rotations": _quaternions(R), "positions": _base64(p.astype("<f4"))}


def _quaternions(R: Array) -> str:
    unit = 32767  # of a quaternion's numbers: 0.002° at worst
    return _base64(np.round(unit * quaternion_from_matrix(R, Order.XYZW)).astype("<i2"))


def corners(model: CameraModel) -> list[list[float]]:
    """The image's corners at a depth of one metre in the camera's axes, the upper left first, then clockwise."""
    w, h = model.width, model.height
    flat = model.normalise(np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))
    return [[*_rounded(corner), 1.0] for corner in flat]


def _rounded(values: Array | list[float]) -> list[float]:
    return [round(float(value), 4) for value in values]


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
