"""Training the pose prior: a Gaussian over the joint-rotation vectors of motion capture."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.joint_priors import POSE_SIZE, PosePrior, joint_vector, load_joint_limits, mirror_joint_vector
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

# Clips of the CMU database that the pose prior is never trained on, so that simulated trials on them are fair: chosen
# from the descriptions in the database's index and from the heights of pelvis and hands. Those under "low" come nearest
# to the floor of all in subjects 2-12 (pelvis down to 0.36 m, hands down to 0.15 m) that the conversion to BVH has left
# whole: the dancer's (subject 05) flip their ankles.
HELD_OUT_CLIPS: dict[str, tuple[str, ...]] = {
    "walking": ("07_01", "08_03", "12_02"),
    "sport": ("06_12", "10_05", "11_01"),  # dribbling with crossovers, kicking a football
    "acting": ("02_05", "02_07", "02_10"),  # punching, swordplay, washing oneself
    "low": ("02_04", "02_06"),  # jump and balance with deep knee bends, scooping from the floor
}

# Conversions (BVH) gone wrong: the pelvis swings by 20 cm below the floor while hips bend by 80° in a plain walk.
DAMAGED_CLIPS = ("07_12", "09_10")


def held_out_names() -> tuple[str, ...]:
    """All held-out clips, by the stem of their files."""
    return tuple(clip for clips in HELD_OUT_CLIPS.values() for clip in clips)


@dataclass(frozen=True)
class PriorTraining:
    """How frames become a Gaussian."""

    rate: float = 4.0  # Hz: poses a quarter of a second apart are nearly independent in a walk
    longest_clip: float = 10.0  # s: a longer clip counts no more than this, lest one long take set the prior
    minimum_sigma_deg: float = 5.0  # added in quadrature: rest poses differ by as much between sources
    minimum_toe_sigma_deg: float = 10.0  # few sources move the toes, which bend at every step
    minimum_collar_sigma_deg: float = 8.0  # nor the clavicles, which rise with a lifted arm by up to 30 degrees
    # Forearms turn by ±80°, in the wrist of most sources; with a bent elbow that shows in the elbow's x and z. Which
    # way the elbow bends is the hinge factor's to say.
    minimum_pronation_sigma_deg: float = 30.0
    shrinkage: float = 0.1  # correlations shrink by this, so that no combination is forbidden for not having been seen
    largest_violation_deg: float = 15.0  # of a joint limit: a frame beyond is a conversion gone wrong, and is dropped


def train_pose_prior(motions: Iterable[Motion], settings: PriorTraining | None = None) -> PosePrior:
    """The Gaussian of these motions and their mirror images.

    Subjects count alike: motions whose names share what stands before the first underscore (``07_01``, ``07_02``)
    are taken for one subject, so that a person who only walks, in many takes, does not turn the prior into a walk.

    Raises:
        InputError: if there are too few frames.
    """
    settings = settings or PriorTraining()
    limits = load_joint_limits()
    samples: dict[str, list[Array]] = defaultdict(list)
    weights: dict[str, list[Array]] = defaultdict(list)
    clips = 0
    for motion in motions:
        step = max(1, round(motion.rate / settings.rate))
        x = joint_vector(motion.R_parent_child[::step])
        violation = np.max(np.abs(limits.violation(x)), axis=1, initial=0.0)
        x = x[violation < np.radians(settings.largest_violation_deg)]
        if not len(x):
            continue
        subject = motion.name.partition("_")[0]
        samples[subject].append(x)
        weights[subject].append(np.full(len(x), min(1.0, settings.longest_clip * settings.rate / len(x))))
        clips += 1
    frames = sum(len(x) for group in samples.values() for x in group)
    if frames < POSE_SIZE:
        raise InputError(
            f"pose prior: {frames} usable frames at {settings.rate:g} Hz: expected at least {POSE_SIZE}, better "
            "thousands; give more motions"
        )
    x = np.concatenate([np.concatenate(group) for group in samples.values()])
    w = np.concatenate([np.concatenate(group) / np.sum(np.concatenate(group)) for group in weights.values()])
    mean, covariance = _moments(np.concatenate([x, mirror_joint_vector(x)]), np.concatenate([w, w]))
    covariance = _regularised(covariance, settings)
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    provenance = (
        f"{frames} frames at {settings.rate:g} Hz and their mirror images, {clips} clips, {len(samples)} subjects"
    )
    return PosePrior(mean, whitening, provenance)


def _moments(x: Array, weights: Array) -> tuple[Array, Array]:
    mean = np.average(x, axis=0, weights=weights)
    return mean, np.cov(x, rowvar=False, aweights=weights)


def _regularised(covariance: Array, settings: PriorTraining) -> Array:
    """Correlations shrunk, and no coordinate surer than the minimum."""
    shrunk = (1 - settings.shrinkage) * covariance
    np.fill_diagonal(shrunk, np.diagonal(covariance))
    floor = np.full((len(JOINT_NAMES) - 1, 3), settings.minimum_sigma_deg)
    for ending, sigma in (("_foot", settings.minimum_toe_sigma_deg), ("_collar", settings.minimum_collar_sigma_deg)):
        floor[[joint - 1 for joint, name in enumerate(JOINT_NAMES) if name.endswith(ending)]] = sigma
    for joint in (JOINT_NAMES.index("left_elbow") - 1, JOINT_NAMES.index("right_elbow") - 1):
        floor[joint, [0, 2]] = settings.minimum_pronation_sigma_deg
    return shrunk + np.diag(np.radians(floor.ravel()) ** 2)


def save_pose_prior(prior: PosePrior, path: str | Path) -> None:
    """Write a prior as npz (single precision: a tenth of a milliradian is nothing here)."""
    with Path(path).open("wb") as file:
        np.savez_compressed(
            file,
            mean=prior.mean.astype(np.float32),
            whitening=prior.whitening.astype(np.float32),
            provenance=np.array(prior.provenance),
        )
