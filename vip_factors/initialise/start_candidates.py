"""Which headings and mountings a start is chosen from."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, exp, rotation_y, rotation_z, transpose
from vip_factors.initialise.calibration import InitialCalibration

GRID = 24  # headings 15° apart: costs are smooth over that
TURNS = 8  # about its limb, of a sensor that cannot sit as placed
OUTWARDS = 0.75  # the sensor's z axis stays out of the skin: it is not along the limb
TILTED = np.deg2rad(40.0)  # on average over a recording, of trunk, thighs and shanks: too much for walking and standing


@dataclass(frozen=True)
class Candidates:
    """Headings that sensors may have, and their mountings with each of them.

    Attributes:
        headings: ``(S, K)`` radians.
        R_bone_sensor: by sensor ``(K, M, 3, 3)``.
        relative: whether all sensors have the same headings, evenly around the circle, and mountings do not depend on
            them: then headings matter by their differences alone.
        declared: whether the mountings are those that a declared pose asks for.
    """

    headings: Array
    R_bone_sensor: tuple[Array, ...]
    relative: bool = False
    declared: bool = False


def declared_candidates(usual: InitialCalibration, R_inertial_sensor: Array) -> Candidates:
    """All headings, and with each the mounting that the declared pose asks for.

    Args:
        usual: with the bones in that pose.
        R_inertial_sensor: ``(S, 3, 3)`` orientations in it.
    """
    assert usual.R_world_bone is not None
    headings = _around(float(usual.headings[0]))
    mountings = transpose(usual.R_world_bone)[:, None] @ rotation_z(headings) @ R_inertial_sensor[:, None]
    return Candidates(np.tile(headings, (len(mountings), 1)), tuple(mountings[:, :, None]), declared=True)


def placed_candidates(
    R_placed: Array, limbs: Array, up_sensor: Array, first: float = 0.0
) -> tuple[Candidates, tuple[int, ...]]:
    """All headings, and with each the mounting as placed and all quarter turns of it that keep bones upright.

    Args:
        R_placed: ``(S, 3, 3)``.
        limbs: ``(S, 3)`` unit vectors along the bones, in their axes.
        up_sensor: ``(S, 3)`` the mean vertical in axes of the sensors on bones that are upright on the whole; NaN of
            others.
        first: radians, the heading that the others are counted from.

    Returns:
        The candidates, and the numbers of the sensors that no quarter turn keeps upright. They get the mountings that
        do, nearest to the one as placed and turned about the limb.
    """
    several, tilted = [], []
    for s, (R, limb, up) in enumerate(zip(R_placed, limbs, up_sensor, strict=True)):
        turned = quarter_turns(R)
        turned = turned[np.abs(turned[:, :, 2] @ limb) < OUTWARDS]
        if np.all(np.isfinite(up)):
            lean = _lean(turned, up)
            turned = turned[lean <= TILTED]
            if len(turned):  # quarter turns are rough: the vertical knows better, and perhaps than the placement
                kept = turned[[np.array_equal(one, R) for one in turned]]
                turned = np.concatenate([kept, np.stack([_righted(one, up) for one in turned])])
            else:
                tilted.append(s)
                turned = rotation_y(np.arange(TURNS) * 2 * np.pi / TURNS) @ _righted(R, up)
        several.append(np.tile(turned, (GRID, 1, 1, 1)))
    return Candidates(np.tile(_around(first), (len(R_placed), 1)), tuple(several), relative=True), tuple(tilted)


def heading_candidates(R_bone_sensor: Array, first: float) -> Candidates:
    """All headings, counted from ``first`` radians, with the one mounting ``(S, 3, 3)`` that each sensor has."""
    mountings = np.repeat(R_bone_sensor[:, None, None], GRID, axis=1)
    return Candidates(np.tile(_around(first), (len(R_bone_sensor), 1)), tuple(mountings), relative=True)


def quarter_turns(R_placed: Array) -> Array:
    """The 24 mountings ``(24, 3, 3)`` of a sensor whose axes lie as placed, in another order; as placed comes first."""
    found = [np.eye(3)]
    about_x, about_y = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)
    for turn in found:  # grows while it is gone through
        for further in (about_x @ turn, about_y @ turn):
            if not any(np.array_equal(further, one) for one in found):
                found.append(further)
    return R_placed @ np.stack(found)


def _around(first: float) -> Array:
    return first + np.linspace(0, 2 * np.pi, GRID, endpoint=False)


def _lean(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """Angles ``(...)`` radians between a bone's long axis and the vertical."""
    up_bone = R_bone_sensor @ (up_sensor / np.linalg.norm(up_sensor))
    return np.arccos(np.clip(up_bone[..., 1], -1.0, 1.0))


def _righted(R_bone_sensor: Array, up_sensor: Array) -> Array:
    """The mounting, turned the short way until the bone's long axis is vertical."""
    up_bone = R_bone_sensor @ (up_sensor / np.linalg.norm(up_sensor))
    axis = np.cross(up_bone, [0.0, 1.0, 0.0])
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        axis, length = np.array([1.0, 0.0, 0.0]), 1.0
    return exp(float(_lean(R_bone_sensor, up_sensor)) * axis / length) @ R_bone_sensor
