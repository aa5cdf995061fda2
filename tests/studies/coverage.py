"""Do the ± that are told hold the truth as often as they say? On people of a foreign simulator, and on real walks."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tests.studies.gait import GaitMotion, gait_of
from tests.studies.marker_body import SIDES, filmed
from tests.studies.population import Simulated, made, population
from tests.studies.real import converted
from tests.studies.real_recordings import real_recordings
from tests.studies.study import Tell, group, table
from vip_factors.body.joint_angles import joint_angle_sigmas, joint_angles
from vip_factors.body.lengths import LENGTHS, WIDTHS, lengths_of
from vip_factors.body.model_errors import FILMED, UNFILMED, shape_factor
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import VipFactorsError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.calibration import LIMBS, UNSURE, calibration_error
from vip_factors.evaluate.metrics import common_frames
from vip_factors.geometry.poses import align_yaw
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera import move_motion, scene_gauge
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

WITHIN_90 = 1.6449  # standard deviations of a Gaussian
ANGLES = ("hip_flexion", "hip_adduction", "hip_internal_rotation", "knee_flexion", "ankle_dorsiflexion",
          "elbow_flexion", "elbow_pronation", "wrist_flexion")  # fmt: skip
JOINTS = ("knee", "ankle", "shoulder", "elbow", "wrist")
Told = tuple[str, Array, Array]
"""A kind of quantity, errors ``(n, ...)`` and their standard deviations, in degrees or metres."""


@dataclass(frozen=True)
class CoverageRow:
    """One kind of quantity in one recording.

    Attributes:
        recording: its name.
        people: ``choosing`` or ``judging``, of a simulator, or ``real``.
        filmed: whether a camera saw it.
        what: the quantity; an angle's ``shape`` has its mean removed.
        inside: share of the errors within 90 % intervals.
        nees: mean of squared errors over told variances.
        error, sigma: root mean squares; degrees or metres.
    """

    recording: str
    people: str
    filmed: bool
    what: str
    inside: float
    nees: float
    error: float
    sigma: float


@dataclass(frozen=True, kw_only=True)
class Coverage(Simulated):
    """Do the ± that are told hold the truth as often as they say? On foreign simulated people, and on real walks."""

    half: Literal["choosing", "judging", "both"] = "judging"
    """People on whom the models' share of ± was chosen, or the others."""
    most: int = 20
    """Scenes of each half, drawn by lot."""
    data: Path | None = None
    """Folder with geneva_gait: its walks too, with and without a camera."""

    def rows(self, tell: Tell) -> Iterator[CoverageRow]:
        settings = replace(Settings(), frame_rate=self.frame_rate, covariance=True)
        for number, (people, scene) in enumerate(self._scenes()):
            tell(scene.name, number / (number + 10))
            try:
                found = smooth(scene, settings)
            except VipFactorsError:
                continue
            yield from coverage_rows(people, scene.name, found.camera is not None, told_beside(found, scene))
        for scene, reference in self._walks():
            tell(scene.name, 0.9)
            found = smooth(scene, settings)
            yield from coverage_rows("real", scene.name, found.camera is not None, told_of_walk(found, reference))

    def tables(self, rows: Sequence[CoverageRow]) -> Iterator[str]:
        """Means over recordings."""
        lines = []
        for (people, with_camera, what), own in group(rows, lambda one: (one.people, one.filmed, one.what)).items():
            inside, nees = (float(np.mean([getattr(one, name) for one in own])) for name in ("inside", "nees"))
            error, sigma = (float(np.sqrt(np.mean([getattr(one, name) ** 2 for one in own])))
                            for name in ("error", "sigma"))  # fmt: skip
            unit = 1e3 if " m" in what else 1.0
            lines.append([people, "camera" if with_camera else "none", what.replace(" m", " mm"), len(own),
                          f"{100 * inside:.0f}", f"{nees:.2f}", unit * error, unit * sigma])  # fmt: skip
        yield table(["people", "camera", "of", "recordings", "within 90 %", "NEES", "error", "told ±"], lines)

    def _scenes(self) -> Iterator[tuple[str, Scene]]:
        drawn = population(self.motions)
        for people, choosing in (("choosing", True), ("judging", False)):
            own = [one for one in drawn if one.is_for_choosing == choosing and self.half in (people, "both")]
            for index in np.random.default_rng(7).permutation(len(own))[: self.most]:
                yield people, read_scene(made(own[index], self.simulator, self.motions, self.folder))

    def _walks(self) -> Iterator[tuple[Scene, GaitMotion]]:
        for one in real_recordings(self.data) if self.data is not None else ():
            if self.data is None or one.markers is None or one.angles is None:
                continue
            recording, reference = converted(one, self.data), one.angles(self.data)
            seen = filmed(recording, one.markers(self.data), "standing", zlib.crc32(one.name.encode()))
            yield from ((scene, reference) for scene in (Scene(one.name, (recording,)), seen))


def coverage_rows(people: str, name: str, with_camera: bool, told: Iterator[Told]) -> Iterator[CoverageRow]:
    """A row of each kind of quantity."""
    for what, error, sigma in told:
        squares = (error / sigma) ** 2
        yield CoverageRow(
            name, people, with_camera, what, float(np.mean(squares < WITHIN_90**2)), float(np.mean(squares)),
            float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(np.broadcast_to(sigma, error.shape) ** 2))),
        )  # fmt: skip


def told_beside(found: Estimate, scene: Scene) -> Iterator[Told]:
    """Of the only wearer, beside the truth; headings against the surest, which is the world's by convention."""
    (own,), truth = found.wearers, scene.wearers[0].truth
    assert isinstance(truth, Truth)
    assert own.covariance is not None
    motion, true, chosen = common_frames(own.motion, truth.motion)
    angles, sigmas = joint_angles(motion), joint_angle_sigmas(motion, own.covariance.joints[chosen])
    off = (joint_angles(true).degrees - angles.degrees + 180) % 360 - 180
    for name in ANGLES:
        columns = [angles.names.index(f"{side}_{name}") for side in SIDES]
        yield from _whole_and_shape(name.replace("_", " "), off[:, columns], sigmas[:, columns])
    moved = move_motion(motion, scene_gauge([(motion, true)]))
    away = true.state.p_world_joint - moved.state.p_world_joint
    hips = away[:, [joint_index(f"{side}_hip") for side in SIDES]].mean(axis=1)
    root = np.sqrt(np.diagonal(own.covariance.root[chosen], axis1=1, axis2=2))
    yield "middle of the hips, m", hips, root
    for name in JOINTS:
        joints = [joint_index(f"{side}_{name}") for side in SIDES]
        yield f"{name} from the hips, m", away[:, joints] - hips[:, None], _positions(found)[joints, None]
    assert truth.calibration is not None
    surest = min(own.calibration, key=lambda one: own.calibration[one].heading_sigma)
    turned = own.calibration[surest].heading - truth.calibration[surest].heading
    error = calibration_error(own.calibration, truth.calibration, turned)
    names = [one for one in error.heading if one != surest]
    headings = [(error.heading[name], own.calibration[name].heading_sigma) for name in names]
    yield "headings", *np.rad2deg(headings).T
    mountings = [(error.mounting[one], own.calibration[one].mounting_sigma) for one in error.mounting]
    yield "mountings", *np.rad2deg(mountings).swapaxes(0, 1)
    if own.body is not None and own.body.names:
        measured = {*LIMBS, *WIDTHS} - {*UNSURE}
        lengths = {
            one: metres for one, metres in zip(LENGTHS, lengths_of(true.skeleton), strict=True) if one in measured
        }
        places = [own.body.names.index(length) for length in lengths]
        yield "lengths, m", np.array(list(lengths.values())) - own.body.posterior[places], own.body.sigma[places]


def told_of_walk(found: Estimate, reference: GaitMotion) -> Iterator[Told]:
    """Knees and hips beside markers, and where knees, ankles and arms are from the middle of the hips."""
    (own,) = found.wearers
    assert own.covariance is not None
    angles, sigmas, ours = (
        joint_angles(own.motion),
        joint_angle_sigmas(own.motion, own.covariance.joints),
        gait_of(own.motion),
    )
    both = (reference.time >= ours.time[0]) & (reference.time <= ours.time[-1])
    time = reference.time[both]
    for name in ("hip", "knee"):
        joints = [f"{side}_{name}" for side in SIDES]
        columns = [angles.names.index(f"{joint}_flexion") for joint in joints]
        off = [reference.flexion[joint][both] - np.interp(time, ours.time, ours.flexion[joint]) for joint in joints]
        sigma = [np.interp(time, ours.time, sigmas[:, column]) for column in columns]
        yield from _whole_and_shape(f"{name} flexion", np.transpose(off), np.transpose(sigma))
    names = [f"{side}_{joint}" for joint in ("hip", *JOINTS) for side in SIDES]
    true = np.stack([reference.p_world_joint[name][both] for name in names], axis=1)
    found_at = np.stack([[np.interp(time, ours.time, axis) for axis in ours.p_world_joint[name].T] for name in names])
    centres = [one - one[:, :2].mean(axis=1, keepdims=True) for one in (found_at.transpose(2, 0, 1), true)]
    seen = np.isfinite(centres[1]).all(axis=(1, 2))
    turn = align_yaw(*(centre[seen].reshape(-1, 3) for centre in centres)).R_target_source
    away = centres[1][seen] - centres[0][seen] @ turn.T
    for number, name in enumerate(JOINTS, start=1):
        sigma = _positions(found)[joint_index(f"left_{name}")]
        yield f"{name} from the hips, m", away[:, 2 * number : 2 * number + 2], sigma


def _positions(found: Estimate) -> Array:
    errors = UNFILMED if found.camera is None else FILMED
    return errors.positions({calibration.bone for calibration in found.wearers[0].calibration.values()})


def _whole_and_shape(name: str, error: Array, sigma: Array) -> Iterator[Told]:
    yield name, error, sigma
    yield f"{name}, shape", error - error.mean(axis=0), shape_factor(f"left_{name.partition(' ')[0]}") * sigma
