"""Training the prior over bodies: from what a tape measures on the skin to lengths between joint centres.

One definition of each joint centre serves both sexes; how these differ, the survey tells. (Published tables differ by
sex in their definitions too: de Leva's female thigh is 0.212 of stature, real women's is 0.236–0.261 as men's is.)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import VARIABLES, BodyGaussian, BodyPrior
from vip_factors.body.lengths import (
    BALL_HEIGHT,
    FOOT_ANKLE,
    FOOT_BALL,
    HAND_KNUCKLES,
    HEAD_JOINT,
    NECK_DEPTH,
    SHOULDER_DEPTH,
    TRUNK,
)
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

# Columns of ANSUR II that are read, and mass and stature.
DIMENSIONS = (
    "stature", "weightkg", "acromialheight", "acromionradialelength", "radialestylionlength", "handlength",
    "biacromialbreadth", "bicristalbreadth", "trochanterionheight", "lateralfemoralepicondyleheight",
    "lateralmalleolusheight", "cervicaleheight", "footlength",
)  # fmt: skip
LEAST_PEOPLE = 10 * len(VARIABLES)


@dataclass(frozen=True)
class BodyTraining:
    """How dimensions of the skin become lengths between joint centres; offsets are fractions of stature."""

    # Trochanterion is the trochanter's upper edge, the head's centre somewhat higher: thighs become 0.243 of stature
    # (de Leva's and Dumas's men 0.243 and 0.244, optical skeletons 0.236–0.261).
    hip_over_trochanterion: float = 0.010
    # The landmark is where the malleolus stands out most; the ankle's axis passes half a centimetre lower.
    ankle_below_malleolus: float = 0.003
    # The humeral head's centre under the acromion: mid hip to mid shoulder becomes 0.264 (optical 0.252–0.264).
    shoulder_below_acromion: float = 0.030
    # From the spinous process of C7 to where the neck turns on its body: 0.848 of men's stature, as Winter has it.
    neck_below_cervicale: float = 0.016
    # Centre to centre over acromion to radiale, which begins above and ends below: 0.158 of stature (de Leva
    # 0.159–0.162, Dumas 0.151–0.153, optical 0.145–0.164).
    upper_arm: float = 0.83
    # Radiale lies below the elbow's axis, stylion beyond the wrist's: 0.153 of stature (de Leva 0.152–0.154, Dumas
    # 0.153–0.160).
    forearm: float = 1.02
    shoulder_width: float = 0.86  # of biacromial breadth, acromia overhang: 0.198 of stature (0.195–0.205)
    hip_width: float = 0.617  # of bicristal breadth: 0.100 of stature (Seidel et al. 1995, from the anterior spines)
    # What no tape tells: optical hips, shoulders and necks sit 2–5 cm from where tables put them, all axes together.
    centre_sigma_m: float = 0.018
    # Of the pelvis, hips, neck and head along the body: thighs of optical skeletons (0.236–0.261 of stature) scatter no
    # more than the survey's own, and a looser trunk takes up what detectors call a hip.
    height_sigma_m: float = 0.010
    # Of knees, ankles, elbows, wrists and balls along the limb, whose axes a finger finds: de Leva's two ends of the
    # shank, malleolus and ankle, lie 6 mm apart.
    hinge_sigma_m: float = 0.005
    knuckle_sigma_m: float = 0.005
    # What is taken for a straight limb: rest poses of skeletons, and people asked for a T-pose, have elbows bent by
    # 5–20° and knees by 3–8°; carrying angles differ by 5°.
    wrist_depth_sigma_m: float = 0.045
    wrist_height_sigma_m: float = 0.022
    ankle_depth_sigma_m: float = 0.035


def train_body_prior(dimensions: Mapping[str, Mapping[str, Array]], settings: BodyTraining | None = None) -> BodyPrior:
    """The Gaussians of people measured by tape.

    Args:
        dimensions: of ``"male"`` and ``"female"``, by name of :data:`DIMENSIONS`, ``(n,)`` each: metres, and
            ``weightkg`` in kilograms.
        settings: the way to joint centres.

    Raises:
        InputError: if there are too few people.
    """
    settings = settings or BodyTraining()
    unsure = centre_covariance(settings)
    mean, covariance = {}, {}
    for sex in ("male", "female"):
        people = body_variables(dimensions[sex], settings)
        if len(people) < LEAST_PEOPLE:
            raise InputError(f"body prior: {len(people)} people ({sex}): expected {LEAST_PEOPLE} or more")
        mean[sex], covariance[sex] = people.mean(axis=0), np.cov(people, rowvar=False)
    # Both together: as many women as men.
    apart = (mean["male"] - mean["female"]) / 2
    mean["both"] = (mean["male"] + mean["female"]) / 2
    covariance["both"] = (covariance["male"] + covariance["female"]) / 2 + np.outer(apart, apart)
    groups = {name: BodyGaussian(mean[name], covariance[name] + unsure) for name in mean}
    counts = ", ".join(f"{len(dimensions[sex]['stature'])} {sex}" for sex in ("male", "female"))
    return BodyPrior(groups, f"{counts}; joint centres by offsets, uncertain by {settings.centre_sigma_m:g} m an axis")


def body_variables(dimensions: Mapping[str, Array], settings: BodyTraining) -> Array:
    """The variables ``(n, 22)`` of people, :data:`~vip_factors.body.anthropometry.VARIABLES`, from their dimensions."""
    d = {name: np.asarray(dimensions[name], float) for name in DIMENSIONS}
    stature = d["stature"]
    ankle = d["lateralmalleolusheight"] - settings.ankle_below_malleolus * stature
    knee = d["lateralfemoralepicondyleheight"]
    hip = d["trochanterionheight"] + settings.hip_over_trochanterion * stature
    neck = d["cervicaleheight"] - settings.neck_below_cervicale * stature
    shoulder = d["acromialheight"] - settings.shoulder_below_acromion * stature
    low, high = TRUNK["pelvis"][0], TRUNK["spine3"][0]
    x = {
        "log mass": np.log(d["weightkg"]),
        "hip width": settings.hip_width * d["bicristalbreadth"],
        "hip height": -low * (neck - hip),
        "hip depth": 0.0 * stature,
        "trunk": (1 - low) * (neck - hip),
        "neck": HEAD_JOINT * (stature - neck),
        "neck height": 0.0 * stature,
        "neck depth": NECK_DEPTH * stature,
        "shoulder width": settings.shoulder_width * d["biacromialbreadth"],
        "shoulder height": shoulder - hip - high * (neck - hip),
        "shoulder depth": SHOULDER_DEPTH * stature,
        "upper arm": settings.upper_arm * d["acromionradialelength"],
        "forearm": settings.forearm * d["radialestylionlength"],
        "wrist height": 0.0 * stature,
        "wrist depth": 0.0 * stature,
        "hand": HAND_KNUCKLES * d["handlength"],
        "thigh": hip - knee,
        "shank": knee - ankle,
        "ankle depth": 0.0 * stature,
        "foot": np.hypot((FOOT_BALL - FOOT_ANKLE) * d["footlength"], ankle - BALL_HEIGHT * stature),
        "ankle height": ankle,
        "head top": (1 - HEAD_JOINT) * (stature - neck),
    }
    return np.stack([x[name] for name in VARIABLES], axis=1)


def centre_covariance(settings: BodyTraining) -> Array:
    """What the unknown places of joint centres add to the covariance, ``(22, 22)``; none of it changes the stature.

    A centre that lies higher takes from the length above what it gives to the one below.
    """
    wide, high, near = settings.centre_sigma_m, settings.height_sigma_m, settings.hinge_sigma_m
    moves: list[tuple[float, dict[str, float]]] = [
        (high, {"hip height": -1, "trunk": -1}),  # the pelvis joint, up
        (high, {"hip height": 1, "thigh": 1}),  # hips: up, apart, forward
        (wide, {"hip width": 2}),
        (wide, {"hip depth": 1}),
        (wide, {"neck height": 1, "neck": -1}),  # neck: up, forward
        (wide, {"neck depth": 1}),
        (high, {"neck": 1, "head top": -1}),  # head, up
        (wide, {"shoulder height": 1}),  # shoulders: up, apart, forward
        (wide, {"shoulder width": 2}),
        (wide, {"shoulder depth": 1}),
        (near, {"upper arm": 1}),  # shoulders along the arm, elbows, wrists, knuckles
        (near, {"upper arm": 1, "forearm": -1}),
        (near, {"forearm": 1, "hand": -1}),
        (settings.knuckle_sigma_m, {"hand": 1}),
        (near, {"thigh": -1, "shank": 1}),  # knees, ankles, balls
        (near, {"shank": -1, "ankle height": 1}),
        (near, {"foot": 1}),
        (settings.wrist_height_sigma_m, {"wrist height": 1}),  # what is taken for straight
        (settings.wrist_depth_sigma_m, {"wrist depth": 1}),
        (settings.ankle_depth_sigma_m, {"ankle depth": 1}),
    ]
    columns = np.array([[sigma * move.get(name, 0.0) for sigma, move in moves] for name in VARIABLES])
    return columns @ columns.T


def save_body_prior(prior: BodyPrior, path: str | Path) -> None:
    """Write a prior over bodies as npz."""
    arrays: dict[str, Any] = {"variables": np.array(VARIABLES), "provenance": np.array(prior.provenance)}
    for name, group in prior.groups.items():
        arrays |= {f"{name}_mean": group.mean, f"{name}_covariance": group.covariance}
    with Path(path).open("wb") as file:
        np.savez_compressed(file, **arrays)
