"""A motion between its frames: smooth splines, differentiated analytically.

The simulator must not share the estimator's mistakes, so acceleration is never a difference of frames. Every joint
rotation is a rotation spline with continuous angular acceleration, the root path a quintic; velocity and
acceleration of any point then follow from rigid-body kinematics down the chain, exactly. The spline *is* the truth.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from vip_factors.body.kinematics import BodyState, Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, ancestors
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class BoneKinematics:
    """How one bone moves at ``N`` instants; all in the world frame.

    Attributes:
        R_world_bone: ``(N, 3, 3)``.
        rate, angular_acceleration: ``(N, 3)`` rad/s and rad/s².
        position, velocity, acceleration: ``(N, 3)`` of the bone's joint: m, m/s, m/s².
    """

    R_world_bone: Array
    rate: Array
    angular_acceleration: Array
    position: Array
    velocity: Array
    acceleration: Array

    def point(self, p: Array, v: Array | None = None, a: Array | None = None) -> tuple[Array, Array, Array]:
        """World position, velocity and acceleration ``(N, 3)`` of a point at ``p`` in the bone's frame.

        ``p`` is ``(3,)`` or ``(N, 3)``; ``v`` and ``a`` are its derivatives *within* the bone's frame, if it moves.
        """
        R, w = self.R_world_bone, self.rate
        arm = _turn(R, p)
        velocity = self.velocity + np.cross(w, arm)
        acceleration = self.acceleration + np.cross(self.angular_acceleration, arm) + np.cross(w, np.cross(w, arm))
        if v is not None and a is not None:
            slide = _turn(R, v)
            velocity = velocity + slide
            acceleration = acceleration + 2 * np.cross(w, slide) + _turn(R, a)
        return self.position + arm, velocity, acceleration


@dataclass(frozen=True)
class DenseMotion:
    """Splines through a motion; made by :func:`dense_motion`."""

    skeleton: Skeleton
    joints: tuple[RotationSpline, ...]
    root: BSpline
    start: float
    end: float
    name: str

    def bone(self, bone: int, time: Array) -> BoneKinematics:
        """Kinematics of a bone at ``time`` ``(N,)`` seconds, within the motion."""
        time = np.clip(time, self.start, self.end)
        position, velocity, acceleration = (self.root.derivative(k)(time) if k else self.root(time) for k in range(3))
        R, rate, angular = self._joint(0, time)
        rate, angular = _turn(R, rate), _turn(R, angular)
        state = BoneKinematics(R, rate, angular, position, velocity, acceleration)
        for joint in ancestors(bone)[1:]:
            joint_point = state.point(self.skeleton.p_parent_joint[joint])
            R_parent_child, w, alpha = self._joint(joint, time)
            R = state.R_world_bone @ R_parent_child
            relative = _turn(R, w)
            angular = state.angular_acceleration + np.cross(state.rate, relative) + _turn(R, alpha)
            state = BoneKinematics(R, state.rate + relative, angular, *joint_point)
        return state

    def state(self, time: Array) -> BodyState:
        """World poses of all bones at ``time`` ``(N,)`` seconds, within the motion."""
        R = np.stack([spline(time).as_matrix() for spline in self.joints], axis=1)
        return forward_kinematics(self.skeleton, R, self.root(time))

    def sample(self, rate: float) -> Motion:
        """The motion at evenly spaced frames from its start on."""
        count = int(np.floor((self.end - self.start) * rate + 1e-6)) + 1
        time = np.clip(self.start + np.arange(count) / rate, self.start, self.end)
        R = np.stack([spline(time).as_matrix() for spline in self.joints], axis=1)
        return Motion(self.skeleton, R, self.root(time), rate, self.start, self.name)

    def _joint(self, joint: int, time: Array) -> tuple[Array, Array, Array]:
        """Joint rotation, its angular rate and acceleration, the latter two in the child's axes."""
        spline = self.joints[joint]
        return spline(time).as_matrix(), spline(time, 1), spline(time, 2)


def dense_motion(motion: Motion, lowpass_hz: float | None = None) -> DenseMotion:
    """Splines through the frames of a motion, low-passed first if asked (optical capture is noisy).

    Raises:
        InputError: for a motion of fewer than 8 frames.
    """
    least_frames = 8  # to hold a quintic and the filter's settling
    root_degree = 5  # of the root path's spline: continuous up to the fourth derivative
    if len(motion) < least_frames:
        raise InputError(f"motion '{motion.name}' has {len(motion)} frames: expected at least {least_frames}")
    q = _continuous_quaternions(motion.R_parent_child)
    root = motion.p_world_pelvis
    if lowpass_hz is not None and lowpass_hz < 0.45 * motion.rate:
        q = _lowpass(q, motion.rate, lowpass_hz)
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        root = _lowpass(root, motion.rate, lowpass_hz)
    R = matrix_from_quaternion(q, Order.XYZW)
    time = motion.time
    joints = tuple(RotationSpline(time, Rotation.from_matrix(R[:, joint])) for joint in range(JOINT_COUNT))
    return DenseMotion(
        motion.skeleton, joints, make_interp_spline(time, root, root_degree), motion.start, time[-1], motion.name
    )


def _continuous_quaternions(R: Array) -> Array:
    """Quaternions ``(T, 24, 4)`` whose sign does not jump from frame to frame."""
    q = quaternion_from_matrix(R, Order.XYZW)
    flips = np.sum(q[1:] * q[:-1], axis=-1) < 0
    sign = np.where(np.cumsum(flips, axis=0) % 2 == 1, -1.0, 1.0)
    q[1:] *= sign[..., None]
    return q


def _lowpass(values: Array, rate: float, cutoff: float) -> Array:
    filter_order = 2  # run forwards and backwards: fourth order, zero phase
    sos = scipy.signal.butter(filter_order, cutoff, fs=rate, output="sos")
    padding = min(len(values) - 1, int(np.ceil(3 * rate / cutoff)))
    return np.asarray(scipy.signal.sosfiltfilt(sos, values, axis=0, padlen=padding))


def _turn(R: Array, v: Array) -> Array:
    return np.einsum("nij,...j->ni" if np.ndim(v) == 1 else "nij,nj->ni", R, v)
