"""Solved windows of a filmed scene in one world, and joined without seams: wearers, camera, and who is who.

As windows of a recording without a camera do, two pass over into one another in the middle of their overlap, where both
are settled (:mod:`~vip_factors.stages.window_join`).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose, yaw_of
from vip_factors.initialise.camera import robust_mean_angle
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.stages.scene_window_solve import SceneWindow
from vip_factors.stages.window_join import SETTLING


def meeting_of(before: SceneWindow, window: SceneWindow) -> slice:
    """The frames in which one passes over into the next."""
    first, last = window.frames.start, before.frames.stop
    settled = int((last - first) * SETTLING)
    return slice(first + settled, last - settled)


def moved(window: SceneWindow, before: SceneWindow, has_floor: bool) -> SceneWindow:
    """A window whose world is its own in the world of the one before, by where both have wearers and camera.

    Worlds differ by a turn about the vertical and a shift; on a floor, that is at the same height.
    """
    meeting = meeting_of(before, window)
    other, own = _within(before, meeting), _within(window, meeting)
    pairs = [(one.motion.R_parent_child[:, 0], two.motion.R_parent_child[:, 0]) for one, two in _pairs(other, own)]
    pairs.append((other.camera.path.R_world_camera, own.camera.path.R_world_camera))
    yaw = robust_mean_angle(np.concatenate([yaw_of(there @ transpose(here)) for there, here in pairs]))
    places = [(one.motion.p_world_pelvis, two.motion.p_world_pelvis) for one, two in _pairs(other, own)]
    places.append((other.camera.path.p_world_camera, own.camera.path.p_world_camera))
    turn = rotation_z(yaw)
    shift = np.median(np.concatenate([there - here @ turn.T for there, here in places]), axis=0)
    if has_floor:
        shift[2] = 0.0
    middle = (meeting.stop - meeting.start) // 2
    wearers = tuple(
        _turned(one, yaw, shift, _unsureness(first, second, middle, has_floor))
        for one, (first, second) in zip(window.wearers, _pairs(other, own), strict=True)
    )
    path, calibration = window.camera.path, window.camera.calibration
    path = CameraPath(path.time, turn @ path.R_world_camera, path.p_world_camera @ turn.T + shift)
    if calibration is not None:
        calibration = replace(calibration, heading=calibration.heading + yaw)
    headings = tuple(replace(one, knots=one.knots + yaw) for one in window.headings)
    camera = replace(window.camera, path=path, calibration=calibration)
    return replace(window, wearers=wearers, camera=camera, headings=headings)


def chunks_of(windows: Iterator[SceneWindow], head: Estimate) -> Iterator[Estimate]:
    """The estimate chunk by chunk, of windows in one world that overlap, in the order of time."""
    done, before, told = 0, next(windows), -np.inf
    for window in windows:
        meeting = meeting_of(before, window)
        boundary = float(np.mean(window.wearers[0].motion.time[[meeting.start - window.frames.start]]))
        yield _chunk(_within(before, slice(done, meeting.start)), told, boundary, head)
        yield _chunk(_between(_within(before, meeting), _within(window, meeting)), boundary, boundary, head)
        done, before, told = meeting.stop, window, boundary
    yield _chunk(_within(before, slice(done, before.frames.stop)), told, np.inf, head)


def _pairs(one: SceneWindow, other: SceneWindow) -> Iterator[tuple[WearerEstimate, WearerEstimate]]:
    return zip(one.wearers, other.wearers, strict=True)


def _within(window: SceneWindow, frames: slice) -> SceneWindow:
    """Some of a window's frames; who is who is still of all."""
    own = slice(frames.start - window.frames.start, frames.stop - window.frames.start)
    wearers = tuple(one.frames(own) for one in window.wearers)
    return replace(window, frames=frames, wearers=wearers, camera=window.camera.frames(own))


def _between(one: SceneWindow, other: SceneWindow) -> SceneWindow:
    """The frames of a meeting, of which the first are nearly as in one window, and the last as in the other."""
    count = one.frames.stop - one.frames.start
    share = np.linspace(0, 1, count + 2)[1:-1]
    wearers = tuple(_estimate_between(first, second, share) for first, second in _pairs(one, other))
    return replace(one, wearers=wearers, camera=_camera_between(one.camera, other.camera, share), reports=())


def _estimate_between(one: WearerEstimate, other: WearerEstimate, share: Array) -> WearerEstimate:
    first, second = one.motion, other.motion
    motion = replace(
        first,
        R_parent_child=_turns_between(first.R_parent_child, second.R_parent_child, share),
        p_world_pelvis=_values_between(first.p_world_pelvis, second.p_world_pelvis, share),
    )
    covariance = one.covariance
    if covariance is not None and other.covariance is not None:
        covariance = PoseCovariance(
            _values_between(covariance.joints, other.covariance.joints, share),
            _values_between(covariance.root, other.covariance.root, share),
        )
    nearer = (share < 0.5)[:, None]
    residuals = {kind: np.where(nearer, values, other.residuals[kind]) for kind, values in one.residuals.items()}
    return replace(one, motion=motion, covariance=covariance, residuals=residuals)


def _camera_between(one: CameraEstimate, other: CameraEstimate, share: Array) -> CameraEstimate:
    first, second, covariance, residual = one.path, other.path, one.covariance, one.residual_px
    if len(first) == len(share) == len(second):
        first = CameraPath(
            first.time,
            _turns_between(first.R_world_camera, second.R_world_camera, share),
            _values_between(first.p_world_camera, second.p_world_camera, share),
        )
        if covariance is not None and other.covariance is not None:
            covariance = _values_between(covariance, other.covariance, share)
    if residual is not None and other.residual_px is not None:
        residual = np.where((share < 0.5)[:, None], residual, other.residual_px)
    return replace(one, path=first, covariance=covariance, residual_px=residual)


def _turns_between(one: Array, other: Array, share: Array) -> Array:
    """Rotations ``(T, ..., 3, 3)``, each its share of the way from one to the other."""
    share = share.reshape(-1, *(1,) * (one.ndim - 2))
    return one @ exp(share * log(transpose(one) @ other))


def _values_between(one: Array, other: Array, share: Array) -> Array:
    return one + share.reshape(-1, *(1,) * (one.ndim - 1)) * (other - one)


def _turned(estimate: WearerEstimate, yaw: float, shift: Array, unsure: Array) -> WearerEstimate:
    """A wearer in a world turned about the vertical, then shifted, and as unsure as that one is of where it is."""
    turn, motion, R = rotation_z(yaw), estimate.motion, estimate.motion.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    moved = replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ turn.T + shift)
    calibration = {
        name: replace(one, heading=one.heading + yaw, heading_path=one.heading_path + yaw)
        for name, one in estimate.calibration.items()
    }
    covariance = estimate.covariance
    if covariance is not None:
        covariance = replace(covariance, root=turn @ covariance.root @ turn.T + unsure)
    return replace(estimate, motion=moved, calibration=calibration, covariance=covariance)


def _unsureness(before: WearerEstimate, own: WearerEstimate, middle: int, has_floor: bool) -> Array:
    """What the one before is less sure of a wearer's place, ``(3, 3)`` m²."""
    added = np.zeros((3, 3))
    if before.covariance is not None and own.covariance is not None:
        axes = slice(0, 2 if has_floor else 3)
        added[axes, axes] = (before.covariance.root - own.covariance.root)[middle, axes, axes]
    return added


def _chunk(window: SceneWindow, start: float, end: float, head: Estimate) -> Estimate:
    """Of all its frames; who is who in the video from one instant to another."""
    shown = (window.detected_at >= start) & (window.detected_at < end)
    return replace(
        head, wearers=window.wearers, camera=None if head.camera is None else window.camera,
        wearer_of_detection=window.wearer[shown], reports=window.reports,
    )  # fmt: skip
