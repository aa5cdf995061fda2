"""What is odd about a wearer's body and motion: people are hardly ever so, wrong mountings often make them so."""

from collections.abc import Iterator, Mapping

import numpy as np

from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.pose_prior import joint_vector, load_joint_limits
from vip_factors.body.skeleton import joint_index
from vip_factors.estimate import BodyEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.recording import Recording

TURNED = np.deg2rad(60.0)  # on the bone, against the placement
MOST, MUCH = 0.5, 0.3  # of the frames, or of the sensors


def posture_findings(
    wearer: str, recording: Recording, motion: Motion, calibration: Calibration, start: Array
) -> Iterator[Finding]:
    """All that is odd about how a wearer holds himself, one finding each; ``start`` ``(S, 3, 3)`` mountings of it."""
    on = {recording.placement.site(name).bone: name for name in calibration}
    bones = set(on)
    yield from turned_findings(wearer, recording, start, calibration)
    yield from knee_findings(wearer, motion, on)
    yield from lying_findings(wearer, motion)
    if bones & {"left_knee", "left_ankle"} and bones & {"right_knee", "right_ankle"}:
        yield from crossed_findings(wearer, motion)
    yield from limit_findings(wearer, motion, bones)
    if recording.initial_pose == "none":
        yield from strap_findings(wearer, recording, calibration)


def turned_findings(wearer: str, recording: Recording, start: Array, calibration: Calibration) -> Iterator[Finding]:
    """Sensors that the motion turns far from the mountings ``(S, 3, 3)`` of the start."""
    turned = angle_between(start, np.stack([one.R_bone_sensor for one in calibration.values()]))
    far = {name: float(np.rad2deg(by)) for name, by in zip(calibration, turned, strict=True) if by > TURNED}
    if far:
        declared = "their straps" if recording.initial_pose == "none" else "the declared pose"
        yield Finding("turned since the start", wearer, numbers=far, words={"declared": declared})


def lying_findings(wearer: str, motion: Motion) -> Iterator[Finding]:
    """A chest that is far from upright most of the time."""
    lying = np.deg2rad(60.0)  # from the vertical, of the chest
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    up = body.R_world_bone[:, joint_index("spine3"), 2, 1]
    share = float(np.mean(up < np.cos(lying)))
    if share > MOST:
        yield Finding("lying", wearer, numbers={"percent": 100 * share})


def crossed_findings(wearer: str, motion: Motion) -> Iterator[Finding]:
    """Thighs that are crossed through much of a motion: ankles are by people who stand at ease, dance or sit."""
    crossed = 0.05  # m, of knees past one another: hips whose zeros are 7° off make as much of thighs side by side
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    left, right = (body.p_world_joint[:, joint_index(f"{side}_knee")] for side in ("left", "right"))
    across = np.einsum("ti,ti->t", left - right, body.R_world_bone[:, 0, :, 0])
    share = float(np.mean(across < -crossed))
    if share > MUCH:
        yield Finding("legs crossed", wearer, numbers={"percent": 100 * share})


def limit_findings(wearer: str, motion: Motion, bones: set[str]) -> Iterator[Finding]:
    """Ankles and elbows that are bent further than they go most of the time, under sensors of the limb below."""
    at_limit = np.deg2rad(3.0)  # beyond what joints do: those of people who stand and walk stay well within
    vectors = joint_vector(motion.R_parent_child).reshape(len(motion.R_parent_child), -1, 3)
    beyond = np.abs(load_joint_limits().violation(joint_vector(motion.R_parent_child))).reshape(vectors.shape)
    for joint in (f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "elbow")):
        share = float(np.mean(beyond[:, joint_index(joint) - 1].max(axis=1) > at_limit))
        if joint in bones and share > MUCH:
            side, name = joint.split("_")
            yield Finding(
                "joint limit", wearer, subject=f"{side} {name}", numbers={"percent": 100 * share},
                words={"joints": f"{name}s"},
            )  # fmt: skip


def strap_findings(wearer: str, recording: Recording, calibration: Calibration) -> Iterator[Finding]:
    """Half of the sensors or more sit otherwise than placed, and no declared pose told of it."""
    least_sensors = 3  # of which half are odd: of two sensors one is no majority
    angles = {
        name: float(angle_between(recording.placement.site(name).R_bone_sensor, one.R_bone_sensor))
        for name, one in calibration.items()
    }
    turned = {name: float(np.rad2deg(angle)) for name, angle in angles.items() if angle > TURNED}
    if len(calibration) >= least_sensors and len(turned) >= MOST * len(calibration):
        words = {"of": str(len(calibration)), "limit": f"{np.rad2deg(TURNED):.0f}°"}
        yield Finding("turned on the body", wearer, numbers=turned, words=words)


UNLIKELY = 3.0  # sigmas of the prior
# Knees stretch over by 5° at most; how straight a straight one is leaves as much again, and nobody walks like that.
BACKWARDS_DEG, BACKWARDS_SHARE = -10.0, 0.25
# A shank turns on a bent thigh by 25° at most, and back again: on the median by 6° in 38 sound recordings, by 11 to 14°
# where the heading of thigh or shank jumped or drifted by 50 to 60°.
KNEE_TURNED_DEG = 9.0
LEAST_SCALE = 0.02  # of a body: less is within what a stature, told by its wearer, is off


def body_findings(wearer: str, body: BodyEstimate, stature_m: float | None) -> Iterator[Finding]:
    """Of a wearer of whom a stature was told."""
    if not body.names:
        return
    scale, sigma = common_scale(body)
    if abs(scale) > max(UNLIKELY * sigma, LEAST_SCALE):
        usual = "an adult's" if stature_m is None else f"one of {stature_m:.2f} m"
        words = {"larger": "larger" if scale > 0 else "smaller", "usual": usual}
        yield Finding("body size", wearer, numbers={"percent": abs(100 * scale)}, words=words)
    else:
        scale = 0.0
    expected, sigmas = (1 + scale) * body.prior, np.sqrt(np.diag(body.prior_covariance))
    unlikely = [
        f"{name} {1e3 * found:.0f} mm (expected {1e3 * prior:.0f} ± {1e3 * sigma:.0f})"
        for name, found, prior, sigma in zip(body.names, body.posterior, expected, sigmas, strict=True)
        if abs(found - prior) > UNLIKELY * sigma
    ]
    if unlikely:  # a wrong stature or zoom changes all lengths alike
        yield Finding("body lengths", wearer, words={"lengths": ", ".join(unlikely)})


def knee_findings(wearer: str, motion: Motion, on: Mapping[str, str]) -> Iterator[Finding]:
    """Knees that bend backwards through much of a motion, or are twisted between sensors; ``on`` names them by bone."""
    vectors = np.rad2deg(joint_vector(motion.R_parent_child)).reshape(len(motion.R_parent_child), -1, 3)
    for side in ("left", "right"):
        bend, turn, _ = vectors[:, joint_index(f"{side}_knee") - 1].T
        share = float(np.mean(bend < BACKWARDS_DEG))
        if share > BACKWARDS_SHARE:
            yield Finding("knee backwards", wearer, subject=f"{side} knee", numbers={"percent": 100 * share})
        sensors = [on[bone] for bone in (f"{side}_hip", f"{side}_knee") if bone in on]
        degrees = float(np.median(np.abs(turn)))
        if len(sensors) == 2 and degrees > KNEE_TURNED_DEG:
            words = {"sensors": "' or '".join(sensors)}
            yield Finding("knee turned", wearer, subject=side, numbers={"degrees": degrees}, words=words)


def common_scale(body: BodyEstimate) -> tuple[float, float]:
    """By which share all lengths are larger than the prior's mean (least squares under the prior), and its sigma."""
    weighed = np.linalg.solve(body.prior_covariance, body.prior)
    variance = 1 / float(weighed @ body.prior)
    return variance * float(weighed @ (body.posterior - body.prior)), float(np.sqrt(variance))
