"""Camera model (pinhole with OpenCV's distortion) with derivatives, camera path, its odometry, and video clock."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.geometry.poses import Alignment, align_yaw
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose, yaw_of


@dataclass(frozen=True, repr=False)
class CameraPath(Summarised):
    """Camera poses ``T_world_camera`` at ``T`` instants; a static camera has one.

    Attributes:
        time: ``(T,)`` seconds from the recording's start, increasing.
        R_world_camera: ``(T, 3, 3)``; camera axes are OpenCV's (x right, y down, z forward).
        p_world_camera: ``(T, 3)`` metres.
    """

    time: Array
    R_world_camera: Array
    p_world_camera: Array

    def __post_init__(self) -> None:
        T = len(self.time)
        if T == 0 or self.R_world_camera.shape != (T, 3, 3) or self.p_world_camera.shape != (T, 3):
            raise InputError(
                f"camera path of {T} instants with rotations {self.R_world_camera.shape} and positions "
                f"{self.p_world_camera.shape}: expected (T, 3, 3) and (T, 3)"
            )

    def __len__(self) -> int:
        return len(self.time)

    def frames(self, which: slice) -> "CameraPath":
        """Select consecutive instants, at least one."""
        return CameraPath(self.time[which], self.R_world_camera[which], self.p_world_camera[which])

    def at(self, time: Array) -> "CameraPath":
        """Interpolate at other instants ``(N,)``; constant before the first and after the last."""
        time = np.asarray(time, dtype=float)
        if len(self) == 1:
            count = len(time)
            return CameraPath(
                time, np.repeat(self.R_world_camera, count, axis=0), np.repeat(self.p_world_camera, count, axis=0)
            )
        inside = np.clip(time, self.time[0], self.time[-1])
        p = interpolate_points(self.time, self.p_world_camera, inside)
        return CameraPath(time, interpolate_rotations(self.time, self.R_world_camera, inside), p)

    def to_camera(self, p_world: Array) -> Array:
        """Transform world points ``(T, N, 3)`` to the camera's frame at each instant."""
        return np.einsum(
            "tij,tnj->tni", transpose(self.R_world_camera), p_world - self.p_world_camera[:, None], optimize=True
        )


MotionPair = tuple[Motion, Motion]
"""Estimated and true motion at the same frames."""
PathPair = tuple[CameraPath, CameraPath]
"""Estimated and true camera path at the same instants."""


def scene_gauge(wearers: Sequence[MotionPair], cameras: Sequence[PathPair] = ()) -> Alignment:
    """Fit one yaw and translation, estimate to truth, to the joints of all wearers and to the cameras.

    In every frame all cameras together weigh as much as one wearer: far from the wearers, they constrain the yaw best.
    """
    points = [[motion.state.p_world_joint.reshape(-1, 3) for motion in pair] for pair in wearers]
    for pair in cameras:
        frames, joints = wearers[0][0].R_parent_child.shape[:2]
        # A static camera has one instant, which is repeated.
        repeats = max(1, joints * max(1, frames // len(pair[0])) // len(cameras))
        points.append([np.repeat(path.p_world_camera, repeats, axis=0) for path in pair])
    estimated, true = (np.concatenate(side) for side in zip(*points, strict=True))
    return align_yaw(estimated, true)


def anchored_gauge(wearer: MotionPair, heading_error: float) -> Alignment:
    """Gauge that the graph's prior fixes: one sensor's heading and its wearer's first root position.

    Covariances refer to this gauge, so NEES must be computed in it; a fitted alignment removes part of the error.
    ``heading_error`` is estimate minus truth, radians.
    """
    R_true_estimate = rotation_z(-heading_error)
    estimated, true = (motion.p_world_pelvis[0] for motion in wearer)
    return Alignment(R_true_estimate, true - R_true_estimate @ estimated, np.ones(()))


def yaw(gauge: Alignment) -> float:
    """Yaw of the estimate's world relative to the true one, radians: the excess of every heading."""
    return -float(yaw_of(gauge.R_target_source))


def move_motion(motion: Motion, gauge: Alignment) -> Motion:
    """Move a motion to the true world."""
    R_parent_child = motion.R_parent_child.copy()
    R_parent_child[:, 0] = gauge.R_target_source @ R_parent_child[:, 0]
    return replace(motion, R_parent_child=R_parent_child, p_world_pelvis=gauge.apply(motion.p_world_pelvis))


def move_path(path: CameraPath, gauge: Alignment) -> CameraPath:
    """Move a camera path to the true world."""
    return CameraPath(path.time, gauge.R_target_source @ path.R_world_camera, gauge.apply(path.p_world_camera))


NEAREST_M = 0.1  # depth at which nearer points and those behind the camera are projected


@dataclass(frozen=True)
class CameraModel:
    """Intrinsics of a camera (thesis eqs. 4.1–4.3), all in pixels.

    Attributes:
        width, height: of the image.
        focal: ``(fx, fy)``.
        centre: ``(cx, cy)``, the principal point.
        distortion: OpenCV's ``k1, k2, p1, p2[, k3[, k4, k5, k6]]``; empty for none.
    """

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        largest_image = 1_000_000  # pixels a side: more means a damaged file
        if not (0 < self.width <= largest_image and 0 < self.height <= largest_image):
            raise InputError(
                f"camera image of {self.width} by {self.height} pixels: expected numbers between 1 and {largest_image}"
            )
        if not all(np.isfinite(f) and f > 0 for f in self.focal):
            raise InputError(f"camera focal lengths {self.focal}: expected two positive numbers of pixels")
        if not np.all(np.isfinite(self.centre)):
            raise InputError(f"camera principal point {self.centre}: expected two finite numbers of pixels")
        if len(self.distortion) not in (0, 4, 5, 8) or not np.all(np.isfinite(self.distortion)):
            raise InputError(f"camera distortion {self.distortion}: expected 0, 4, 5 or 8 finite numbers, as OpenCV's")

    def zoomed(self, log_zoom: float) -> "CameraModel":
        """Multiply the focal lengths by ``exp(log_zoom)``."""
        zoom = float(np.exp(log_zoom))
        return replace(self, focal=(zoom * self.focal[0], zoom * self.focal[1]))

    @property
    def K(self) -> Array:
        """The ``(3, 3)`` camera matrix."""
        return np.array([[self.focal[0], 0, self.centre[0]], [0, self.focal[1], self.centre[1]], [0, 0, 1.0]])

    def project(self, p_camera: Array) -> Array:
        """Pixels ``(..., 2)`` of points ``(..., 3)`` in metres, camera axes (x right, y down, z forward)."""
        pixels, _ = self._project(p_camera, jacobian=False)
        return pixels

    def project_with_jacobian(self, p_camera: Array) -> tuple[Array, Array]:
        """Pixels ``(..., 2)`` and their derivative ``(..., 2, 3)`` by the point."""
        pixels, J = self._project(p_camera, jacobian=True)
        assert J is not None
        return pixels, J

    def _project(self, p_camera: Array, jacobian: bool) -> tuple[Array, Array | None]:
        p = np.asarray(p_camera, dtype=float)
        in_front = p[..., 2] > NEAREST_M
        z = np.where(in_front, p[..., 2], NEAREST_M)
        flat = p[..., :2] / z[..., None]
        bent, D = self._distort(flat, jacobian)
        focal, centre = np.array(self.focal), np.array(self.centre)
        if D is None:
            return bent * focal + centre, None
        by_point = np.zeros((*p.shape[:-1], 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1 / z
        by_point[..., 2] = -flat * (in_front / z)[..., None]
        return bent * focal + centre, focal[:, None] * (D @ by_point)

    def _distort(self, flat: Array, jacobian: bool) -> tuple[Array, Array | None]:
        """Distorted normalised coordinates ``(..., 2)`` and their derivative ``(..., 2, 2)``."""
        if not self.distortion:
            return flat, np.broadcast_to(np.eye(2), (*flat.shape, 2)) if jacobian else None
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *[0.0] * (8 - len(self.distortion)))
        x, y = flat[..., 0], flat[..., 1]
        r2 = x**2 + y**2
        top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = top / bottom
        bent = flat * radial[..., None]
        bent = bent + np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y], axis=-1)
        if not jacobian:
            return bent, None
        slope = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) / bottom
        D = np.empty((*flat.shape, 2))
        D[..., 0, 0] = radial + 2 * x**2 * slope + 2 * p1 * y + 6 * p2 * x
        D[..., 0, 1] = D[..., 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        D[..., 1, 1] = radial + 2 * y**2 * slope + 6 * p1 * y + 2 * p2 * x
        return bent, D

    def inside(self, pixels: Array) -> np.ndarray:
        """Test which pixels ``(..., 2)`` lie in the image."""
        return np.all((pixels >= 0) & (pixels < [self.width, self.height]), axis=-1)

    def normalise(self, pixels: Array) -> Array:
        """Undistort pixels ``(..., 2)`` to coordinates ``(..., 2)`` at depth one; NaN stays NaN."""
        undistort_steps = 6  # Newton steps: four reach 1e-12 on strong wide-angle lenses
        bent = (np.asarray(pixels, dtype=float) - np.array(self.centre)) / np.array(self.focal)
        flat = bent
        for _ in range(undistort_steps if self.distortion else 0):
            distorted, D = self._distort(flat, jacobian=True)
            assert D is not None
            flat = flat + np.linalg.solve(D, (bent - distorted)[..., None])[..., 0]
        return flat


# Lens without calibration. Phones have 60 to 65 degrees along the longer side, a little less with stabilisation;
# action cameras up to 90.
UNCALIBRATED_FIELD_OF_VIEW_DEG = 60.0
UNCALIBRATED_FOCAL_SIGMA = 0.25  # of the logarithm of the focal length


def uncalibrated_camera(width: int, height: int) -> CameraModel:
    """Make a pinhole camera with a phone's usual field of view and the principal point in the image's centre."""
    focal = max(width, height) / 2 / float(np.tan(np.deg2rad(UNCALIBRATED_FIELD_OF_VIEW_DEG) / 2))
    return CameraModel(width, height, (focal, focal), (width / 2, height / 2))


@dataclass(frozen=True)
class VideoClock:
    """Map from the video's clock to the sensors': ``t + offset + drift t``, in seconds.

    Attributes:
        offset: seconds to add at the video's time 0.
        drift: seconds to add for each second of the video: about 1e-5 between two quartz clocks, 1e-3 if a rate of
            29.97 Hz is declared as 30 Hz.
    """

    offset: float = 0.0
    drift: float = 0.0

    def __post_init__(self) -> None:
        fastest = 0.5  # a larger drift means clocks of different times
        farthest_s = 1e10  # three centuries: one clock may count from 1970 and the other from its start
        if not (abs(self.offset) < farthest_s and abs(self.drift) < fastest):
            raise InputError(
                f"video clock with an offset of {self.offset:g} s and a drift of {self.drift:g} s per second: expected "
                f"an offset below {farthest_s:g} s and a drift below {fastest:g}"
            )

    def late(self, time: float) -> float:
        """Seconds to add at an instant of the video."""
        return self.offset + self.drift * time

    def at(self, time: Array) -> Array:
        """Convert the video's times to the sensors'."""
        return time + self.offset + self.drift * time

    def corrected(self, seconds: float, drift: float, middle: float) -> "VideoClock":
        """Add ``seconds`` at the instant ``middle`` of the sensors' clock, and ``drift`` seconds per second from it."""
        offset = self.offset + seconds + drift * (self.offset - middle)
        return VideoClock(offset, self.drift + drift * (1 + self.drift))


LONGEST_GAP_S = (
    0.25  # between two poses of a path of visual odometry; a longer one says nothing about the frames between
)
FASTEST_TURN = 10.0  # rad/s: a path that turns or moves faster was reset
FASTEST_SHIFT = 5.0  # m/s; in spreads of the path a second where its scale is free


@dataclass(frozen=True)
class Odometry:
    """Visual odometry: relative poses ``T_camera_next`` between consecutive frames.

    Attributes:
        R_camera_next: ``(T, 3, 3)``; the last one has no next frame.
        p_camera_next: ``(T, 3)`` metres; in units of its own where the scale is free.
        valid: ``(T,)`` where the path has poses.
        is_scale_free: whether the path has an unknown scale, as monocular SLAM has.
    """

    R_camera_next: Array
    p_camera_next: Array
    valid: np.ndarray
    is_scale_free: bool = False

    @classmethod
    def between(cls, path: CameraPath, time: Array, is_scale_free: bool = False) -> "Odometry":
        """The motion along a path, whose times are on the frames' clock, between frames at ``time`` ``(T,)``."""
        poses = path.at(time)
        R, p = poses.R_world_camera, poses.p_world_camera
        R_next, p_next = np.concatenate([R[1:], R[-1:]]), np.concatenate([p[1:], p[-1:]])
        R_camera_next, p_camera_next = transpose(R) @ R_next, np.einsum("tji,tj->ti", R, p_next - p)
        step, shift = np.diff(path.time), np.linalg.norm(np.diff(path.p_world_camera, axis=0), axis=1)
        turn = angle_between(path.R_world_camera[:-1], path.R_world_camera[1:])
        is_broken = (step > LONGEST_GAP_S) | (turn > FASTEST_TURN * step) | (shift > FASTEST_SHIFT * step)
        # A frame is tied to the next where the path covers both and no interval between them is broken.
        broken = np.concatenate([[0], np.cumsum(is_broken)])
        first_pose = np.clip(np.searchsorted(path.time, time[:-1], side="right") - 1, 0, len(broken) - 1)
        end = np.clip(np.searchsorted(path.time, time[1:], side="left"), 0, len(broken) - 1)
        is_covered = (time[:-1] >= path.time[0]) & (time[1:] <= path.time[-1])
        valid = np.append(is_covered & (broken[np.maximum(end, first_pose)] == broken[first_pose]), False)
        return cls(R_camera_next, p_camera_next, valid, is_scale_free)

    def window(self, frames: slice) -> "Odometry":
        """The motion in some consecutive frames."""
        return replace(
            self,
            R_camera_next=self.R_camera_next[frames],
            p_camera_next=self.p_camera_next[frames],
            valid=self.valid[frames],
        )
