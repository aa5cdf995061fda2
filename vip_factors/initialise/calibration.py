"""Initial headings and mountings from rough placement, initial pose (thesis 4.3.1, eq. 4.7) and motion.

Headings from motion: below a third of a hertz, the horizontal acceleration of all sensors is that of the wearer's path.
In each sensor's inertial frame it is rotated by that sensor's heading, independent of the mounting.

Initial poses have instrumented bones as measured and the others at the prior's mean; in the initial root path the
lowest foot stands still.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
import scipy

from vip_factors.body.joint_priors import PosePrior
from vip_factors.body.kinematics import BodyState, forward_kinematics, local_rotations
from vip_factors.body.skeleton import (
    JOINT_COUNT,
    PARENTS,
    R_WORLD_FACING_X,
    HeldPose,
    Skeleton,
    ancestors,
    nominal_pose,
)
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, exp, log, mean_rotation, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.sensors.calibration import Placement, SensorCalibration
from vip_factors.sensors.frames import ImuFrames

TRUNK = (0, 3, 6, 9, 12, 15)  # pelvis, spine, neck, head


def headings_from_acceleration(frames: ImuFrames, reference: int) -> tuple[Array, Array]:
    """Heading ``(S,)`` of every sensor relative to the reference sensor's, from low-passed horizontal acceleration.

    Also returns standard deviations ``(S,)``, radians: infinite for the reference itself, and for sensors without
    acceleration or without common motion.
    """
    pad_periods = 3  # shortest recording, in periods of the cut-off
    inflation = 2.0  # of the error expected from the coherence: motion of limbs is not white noise
    least_coherence = 0.5  # below it there is no common acceleration
    cutoff_hz = 0.3  # below a slow step (0.5 Hz per foot), above the drift of attitude filters
    S = len(frames.sensors)
    acceleration_valid = frames.acceleration_valid
    use = np.any(acceleration_valid, axis=0)
    rows = np.flatnonzero(np.all(acceleration_valid[:, use], axis=1))
    duration = len(rows) * frames.step
    if not use[reference] or duration * cutoff_hz < pad_periods or 2 * cutoff_hz * frames.step >= 1:
        return np.zeros(S), np.full(S, np.inf)
    force = frames.specific_force_inertial[rows]
    smooth = _low_passed(force[..., :2], cutoff_hz * frames.step)
    z = smooth[..., 0] + 1j * smooth[..., 1]
    z = z - z.mean(axis=0)
    cross = np.conj(z).T @ z[:, reference]  # rotation from each sensor's frame to the reference's
    power = np.sqrt(np.sum(np.abs(z) ** 2, axis=0))
    product = power * power[reference]
    coherence = np.where(product > 0, np.abs(cross) / np.where(product > 0, product, 1.0), 0.0)
    coherence = np.clip(coherence, 0.0, 0.999)
    samples = 2 * cutoff_hz * duration
    clear = coherence > least_coherence
    safe = np.where(clear, coherence, 1.0)
    sigma = np.where(clear, inflation * np.sqrt((1 - safe**2) / (2 * safe**2 * samples)), np.inf)
    sigma[reference] = np.inf
    return np.where(np.isfinite(sigma), np.angle(cross), 0.0), sigma


def _low_passed(signal: Array, cutoff: float) -> Array:
    """Filter forwards and backwards with a second-order Butterworth low-pass, ``cutoff`` in cycles per frame.

    Equal to ``scipy.signal.sosfiltfilt``, whose import takes a third of a second.
    """
    pad = 9  # frames of odd extension beyond the ends
    w = np.tan(np.pi * cutoff)
    scale = 1 / (1 + np.sqrt(2) * w + w**2)
    gains = scale * w**2 * np.array([1.0, 2.0, 1.0])
    feedback = scale * np.array([2 * (w**2 - 1), w**2 - np.sqrt(2) * w + 1])

    def filtered(x: Array) -> Array:
        padded = np.concatenate([x[:1], x[:1], x])
        driven = gains[0] * x + gains[1] * padded[1:-1] + gains[2] * padded[:-2]
        driven[0] -= feedback.sum() * x[0]
        driven[1] -= feedback[1] * x[0]
        bands = np.ones((3, len(x)))
        bands[1:] = feedback[:, None]
        return np.asarray(scipy.linalg.solve_banded((2, 0), bands, driven, check_finite=False))

    flat = signal.reshape(len(signal), -1)
    turned = [2 * flat[:1] - flat[pad:0:-1], flat, 2 * flat[-1:] - flat[-2 : -pad - 2 : -1]]
    smooth = filtered(filtered(np.concatenate(turned))[::-1])[::-1]
    return np.asarray(smooth[pad:-pad].reshape(signal.shape))


@dataclass(frozen=True)
class InitialCalibration:
    """Initial values of headings and mountings, in the order of the frames' sensors.

    Attributes:
        headings: ``(S,)`` radians, with standard deviations ``heading_sigma``.
        R_bone_sensor: ``(S, 3, 3)`` mountings.
        R_world_bone: ``(S, 3, 3)`` bones in the declared initial pose, facing the world's x axis; None without one.
    """

    headings: Array
    heading_sigma: Array
    R_bone_sensor: Array
    R_world_bone: Array | None = None

    def facing(self, angle: float) -> "InitialCalibration":
        """Turn the wearer's facing in the initial pose by ``angle`` radians to the right.

        Heading differences are unchanged.
        """
        if self.R_world_bone is None:
            return self
        R_world_sensor = rotation_z(angle) @ self.R_world_bone @ self.R_bone_sensor
        mountings = transpose(self.R_world_bone) @ R_world_sensor
        return replace(self, headings=self.headings + angle, R_bone_sensor=mountings)


def initial_calibration(
    frames: ImuFrames, placement: Placement, skeleton: Skeleton, pose: HeldPose | None, seconds: float, reference: int
) -> InitialCalibration:
    """Estimate headings and mountings from the first ``seconds`` of a recording, and headings from all of its motion.

    The wearer faces the world's x axis at the start. Headings combine the rough mounting in the initial pose with the
    motion relative to the reference sensor. Mountings follow from a declared pose; without one they remain the rough
    ones, and headings assume that the wearer starts upright with the arms hanging.

    Raises:
        RecordingError: if a sensor has no orientation in that time.
    """
    R = (pose or nominal_pose("n-pose")).R_parent_child.copy()
    R[0] = R_WORLD_FACING_X
    R_world_bone = forward_kinematics(skeleton, R[None], np.zeros((1, 3))).R_world_bone[0]
    R_inertial_sensor = orientation_at_start(frames, seconds)
    rough = np.stack([placement.site(name).R_bone_sensor for name in frames.sensors])
    bones = R_world_bone[[placement.site(name).bone_index for name in frames.sensors]]
    sigma = np.array([placement.site(name).mounting_sigma for name in frames.sensors])
    by_straps = yaw_of(bones @ rough @ transpose(R_inertial_sensor))
    by_motion, motion_sigma = headings_from_acceleration(frames, reference)
    information = sigma**-2.0 + motion_sigma**-2.0
    off = wrap_angle(by_motion + by_straps[reference] - by_straps)  # along the shorter arc
    headings, heading_sigma = by_straps + motion_sigma**-2.0 / information * off, information**-0.5
    if pose is None:
        return InitialCalibration(headings, heading_sigma, rough)
    mountings = transpose(bones) @ rotation_z(headings) @ R_inertial_sensor
    return InitialCalibration(headings, heading_sigma, mountings, bones)


def known_calibration(frames: ImuFrames, calibrations: dict[str, SensorCalibration]) -> InitialCalibration:
    """Take headings and mountings from a simulator or an earlier estimate.

    Raises:
        RecordingError: if a sensor is missing.
    """
    missing = [name for name in frames.sensors if name not in calibrations]
    if missing:
        raise RecordingError(f"no known calibration of sensor '{missing[0]}': known are {', '.join(calibrations)}")
    chosen = [calibrations[name] for name in frames.sensors]
    headings = np.array([calibration.heading for calibration in chosen])
    return InitialCalibration(
        headings, np.full(len(chosen), np.inf), np.stack([calibration.R_bone_sensor for calibration in chosen])
    )


def orientation_at_start(frames: ImuFrames, seconds: float) -> Array:
    """Mean orientation ``(S, 3, 3)`` of each sensor over its first ``seconds`` of data.

    Raises:
        RecordingError: if a sensor has no orientation.
    """
    count = max(1, round(seconds / frames.step))
    means = []
    for s, name in enumerate(frames.sensors):
        valid = np.flatnonzero(frames.orientation_valid[:, s])[:count]
        if not len(valid):
            raise RecordingError(f"sensor '{name}' has no orientation at the start: leave it out or cut the recording")
        means.append(mean_rotation(frames.R_inertial_sensor[valid, s]))
    return np.stack(means)


def first_poses(
    frames: ImuFrames, bones: Sequence[int], headings: Array, R_bone_sensor: Array, prior: PosePrior
) -> Array:
    """Initial joint rotations ``(T, 24, 3, 3)`` of the inertial tracker; headings are ``(S,)``, or ``(T, S)`` by frame.

    Joints between two instrumented bones start at the prior's mean and share the remaining rotation equally, so that
    none starts beyond its limits. If several sensors share a bone, the first one that measured is used, with gaps
    interpolated. A pelvis without a sensor follows the lowest instrumented bone of the trunk.
    """
    measured = dict[int, Array]()
    for s, bone in enumerate(bones):
        is_valid = frames.orientation_valid[:, s]
        if is_valid.any() and bone not in measured:  # thesis eq. 4.8
            R = interpolate_rotations(frames.time[is_valid], frames.R_inertial_sensor[is_valid, s], frames.time)
            measured[bone] = rotation_z(headings[..., s]) @ R @ transpose(R_bone_sensor[s])
    mean = np.concatenate([np.eye(3)[None], exp(prior.mean.reshape(-1, 3))])
    R_world_bone = np.empty((len(frames), JOINT_COUNT, 3, 3))

    R_world_bone[:, 0] = next(measured[bone] for bone in (*TRUNK, 1, 2, *measured) if bone in measured)
    placed = {0}
    for bone in sorted(measured, key=lambda bone: (bone not in TRUNK, len(ancestors(bone)))):
        chain = [joint for joint in ancestors(bone) if joint not in placed]
        if not chain:
            continue
        start = R_world_bone[:, PARENTS[chain[0]]]
        followed = start[:, None] @ np.stack(list(accumulate(mean[chain], np.matmul)))
        remaining_turn = log(transpose(start) @ measured[bone] @ transpose(followed[:, -1]) @ start)
        shares = np.arange(1, len(chain) + 1) / len(chain)
        turned = exp(shares[:, None] * remaining_turn[:, None])
        R_world_bone[:, chain] = start[:, None] @ turned @ transpose(start)[:, None] @ followed
        placed |= set(chain)
    for joint in range(JOINT_COUNT):
        if joint not in placed:
            R_world_bone[:, joint] = R_world_bone[:, PARENTS[joint]] @ mean[joint]
    return local_rotations(R_world_bone)


def standing_path(body: BodyState, points: tuple[tuple[int, Array], ...]) -> Array:
    """Root positions ``(T, 3)`` for which the lowest contact point of each frame does not move, on a floor at z = 0.

    ``body`` has its root at the origin in all frames.
    """
    relative = np.stack([body.point(bone, p) for bone, p in points], axis=1)
    lowest = np.argmin(relative[:, :, 2], axis=1)
    rows = np.arange(len(relative) - 1)
    step = relative[rows, lowest[:-1]] - relative[rows + 1, lowest[:-1]]
    path = np.zeros((len(relative), 3))
    path[1:, :2] = np.cumsum(step[:, :2], axis=0)
    path[:, 2] = -relative[:, :, 2].min(axis=1)
    return path


def contact_confidence(body: BodyState, points: tuple[tuple[int, Array], ...], step: float) -> Array:
    """Confidence ``(T, C)`` in [0, 1] that contact points are loaded: low and slow points.

    ``body`` is in the world, with an initial root path.
    """
    rounding = 1e-6  # frames: makes rounding of half frames independent of the last digit of a time
    smoothing = 0.1  # s, averaging window, shorter than a contact
    speed_scale = 0.4  # m/s: a planted foot is slower, a swinging one moves at 2–4 m/s
    height_band = 0.03  # m above the lowest point: soles and floors are not flat
    p = body.points(np.array([bone for bone, _ in points]), np.array([point for _, point in points]))
    velocity = np.gradient(p, step, axis=0)
    speed = np.linalg.norm(velocity, axis=2)
    height = p[:, :, 2] - p[:, :, 2].min(axis=1, keepdims=True)
    confidence = np.exp(-0.5 * (speed / speed_scale) ** 2 - 0.5 * (height / height_band) ** 2)
    frames = max(1, round(smoothing / step + rounding))
    averaged = scipy.ndimage.uniform_filter1d(confidence, frames, axis=0)
    return np.clip(averaged, 0.0, 1.0)  # the running sum may be slightly negative
