"""Likely body of a person given stature, sex, mass or some lengths, with its uncertainty.

The prior over bodies (:class:`BodyGaussian`) is a joint Gaussian over mass and lengths. Known quantities condition it:
with a given stature, long measured legs shorten the trunk. :class:`LengthPrior` is the uncertainty of a body that was
estimated from an earlier recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vip_factors.body.lengths import BODY_LENGTHS, LENGTHS, LIMB_ENDS, STATURE, BodyVariation, skeleton_of_lengths
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

STATURE_RANGE_M = (0.8, 2.6)  # from a small child to the tallest adults measured
LENGTH_SIGMA_M = 0.007  # of a tape, and of finding the joints' axes
KNOWN_RANGE_SIGMAS = 3.0  # of stature, within which the prior is valid
WIDENING = 0.25  # relative increase of standard deviations for every sigma of stature beyond that range
SHIPPED_BODY_PRIOR = Path(__file__).parent.parent / "data" / "body_prior.npz"
GROUPS = ("male", "female", "both")
VARIABLES = ("log mass", *BODY_LENGTHS)
SIZE = len(VARIABLES)
STATURE_ROW = np.concatenate([[0.0], STATURE])  # stature as a linear function of the variables


@dataclass(frozen=True)
class Observation:
    """Measured value of a linear combination ``row`` ``(22,)`` of the :data:`VARIABLES`, with standard deviation."""

    row: Array
    value: float
    sigma: float


@dataclass(frozen=True)
class BodyGaussian:
    """Gaussian over the :data:`VARIABLES`, logarithm of the mass (kg) and lengths (m): mean ``(22,)``, covariance."""

    mean: Array
    covariance: Array

    @property
    def stature(self) -> tuple[float, float]:
        """Mean and standard deviation of stature in metres."""
        return float(STATURE_ROW @ self.mean), float(np.sqrt(STATURE_ROW @ self.covariance @ STATURE_ROW))

    def widened(self, factor: float) -> "BodyGaussian":
        """Multiply every standard deviation by ``factor``."""
        return BodyGaussian(self.mean, factor**2 * self.covariance)

    def given(self, observations: Sequence[Observation]) -> "BodyGaussian":
        """Condition on independent observations."""
        if not observations:
            return self
        rows = np.stack([observation.row for observation in observations])
        missed = np.array([observation.value for observation in observations]) - rows @ self.mean
        noise = np.diag([observation.sigma**2 for observation in observations])
        across = self.covariance @ rows.T
        gain = np.linalg.solve(rows @ across + noise, across.T).T
        # Joseph form: stays positive definite
        reduction = np.eye(SIZE) - gain @ rows
        covariance = reduction @ self.covariance @ reduction.T + gain @ noise @ gain.T
        return BodyGaussian(self.mean + gain @ missed, covariance)


@dataclass(frozen=True)
class BodyPrior:
    """Gaussians over men, women and both together (:data:`GROUPS`); ``provenance``: data and number of people."""

    groups: Mapping[str, BodyGaussian]
    provenance: str = "unknown"

    def of(self, sex: str | None) -> BodyGaussian:
        """Return the Gaussian for ``"male"``, ``"female"`` or, if None, both together.

        Raises:
            InputError: for anything else.
        """
        if sex not in ("male", "female", None):
            raise InputError(f"sex '{sex}': expected 'male' or 'female'")
        return self.groups[sex or "both"]


@cache
def load_body_prior(path: Path = SHIPPED_BODY_PRIOR) -> BodyPrior:
    """Load a trained prior over bodies, by default the one shipped with the package."""
    with np.load(path) as file:
        groups = {name: BodyGaussian(file[f"{name}_mean"], file[f"{name}_covariance"]) for name in GROUPS}
        return BodyPrior(groups, str(file["provenance"]))


@dataclass(frozen=True)
class LikelyBody:
    """Likeliest skeleton of a person, the prior over its changes, and a sentence about doubts or an empty string."""

    skeleton: Skeleton
    variation: BodyVariation
    note: str = ""


def likely_body(
    stature_m: float | None = None,
    sex: str | None = None,
    segment_lengths_m: Mapping[str, float] | None = None,
    mass_kg: float | None = None,
) -> LikelyBody:
    """Estimate the body of a person.

    People outside the prior's range (:data:`KNOWN_RANGE_SIGMAS`) have the proportions of its limit, with larger
    uncertainty; children have shorter legs than that.

    Args:
        stature_m: height in metres, without shoes; unknown if None.
        sex: ``"male"``, ``"female"`` or None.
        segment_lengths_m: measured lengths in metres, to :data:`LENGTH_SIGMA_M`: ``thigh``, ``shank``, ``foot`` (ankle
            to ball), ``upper_arm``, ``forearm``, ``hand`` (wrist to knuckles), each with prefix ``left_``/``right_`` if
            the sides differ, ``hip_width``, ``shoulder_width`` (between joint centres) and ``trunk`` (mid hip to neck).
        mass_kg: mass in kilograms; unknown if None.

    Raises:
        InputError: for an implausible stature, mass or length, or an unknown segment or sex.
    """
    mass_sigma = 0.03  # relative: clothes, meals, scales
    stature_sigma_m = 0.010  # of a tape, and of the change over a day
    mass_range_kg = (8.0, 400.0)
    low, high = STATURE_RANGE_M
    if stature_m is not None and not low <= stature_m <= high:
        hint = f"; {stature_m:g} looks like centimetres, give {stature_m / 100:g}" if 80 <= stature_m <= 260 else ""
        raise InputError(f"stature {stature_m:g} m: expected between {low} and {high} metres{hint}")
    if mass_kg is not None and not mass_range_kg[0] <= mass_kg <= mass_range_kg[1]:
        raise InputError(f"mass {mass_kg:g} kg: expected between {mass_range_kg[0]:g} and {mass_range_kg[1]:g}")
    adults = load_body_prior().of(sex)
    measured = dict(segment_lengths_m or {})
    lengths, halves = measured_lengths(measured)
    scale, excess_sigmas = _scale(adults, stature_m)
    observations = [
        Observation(np.concatenate([[0.0], row]), metres / scale, LENGTH_SIGMA_M / scale) for row, metres in lengths
    ]
    if stature_m is not None:
        observations.append(Observation(STATURE_ROW, stature_m / scale, stature_sigma_m / scale))
    if mass_kg is not None:
        mass = float(np.log(mass_kg / scale**2))  # same body mass index
        observations.append(Observation(np.eye(len(VARIABLES))[0], mass, mass_sigma))
    posterior = adults.widened(1 + WIDENING * excess_sigmas).given(observations)
    provenance = [
        "stature unknown" if stature_m is None else f"stature {stature_m:.2f} m",
        *([sex] if sex else []),
        *([f"{mass_kg:g} kg"] if mass_kg is not None else []),
        *([f"measured {', '.join(sorted(measured))}"] if measured else []),
    ]
    count = len(LENGTHS)
    skeleton = skeleton_of_lengths(scale * posterior.mean[1:], f"{', '.join(provenance)}; prior over bodies")
    covariance = scale**2 * posterior.covariance[1 : count + 1, 1 : count + 1]
    variation = BodyVariation.about_mean(skeleton, covariance)
    offsets = skeleton.p_parent_joint.copy()
    for joint, metres in halves.items():  # limbs whose sides differ
        along = offsets[joint_index(joint)]
        offsets[joint_index(joint)] = along * (1 + metres / np.linalg.norm(along))
    note = _note(stature_m, excess_sigmas, *adults.stature)
    return LikelyBody(Skeleton(offsets, skeleton.landmarks, skeleton.source), variation, note)


def skeleton_from_stature(
    stature_m: float | None,
    sex: str | None = None,
    segment_lengths_m: Mapping[str, float] | None = None,
    mass_kg: float | None = None,
) -> Skeleton:
    """Likeliest skeleton of a person; see :func:`likely_body`.

    Raises:
        InputError: for an implausible stature, mass or length, or an unknown segment or sex.
    """
    return likely_body(stature_m, sex, segment_lengths_m, mass_kg).skeleton


def _scale(adults: BodyGaussian, stature_m: float | None) -> tuple[float, float]:
    """Scale relative to the prior's nearest stature, and the distance in standard deviations."""
    if stature_m is None:
        return 1.0, 0.0
    mean, sigma = adults.stature
    nearest = float(np.clip(stature_m, mean - KNOWN_RANGE_SIGMAS * sigma, mean + KNOWN_RANGE_SIGMAS * sigma))
    return stature_m / nearest, abs(stature_m - nearest) / sigma


def _note(stature_m: float | None, excess_sigmas: float, mean: float, sigma: float) -> str:
    if stature_m is None:
        return f"stature unknown: an adult's is assumed, {mean:.2f} ± {sigma:.2f} m, and all lengths follow from it"
    if excess_sigmas > 0:
        children = "; children have shorter legs" if stature_m < mean else ""
        return (
            f"a stature of {stature_m:.2f} m is {excess_sigmas + KNOWN_RANGE_SIGMAS:.1f} standard deviations from the "
            f"mean of the adults whose proportions are known, {mean:.2f} m: lengths are less certain{children}"
        )
    return ""


# Measured lengths without sides, as sums of the body's lengths.
WHOLE = {
    "hip_width": {"hip width": 1.0},
    "shoulder_width": {"shoulder width": 1.0},
    "trunk": {"trunk": 1.0, "hip height": -1.0},
}


def measured_lengths(measured: Mapping[str, float]) -> tuple[list[tuple[Array, float]], dict[str, float]]:
    """Convert measured lengths to observations of a symmetric body and to differences of its sides.

    Returns:
        Rows ``(21,)`` over the body's lengths with their values in metres; and by the joint at a limb's end the limb's
        excess over the mean of both sides, metres.

    Raises:
        InputError: for an implausible length or an unknown segment.
    """
    length_range_m = (0.02, 1.2)
    sides: dict[str, dict[str, float]] = {}
    rows = []
    low, high = length_range_m
    for name, metres in sorted(measured.items(), key=lambda pair: pair[0].startswith(("left_", "right_"))):
        if not low <= metres <= high:
            raise InputError(f"segment length {name} = {metres:g} m: expected metres, between {low:g} and {high:g}")
        if name in WHOLE:
            rows.append((np.array([WHOLE[name].get(length, 0.0) for length in BODY_LENGTHS]), metres))
            continue
        side, _, limb = name.partition("_") if name.startswith(("left_", "right_")) else ("", "", name)
        limb = limb.replace("_", " ")
        if limb not in LIMB_ENDS:
            segments = ", ".join([*LIMB_ENDS, *WHOLE]).replace(" ", "_").replace(",_", ", ")
            raise InputError(
                f"unknown segment '{name}': expected one of {segments}, with left_ or right_ before a limb's"
            )
        # a length of one side comes after that of both and overrides it
        sides.setdefault(limb, {}).update({side_name: metres for side_name in ([side] if side else ["left", "right"])})
    halves: dict[str, float] = {}
    for limb, lengths in sides.items():
        mean = float(np.mean(list(lengths.values())))
        rows.append((np.array([float(length == limb) for length in BODY_LENGTHS]), mean))
        halves |= {f"{side}_{LIMB_ENDS[limb]}": metres - mean for side, metres in lengths.items()}
    return rows, halves


# m, lower bound for any combination of lengths: soft tissue and a detector's bias are alike in every frame, so that the
# estimated covariance is too small
LEAST_SIGMA = 0.003


@dataclass(frozen=True)
class LengthPrior:
    """Gaussian over changes of a skeleton's lengths.

    Attributes:
        names: ``B`` of :data:`~vip_factors.body.lengths.LENGTHS`; names of other versions are ignored.
        covariance: ``(B, B)`` m².
    """

    names: tuple[str, ...]
    covariance: Array

    def __post_init__(self) -> None:
        covariance, count = np.asarray(self.covariance, dtype=float), len(self.names)
        if covariance.shape != (count, count) or len(set(self.names)) != count:
            raise InputError(f"covariance of {count} lengths has shape {covariance.shape}: expected ({count}, {count})")
        symmetric = np.all(np.isfinite(covariance)) and np.allclose(covariance, covariance.T, atol=1e-9)
        if not symmetric or np.any(np.diag(covariance) < 0):
            raise InputError("covariance of lengths: expected finite numbers, symmetric, with variances of 0 or more")
        object.__setattr__(self, "covariance", covariance)

    def variation(self, skeleton: Skeleton) -> BodyVariation:
        """Make the prior over changes of ``skeleton``; unnamed lengths have the covariance of the population."""
        joint = likely_body(skeleton.stature).variation.covariance
        pairs = [(LENGTHS.index(name), place) for place, name in enumerate(self.names) if name in LENGTHS]
        if pairs:
            rows, places = (np.array(column) for column in zip(*pairs, strict=True))
            joint[rows, :] = joint[:, rows] = 0.0
            joint[np.ix_(rows, rows)] = self.covariance[np.ix_(places, places)]
        values, vectors = np.linalg.eigh(joint)
        covariance = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return BodyVariation.about_mean(skeleton, covariance)
