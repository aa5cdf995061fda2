"""How near the lengths of an estimated body are to the true ones, and the flexion of knees."""

from collections.abc import Collection, Mapping

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS, LIMB_ENDS, WIDTHS, lengths_of, width
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.estimate import BodyEstimate
from vip_factors.evaluate.calibration import consistency_metrics, nees
from vip_factors.evaluate.metrics import EVERYTHING, MM, Compared
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.rotations import Array, transpose

LIMBS = {name: end for name, end in LIMB_ENDS.items() if name != "foot"}
UNSURE = ("hand",)  # told, but not in the mean: skeletons end hands where they like
_ENDS = {name: (f"left_{end}", f"right_{end}") for name, end in (LIMBS | WIDTHS).items()} | {"trunk": ("neck",)}


def compared_lengths(skeleton: Skeleton) -> dict[str, float]:
    """Metres by name: limbs as the mean of both sides, widths between joints, trunk from mid hip to neck."""
    rest = skeleton.p_pelvis_joint
    hips = (rest[joint_index("left_hip")] + rest[joint_index("right_hip")]) / 2
    limbs = {
        name: (skeleton.bone_length(f"left_{end}") + skeleton.bone_length(f"right_{end}")) / 2
        for name, end in LIMBS.items()
    }
    widths = {name: width(skeleton, joint) for name, joint in WIDTHS.items()}
    return {**limbs, **widths, "trunk": float(np.linalg.norm(rest[joint_index("neck")] - hips))}


def length_table(skeleton: Skeleton, truth: Skeleton, compared: Compared = EVERYTHING) -> dict[str, dict[str, float]]:
    """Per length: ``estimate_mm``, ``truth_mm`` and ``error_mm`` (positive: found too long).

    A truth that does not know how a limb moved has its length from a table, and it is left out.
    """
    found, true = compared_lengths(skeleton), compared_lengths(truth)
    return {
        name: {
            "estimate_mm": MM * found[name],
            "truth_mm": MM * true[name],
            "error_mm": MM * (found[name] - true[name]),
        }
        for name in true
        if compared.positions(_ENDS[name])
    }


def true_lengths(truth: Skeleton) -> dict[str, float]:
    """Metres of the :data:`~vip_factors.body.lengths.LENGTHS` that are lengths in any skeleton: limbs and widths."""
    lengths = dict(zip(LENGTHS, lengths_of(truth), strict=True))
    return {name: float(lengths[name]) for name in (*LIMBS, *WIDTHS)}


def body_metrics(
    lengths: Mapping[str, Mapping[str, float]],
    body: BodyEstimate | None,
    truth: Skeleton,
) -> dict[str, Metric]:
    """Mean error of lengths (of :func:`length_table`), and whether an estimated body is honest."""
    off = [abs(row["error_mm"]) for name, row in lengths.items() if name not in UNSURE]
    table = {"length_error": Metric(float(np.mean(off)), "mm")}
    if body is None:
        return table
    return table | consistency_metrics("lengths", length_nees(body, truth, tuple(lengths)))


def length_nees(body: BodyEstimate, truth: Skeleton, lengths: Collection[str] = (*LIMBS, *WIDTHS)) -> Array:
    """NEES of the estimated limbs and widths, of those ``lengths`` that the truth knows, one by one ``(n,)``."""
    sure = [name for name in lengths if name not in UNSURE and name in body.names]
    true = {name: length for name, length in true_lengths(truth).items() if name in sure}
    places = [body.names.index(name) for name in true]
    error = np.array(list(true.values())) - body.posterior[places]
    return nees(error[:, None], body.sigma[places, None, None] ** 2)


def knee_flexion_deg(R_world_thigh: Array, R_world_shank: Array) -> Array:
    """Knee flexion ``(...)`` in degrees, of thigh and shank orientations ``(..., 3, 3)``; 0 is a straight leg.

    Grood & Suntay (1983), J. Biomech. Eng. 105: flexion is about the thigh's mediolateral axis (our x, to the left
    on both sides), internal rotation about the shank's long axis (our y), adduction about the floating axis between.
    So ``R_thigh_shank = Rx(flexion) Rz(adduction) Ry(rotation)``, and flexion takes the shank back (+x).
    """
    R_thigh_shank = transpose(R_world_thigh) @ R_world_shank
    return np.rad2deg(np.arctan2(R_thigh_shank[..., 2, 1], R_thigh_shank[..., 1, 1]))


def knee_flexion_of(motion: Motion, side: str) -> Array:
    """Knee flexion ``(T,)`` in degrees of the ``"left"`` or ``"right"`` knee of a motion."""
    R_world_bone = motion.state.R_world_bone
    return knee_flexion_deg(R_world_bone[:, joint_index(f"{side}_hip")], R_world_bone[:, joint_index(f"{side}_knee")])


def rmse(estimate: Array, truth: Array) -> float:
    """Root mean square difference, NaN samples left out."""
    return float(np.sqrt(np.nanmean((np.asarray(estimate) - np.asarray(truth)) ** 2)))
