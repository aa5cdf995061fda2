"""TOML files with one person's estimated body, from which that person's next recording starts.

::

    name = "Ada"
    provenance = "walk.estimate.mcap, VIP, 30.1 s; stature 1.78 m, Drillis & Contini 1966; lengths estimated"

    [skeleton]                     # metres, every joint on the bone above: x to the left, y up, z forward
    pelvis = [0.0, 0.0, 0.0]
    left_hip = [0.081, -0.091, 0.0]

    [landmarks]                    # metres, points beyond the last joints
    head_top = { bone = "head", p_m = [0.0, 0.167, 0.0] }

    [lengths]                      # as the skeleton has them, and how far each may be off
    thigh = { found_m = 0.38, sigma_m = 0.006 }

    [correlations]                 # of those, row by row
    thigh = [1.0]

    [hinges.left_knee] # carrying angle 2.8 ± 1.8°
    axis = [1.0, 0.0, 0.0]              # a unit vector in the bone above
    offset_deg = [2.8, 0.1]             # how far from a right angle to it the limb stays; of a knee also its front
    sigma_deg = [1.5, 3.8, 1.4, 2.2]    # of the axis's tilts towards two directions, then of the offsets
    correlations = [[1.0, …], …]        # of those, row by row
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.anthropometry import LengthPrior
from vip_factors.body.joint_priors import HINGE_OF, HingeEstimate
from vip_factors.body.lengths import LENGTHS, STRETCHED, lengths_of, stature_of
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import InputError, nearest
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.typed_files import Number, Vector, check_keys, correlation_matrix, read_toml, toml_text
from vip_factors.sensors.calibration import SensorSite
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import Scene


@dataclass(frozen=True)
class BodyFile:
    """Content of a body file.

    Attributes:
        name: of the person.
        skeleton: both sides alike.
        lengths: how far the lengths of the skeleton may be off.
        hinges: of elbows and knees, if they were found.
        provenance: one line saying where the body comes from.
    """

    name: str
    skeleton: Skeleton
    lengths: LengthPrior
    hinges: tuple[HingeEstimate, ...] = ()
    provenance: str = ""


def body_of_estimate(estimate: WearerEstimate, source: str) -> BodyFile:
    """The body of an estimate from the file ``source``."""
    body, who = estimate.body, estimate.motion.name
    if body is None or not body.names:
        raise InputError(
            f"{source}: no body of '{who}' was looked for: expected the estimate of a filmed wearer with a stature "
            "but no segment lengths; convert with --stature-m, without --segment-lengths-m, and smooth again"
        )
    if not np.all(np.isfinite(body.covariance)):
        raise InputError(
            f"{source}: the body of '{who}' is not determined by the data: expected standard deviations of its "
            "lengths; use a longer recording, or one that shows more of the wearer"
        )
    skeleton, seconds = estimate.motion.skeleton, len(estimate.motion) / estimate.motion.rate
    provenance = f"{source}, {estimate.method}, {seconds:.1f} s; {skeleton.source}"
    hinges = tuple(hinge for hinge in body.hinges if np.all(np.isfinite(hinge.covariance)))
    return BodyFile(who, skeleton, LengthPrior(body.names, body.covariance), hinges, provenance)


def write_body_file(path: str | Path, body: BodyFile, overwrite: bool = False) -> None:
    """Write a body file, whole or not at all: millimetres and degrees to four decimals, joints to the bit."""
    skeleton, (sigmas, correlations) = body.skeleton, _correlations(body.lengths.covariance)
    lines = [f"name = {toml_text(body.name)}", f"provenance = {toml_text(body.provenance)}"]
    lines += ["", "[skeleton] # metres, every joint on the bone above: x to the left, y up, z forward"]
    lines += [f"{name} = {toml_text(p)}" for name, p in zip(JOINT_NAMES, skeleton.p_parent_joint, strict=True)]
    lines += ["", "[landmarks] # metres, points beyond the last joints"]
    lines += [
        f"{toml_text(name)} = {{ bone = {toml_text(JOINT_NAMES[point.bone])}, p_m = {toml_text(point.p_bone_point)} }}"
        for name, point in skeleton.landmarks.items()
    ]
    lines += ["", "[lengths] # metres; as the skeleton has them, and how far each may be off"]
    metres = dict(zip(LENGTHS, lengths_of(skeleton), strict=True))
    for name, sigma in zip(body.lengths.names, sigmas, strict=True):
        length = f"found_m = {metres[name]:.4f}, " if name in metres else ""
        lines.append(f"{toml_text(name)} = {{ {length}sigma_m = {sigma:.6f} }}")
    lines += ["", "[correlations] # of those, row by row"]
    rows = zip(body.lengths.names, correlations, strict=True)
    lines += [f"{toml_text(name)} = {toml_text(row)}" for name, row in rows]
    for hinge in body.hinges:  # in degrees to four decimals
        sigma, correlations = _correlations(hinge.covariance)
        angle, angle_sigma = np.rad2deg([hinge.carrying_angle, hinge.carrying_sigma])
        lines += [
            "",
            f"[hinges.{hinge.joint}] # carrying angle {angle:.1f} ± {angle_sigma:.1f}°",
            f"axis = {toml_text(np.round(hinge.axis, 8))}",
            f"offset_deg = {toml_text(np.round(np.rad2deg(hinge.variables[2:]), 4))}",
            f"sigma_deg = {toml_text(np.round(np.rad2deg(sigma), 4))}",
            f"correlations = {toml_text(correlations)}",
        ]
    with atomic_open(path, "w", overwrite) as file:
        file.write("\n".join(lines) + "\n")


class _Point(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    bone: str
    p_m: Vector


class _Length(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    sigma_m: Annotated[float, msgspec.Meta(gt=0, le=0.5)]
    found_m: Number | None = None


class _Hinge(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    axis: Vector
    offset_deg: tuple[Number, ...]
    sigma_deg: tuple[Annotated[float, msgspec.Meta(gt=0, le=90)], ...]
    correlations: tuple[tuple[Number, ...], ...]


class _Content(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    skeleton: dict[str, Vector]
    lengths: dict[str, _Length]
    correlations: dict[str, tuple[Number, ...]]
    landmarks: dict[str, _Point] = {}
    hinges: dict[str, _Hinge] = {}
    provenance: str = ""


def read_body_file(path: str | Path) -> BodyFile:
    """Read a body file; sides that are not alike, lengths that are not the skeleton's and other slips are refused."""
    path = Path(path)
    content = read_toml(path, _Content, "a body file (TOML; vip-factors body writes one)")
    skeleton = _skeleton(path, content)
    hinges = tuple(_hinge_estimate(path, joint, hinge) for joint, hinge in content.hinges.items())
    return BodyFile(content.name, skeleton, _length_prior(path, content, skeleton), hinges, content.provenance)


def _skeleton(path: Path, content: _Content) -> Skeleton:
    joints = content.skeleton
    check_keys(path, "skeleton", joints, JOINT_NAMES)
    longest_bone, symmetric = 1.2, 0.002  # m
    offsets = np.array([joints[name] for name in JOINT_NAMES])
    for name, offset in zip(JOINT_NAMES, offsets, strict=True):
        if np.linalg.norm(offset) > longest_bone:
            raise InputError(
                f"{path}: skeleton.{name} is {np.linalg.norm(offset):g} m from the joint above: expected metres"
            )
        twin = offsets[joint_index(name.replace("left_", "right_"))] * [-1, 1, 1]
        if name.startswith("left_") and np.abs(offset - twin).max() > symmetric:
            raise InputError(
                f"{path}: skeleton.{name} is not the mirror image of its right twin: expected both sides alike"
            )
    landmarks = {}
    for name, point in content.landmarks.items():
        if point.bone not in JOINT_NAMES:
            raise InputError(f"{path}: landmarks.{name}: unknown bone '{point.bone}'{nearest(point.bone, JOINT_NAMES)}")
        landmarks[name] = Landmark(joint_index(point.bone), np.array(point.p_m))
    return Skeleton(offsets, landmarks, content.provenance)


def _length_prior(path: Path, content: _Content, skeleton: Skeleton) -> LengthPrior:
    lengths, rows = content.lengths, content.correlations
    if set(rows) != set(lengths):
        raise InputError(f"{path}: correlations of {', '.join(rows) or 'nothing'}: expected one row for each length")
    rounding = 0.002  # m: the table of lengths is for people
    for name, metres in zip(LENGTHS, lengths_of(skeleton), strict=True):
        length = lengths[name].found_m if name in lengths else None
        if length is not None and abs(length - metres) > rounding:
            raise InputError(
                f"{path}: lengths.{name}.found_m is {length:g}, where the skeleton has {metres:.4f}: expected the "
                "same; change the joints in [skeleton], on both sides, and the length with them"
            )
    matrix = correlation_matrix(path, "correlations", [rows[name] for name in lengths])
    sigma = np.array([length.sigma_m for length in lengths.values()])
    return LengthPrior(tuple(lengths), sigma[:, None] * matrix * sigma)


def _correlations(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations, and correlations to five decimals."""
    sigma = np.sqrt(np.diag(covariance))
    return sigma, np.round(covariance / np.maximum(np.outer(sigma, sigma), 1e-16), 5)


def _hinge_estimate(path: Path, joint: str, table: _Hinge) -> HingeEstimate:
    where = f"hinges.{joint}"
    if joint not in HINGE_OF:
        raise InputError(f"{path}: {where}: unknown joint '{joint}'{nearest(joint, HINGE_OF)}")
    hinge, axis = HINGE_OF[joint], np.array(table.axis)
    if not abs(np.linalg.norm(axis) - 1) < 1e-3:
        raise InputError(f"{path}: {where}.axis has length {np.linalg.norm(axis):g}: expected a unit vector")
    if hinge.axis @ axis < 0.5:  # no joint turns about another axis, and tilts are small
        raise InputError(f"{path}: {where}.axis is {axis.tolist()}: expected one near {hinge.axis.tolist()}")
    count = len(hinge.columns)
    counts = (len(table.offset_deg) + 2, len(table.sigma_deg), len(table.correlations))
    if counts != (count, count, count):
        raise InputError(
            f"{path}: {where}: expected {count - 2} numbers of offset_deg, {count} of sigma_deg and {count} rows of "
            "correlations"
        )
    matrix = correlation_matrix(path, f"{where}.correlations", table.correlations)
    sigma = np.deg2rad(table.sigma_deg)
    variables = np.concatenate([hinge.tilt_to(axis), np.deg2rad(table.offset_deg)])
    return HingeEstimate(joint, variables, sigma[:, None] * matrix * sigma)


def subject_with(body: BodyFile, name: str | None, mass_kg: float | None, sex: str | None) -> Subject:
    """The wearer with a body; ``name`` defaults to the body's."""
    return Subject(
        name or body.name,
        stature_of(body.skeleton),
        mass_kg,
        sex,
        skeleton=body.skeleton,
        length_prior=body.lengths,
        hinges=body.hinges,
    )


def with_body(recording: Recording, body: BodyFile) -> Recording:
    """The recording with another body of the wearer; truth and samples stay."""
    wearer = recording.subject
    subject = subject_with(body, wearer.name, wearer.mass_kg, wearer.sex)
    sites = tuple(_moved_site(site, wearer.body(), body.skeleton) for site in recording.placement.sites)
    return replace(recording, subject=subject, placement=replace(recording.placement, sites=sites))


def scene_with_body(scene: Scene, body: BodyFile, path: Path) -> Scene:
    """The scene whose wearer of the body's name, or only wearer, has the body, which was read from ``path``."""
    names = scene.names
    if len(names) > 1 and body.name not in names:
        raise InputError(
            f"{path} is the body of '{body.name}', scene '{scene.name}' has the wearers {', '.join(names)}: expected "
            "one of them; set its name to the wearer's"
        )
    wearers = list(scene.wearers)
    place = names.index(body.name) if body.name in names else 0
    wearers[place] = with_body(wearers[place], body)
    return replace(scene, wearers=tuple(wearers))


def _moved_site(site: SensorSite, skeleton: Skeleton, new_skeleton: Skeleton) -> SensorSite:
    """The site on a new skeleton; a sensor keeps its share of a limb's length."""
    for child in STRETCHED:
        if PARENTS[child] == site.bone_index:
            old, new = skeleton.p_parent_joint[child], new_skeleton.p_parent_joint[child]
            share = float(np.clip(site.p_bone_sensor @ old / (old @ old), 0.0, 1.0))
            return replace(site, p_bone_sensor=site.p_bone_sensor + share * (new - old))
    return site
