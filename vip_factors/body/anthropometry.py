"""The body of a person of whom stature, sex, mass or some lengths are known: the likeliest, and how others differ.

What is known enters as observations of the prior over bodies (:class:`BodyGaussian`) and moves all that
it does not name: long legs that were measured shorten the trunk, since the stature is what it is. Of a body estimated
from an earlier recording, :class:`LengthPrior` says how far each length may still be off.

That prior is a Gaussian: how heavy people are and how long each of their lengths, and which go together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vip_factors.body.lengths import BODY_LENGTHS, LENGTHS, LIMB_ENDS, STATURE, BodyVariation, skeleton_of_lengths
from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

STATURE_RANGE_M = (0.8, 2.6)  # from a small child to the tallest adults measured
# A tape between two landmarks is read to 5 mm, and a finger finds each end of a joint's axis as well.
LENGTH_SIGMA_M = 0.007
FEW_SIGMAS = 3.0  # of stature: so far the prior knows people
# Of all standard deviations, for every standard deviation of stature beyond: at 1.1 m a thigh and a shank have 3 cm
# each, about as much as children's are shorter.
WIDENING = 0.25
SHIPPED_BODY_PRIOR = Path(__file__).parent.parent / "data" / "body_prior.npz"
GROUPS = ("male", "female", "both")
VARIABLES = ("log mass", *BODY_LENGTHS)
SIZE = len(VARIABLES)
STATURE_ROW = np.concatenate([[0.0], STATURE])  # of the variables: stature is a sum of lengths


@dataclass(frozen=True)
class Observation:
    """A number that a linear combination ``row`` ``(22,)`` of the :data:`VARIABLES` is known by, with its standard
    deviation.
    """

    row: Array
    value: float
    sigma: float


@dataclass(frozen=True)
class BodyGaussian:
    """A Gaussian over the :data:`VARIABLES`, the mass's logarithm (kg) and the body's lengths in metres: mean ``(22,)``
    and covariance ``(22, 22)``.
    """

    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        mean, covariance = np.asarray(self.mean, float), np.asarray(self.covariance, float)
        if mean.shape != (SIZE,) or covariance.shape != (SIZE, SIZE):
            raise InputError(
                f"body prior: mean {mean.shape} and covariance {covariance.shape}: expected {SIZE} variables"
            )
        if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance))):
            raise InputError("body prior: mean or covariance holds a number that is not finite")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    @property
    def stature(self) -> tuple[float, float]:
        """Mean and standard deviation of stature in metres."""
        return float(STATURE_ROW @ self.mean), float(np.sqrt(STATURE_ROW @ self.covariance @ STATURE_ROW))

    def widened(self, factor: float) -> "BodyGaussian":
        """The same with every standard deviation ``factor`` times as large."""
        return BodyGaussian(self.mean, factor**2 * self.covariance)

    def given(self, observations: Sequence[Observation]) -> "BodyGaussian":
        """The Gaussian conditional on independent observations."""
        if not observations:
            return self
        rows = np.stack([one.row for one in observations])
        missed = np.array([one.value for one in observations]) - rows @ self.mean
        noise = np.diag([one.sigma**2 for one in observations])
        across = self.covariance @ rows.T
        gain = np.linalg.solve(rows @ across + noise, across.T).T
        # Joseph's form, which stays positive definite.
        kept = np.eye(SIZE) - gain @ rows
        covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        return BodyGaussian(self.mean + gain @ missed, covariance)


@dataclass(frozen=True)
class BodyPrior:
    """Gaussians over men, women and both together, by name (:data:`GROUPS`); provenance is one line: data, number of
    people.
    """

    groups: Mapping[str, BodyGaussian]
    provenance: str = "unknown"

    def of(self, sex: str | None) -> BodyGaussian:
        """The Gaussian of ``"male"``, ``"female"`` or, for None, both together.

        Raises:
            InputError: for anything else.
        """
        if sex not in ("male", "female", None):
            raise InputError(f"sex '{sex}': expected 'male', 'female' or nothing")
        return self.groups[sex or "both"]


@cache
def _read(path: Path) -> BodyPrior:
    file = read_npz(path, "not a prior over bodies")
    try:
        if tuple(file["variables"].ravel().tolist()) != VARIABLES:
            raise ValueError("other variables")
        groups = {name: BodyGaussian(file[f"{name}_mean"], file[f"{name}_covariance"]) for name in GROUPS}
        return BodyPrior(groups, str(file["provenance"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"{path}: not a prior over bodies ({error}); expected an npz with a mean ({SIZE},) and a covariance "
            f"({SIZE}, {SIZE}) of {', '.join(GROUPS)}, the variables' names and provenance, as the "
            "shipped file has them"
        ) from error


def load_body_prior(path: str | Path | None = None) -> BodyPrior:
    """A trained prior over bodies; the one shipped with the package if no path is given.

    Raises:
        FileFormatError: if the file is not one.
    """
    return _read(Path(path) if path is not None else SHIPPED_BODY_PRIOR)


@dataclass(frozen=True)
class LikelyBody:
    """A body as far as it is known: the likeliest skeleton, how others of whom the same is known differ from it, and a
    sentence on what is doubtful, or nothing.
    """

    skeleton: Skeleton
    variation: BodyVariation
    note: str = ""


def likely_body(
    stature_m: float | None = None,
    sex: str | None = None,
    segment_lengths_m: Mapping[str, float] | None = None,
    mass_kg: float | None = None,
) -> LikelyBody:
    """The body of a person of whom this is known.

    People smaller or taller than the prior's (:data:`FEW_SIGMAS`) have the proportions of its last, with everything
    less certain; children's legs are shorter than that.

    Args:
        stature_m: height in metres, without shoes; unknown if None.
        sex: ``"male"``, ``"female"`` or None.
        segment_lengths_m: measured lengths in metres, to :data:`LENGTH_SIGMA_M`: ``thigh``, ``shank``, ``foot`` (ankle
            to ball), ``upper_arm``, ``forearm``, ``hand`` (wrist to knuckles), each with ``left_``/``right_`` before it
            if the sides differ, ``hip_width``, ``shoulder_width`` (between joint centres) and ``trunk`` (mid hip
            to neck).
        mass_kg: mass in kilograms; unknown if None.

    Raises:
        InputError: for an implausible stature, mass or length, or an unknown segment or sex.
    """
    mass_sigma = 0.03  # of the mass: clothes, meals, scales
    stature_sigma_m = 0.010  # a tape's, with the centimetre that people lose from morning to evening
    mass_range_kg = (8.0, 400.0)
    if stature_m is not None:
        _check_stature(stature_m)
    if mass_kg is not None and not mass_range_kg[0] <= mass_kg <= mass_range_kg[1]:
        raise InputError(f"mass {mass_kg:g} kg: expected between {mass_range_kg[0]:g} and {mass_range_kg[1]:g}")
    adults = load_body_prior().of(sex)
    measured = dict(segment_lengths_m or {})
    lengths, halves = measured_lengths(measured)
    scale, beyond = _scale(adults, stature_m)
    observations = [
        Observation(np.concatenate([[0.0], row]), metres / scale, LENGTH_SIGMA_M / scale) for row, metres in lengths
    ]
    if stature_m is not None:
        observations.append(Observation(STATURE_ROW, stature_m / scale, stature_sigma_m / scale))
    if mass_kg is not None:
        mass = float(np.log(mass_kg / scale**2))  # as fat or lean for the stature
        observations.append(Observation(np.eye(len(VARIABLES))[0], mass, mass_sigma))
    found = adults.widened(1 + WIDENING * beyond).given(observations)
    known = [
        "stature unknown" if stature_m is None else f"stature {stature_m:.2f} m",
        *([sex] if sex else []),
        *([f"{mass_kg:g} kg"] if mass_kg is not None else []),
        *([f"measured {', '.join(sorted(measured))}"] if measured else []),
    ]
    moved = len(LENGTHS)
    skeleton = skeleton_of_lengths(scale * found.mean[1:], f"{', '.join(known)}; prior over bodies")
    covariance = scale**2 * found.covariance[1 : moved + 1, 1 : moved + 1]
    variation = BodyVariation.about_mean(skeleton, covariance)
    note = _note(stature_m, beyond, *adults.stature)
    return LikelyBody(apply_sides(skeleton, halves), variation, note)


def skeleton_from_stature(
    stature_m: float | None,
    sex: str | None = None,
    segment_lengths_m: Mapping[str, float] | None = None,
    mass_kg: float | None = None,
) -> Skeleton:
    """The likeliest skeleton of a person, as :func:`likely_body` gives it.

    Raises:
        InputError: for an implausible stature, mass or length, or an unknown segment or sex.
    """
    return likely_body(stature_m, sex, segment_lengths_m, mass_kg).skeleton


def _check_stature(stature_m: float) -> None:
    low, high = STATURE_RANGE_M
    if low <= stature_m <= high:
        return
    centimetres = f"; {stature_m:g} looks like centimetres, give {stature_m / 100:g}" if 80 <= stature_m <= 260 else ""
    raise InputError(f"stature {stature_m:g} m: expected between {low} and {high} metres{centimetres}")


def _scale(adults: BodyGaussian, stature_m: float | None) -> tuple[float, float]:
    """Size over that of the prior's nearest person, and how many standard deviations lie between them."""
    if stature_m is None:
        return 1.0, 0.0
    mean, sigma = adults.stature
    nearest = float(np.clip(stature_m, mean - FEW_SIGMAS * sigma, mean + FEW_SIGMAS * sigma))
    return stature_m / nearest, abs(stature_m - nearest) / sigma


def _note(stature_m: float | None, beyond: float, mean: float, sigma: float) -> str:
    if stature_m is None:
        return f"stature unknown: an adult's, {mean:.2f} ± {sigma:.2f} m, stands for it, and every length follows"
    if beyond > 0:
        children = "; children have shorter legs" if stature_m < mean else ""
        return (
            f"a stature of {stature_m:.2f} m is {beyond + FEW_SIGMAS:.1f} standard deviations from the mean of the "
            f"adults whose proportions are known, {mean:.2f} m: these are scaled, and held for less certain{children}"
        )
    return ""


# What is measured without sides, as a sum of the body's lengths.
WHOLE = {
    "hip_width": {"hip width": 1.0},
    "shoulder_width": {"shoulder width": 1.0},
    "trunk": {"trunk": 1.0, "hip height": -1.0},
}


def measured_lengths(measured: Mapping[str, float]) -> tuple[list[tuple[Array, float]], dict[str, float]]:
    """What measured lengths tell of a body whose sides are alike, and how the sides differ from it.

    Returns:
        Rows ``(17,)`` of the body's lengths with the metres they amount to; and by the joint at a limb's end the metres
        that it is longer than the mean of both sides.

    Raises:
        InputError: for an implausible length or an unknown segment.
    """
    length_range_m = (0.02, 1.2)
    sides: dict[str, dict[str, float]] = {}
    rows = []
    low, high = length_range_m
    for name, metres in sorted(measured.items(), key=lambda one: one[0].startswith(("left_", "right_"))):
        if not low <= metres <= high:
            raise InputError(f"segment length {name} = {metres:g} m: expected metres, between {low:g} and {high:g}")
        if name in WHOLE:
            rows.append((_row(WHOLE[name]), metres))
            continue
        side, _, limb = name.partition("_") if name.startswith(("left_", "right_")) else ("", "", name)
        limb = limb.replace("_", " ")
        if limb not in LIMB_ENDS:
            known = ", ".join([*LIMB_ENDS, *WHOLE]).replace(" ", "_").replace(",_", ", ")
            raise InputError(f"unknown segment '{name}': expected one of {known}, with left_ or right_ before a limb's")
        # A side's own length comes after both sides', and wins.
        sides.setdefault(limb, {}).update({one: metres for one in ([side] if side else ["left", "right"])})
    halves: dict[str, float] = {}
    for limb, lengths in sides.items():
        mean = float(np.mean(list(lengths.values())))
        rows.append((_row({limb: 1.0}), mean))
        halves |= {f"{side}_{LIMB_ENDS[limb]}": metres - mean for side, metres in lengths.items()}
    return rows, halves


def apply_sides(skeleton: Skeleton, halves: Mapping[str, float]) -> Skeleton:
    """The skeleton with limbs longer than both sides' mean by metres, by the joint at their end."""
    offsets = skeleton.p_parent_joint.copy()
    for joint, metres in halves.items():
        along = offsets[joint_index(joint)]
        offsets[joint_index(joint)] = along * (1 + metres / np.linalg.norm(along))
    return Skeleton(offsets, skeleton.landmarks, skeleton.source)


def _row(lengths: Mapping[str, float]) -> Array:
    return np.array([lengths.get(name, 0.0) for name in BODY_LENGTHS])


# m: no combination of lengths is taken to be known better. Soft tissue and a detector's habits err alike in every
# frame, and what was found counts each of them as news.
LEAST_SIGMA = 0.003


@dataclass(frozen=True)
class LengthPrior:
    """A Gaussian about the lengths of a skeleton: names, ``B`` of :data:`~vip_factors.body.lengths.LENGTHS` or of
    another version's, and covariance ``(B, B)`` m² of their changes.
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
        """How ``skeleton`` may change, and how likely: lengths without a name here as those of anybody else."""
        whole = likely_body(skeleton.stature).variation.covariance
        known = [(LENGTHS.index(name), place) for place, name in enumerate(self.names) if name in LENGTHS]
        if known:
            at, given = (np.array(column) for column in zip(*known, strict=True))
            whole[at, :] = whole[:, at] = 0.0
            whole[np.ix_(at, at)] = self.covariance[np.ix_(given, given)]
        values, vectors = np.linalg.eigh(whole)
        covariance = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return BodyVariation.about_mean(skeleton, covariance)
