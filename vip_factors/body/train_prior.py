"""Training the pose prior: a Gaussian over the joint-rotation vectors of motion capture."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from vip_factors.body.joint_limits import load_joint_limits
from vip_factors.body.motion import Motion
from vip_factors.body.pose_prior import POSE_SIZE, PosePrior, joint_vector, mirror_joint_vector
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.body.train_prior_settings import PriorTraining
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array


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
