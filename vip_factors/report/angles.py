"""Joint angles over time, both sides over each other, with their ranges."""

from collections.abc import Mapping, Sequence

import numpy as np

from vip_factors.body.joint_angles import JointAngles, is_measured, joint_angle_sigmas, joint_angles
from vip_factors.body.mannequin import Side
from vip_factors.body.model_errors import shape_factor
from vip_factors.gait.analysis import bones_with_sensors
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import (
    SIDE_COLOURS,
    UNKNOWN,
    Block,
    Charts,
    Heading,
    Line,
    Paragraph,
    Section,
    Table,
    capital,
    joint_words,
    time_chart,
    with_unit,
)
from vip_factors.report.material import Material, Wearer

PAIRED = (
    "hip_flexion", "knee_flexion", "ankle_dorsiflexion", "hip_adduction", "hip_internal_rotation", "shoulder_flexion",
    "shoulder_adduction", "elbow_flexion",
)  # fmt: skip
TRUNK = ("trunk_flexion", "trunk_lateral_bending", "trunk_axial_rotation", "pelvis_tilt")
WITHIN = (0.01, 0.99)  # of the frames: a range must not hang on a single one
Sigmas = dict[str, Array]
"""Standard deviations ``(T,)`` in degrees by the angle's name; empty where they are not known."""
HALF_CIRCLE_DEG = 180.0
SIDES = (("left", Side.LEFT), ("right", Side.RIGHT))


def angles_section(material: Material) -> Section:
    """Of each wearer."""
    blocks: list[Block] = [
        Paragraph(
            "Angles follow the recommendations of the International Society of Biomechanics and are zero when standing "
            "upright with hanging arms, palms forward. Point at a curve to read it; the body above follows. The pale "
            "band is one standard deviation, where it is known."
        )
    ]
    for wearer in material.wearers:
        if len(material.wearers) > 1:
            blocks.append(Heading(wearer.name))
        blocks += _wearer(wearer, material.estimate.camera is not None)
    return Section("angles", "Joint angles", tuple(blocks))


def _wearer(wearer: Wearer, with_camera: bool) -> list[Block]:
    angles = joint_angles(wearer.estimate.motion)
    sigmas, bones = _sigmas(angles, wearer), bones_with_sensors(wearer.estimate, wearer.recording)
    measured = {name: is_measured(bones, name) for name in (*PAIRED, *TRUNK)}
    blocks: list[Block] = []
    if bones is None:
        blocks.append(
            Paragraph(
                "Which segments wore sensors is not known without the recording (--recording): joints that none "
                "measured are among these.",
                small=True,
            )
        )
    blocks.append(_charts(angles, sigmas, [name for name in measured if measured[name]]))
    blocks += _ranges(angles, sigmas, measured)
    guessed = [name for name in measured if not measured[name]]
    if guessed:
        from_what = "the video alone, and" if with_camera else "nothing but"
        blocks.append(
            Paragraph(
                f"No sensors were on both segments of the following joints: their angles rest on {from_what} what "
                "usually goes with the rest of the body. Do not read them as measurements."
            )
        )
        blocks.append(_charts(angles, sigmas, guessed))
    return blocks


def _charts(angles: JointAngles, sigmas: Sigmas, names: Sequence[str]) -> Charts:
    """One for each angle, both sides in it."""
    positive = {one.name: one.positive for one in angles.definitions}
    charts = []
    for name in names:
        if name in TRUNK:
            line = Line(joint_words(name), angles.time, angles.of(name), SIDE_COLOURS[Side.MIDDLE], sigmas.get(name))
            charts.append(time_chart(_title(name, positive[name]), [line], "°"))
            continue
        lines = [
            Line(
                side, angles.time, _unjoined(angles.of(f"{side}_{name}")), SIDE_COLOURS[which],
                sigmas.get(f"{side}_{name}"),
            )
            for side, which in SIDES
        ]  # fmt: skip
        charts.append(time_chart(_title(name, positive[f"left_{name}"]), lines, "°"))
    return Charts(tuple(one for one in charts if one is not None))


def _title(name: str, positive: str) -> str:
    return f"{capital(joint_words(name))} (+ {positive})"


def _unjoined(values: Array) -> Array:
    """With a gap where an angle goes on at the other end of its circle."""
    parted = values.copy()
    parted[np.flatnonzero(np.abs(np.diff(values)) > HALF_CIRCLE_DEG)] = np.nan
    return parted


def _sigmas(angles: JointAngles, wearer: Wearer) -> Sigmas:
    covariance = wearer.estimate.covariance
    if covariance is None:
        return {}
    sigmas = joint_angle_sigmas(wearer.estimate.motion, covariance.joints)
    return {name: sigmas[:, column] for column, name in enumerate(angles.names)}


def _ranges(angles: JointAngles, sigmas: Sigmas, measured: Mapping[str, bool]) -> list[Block]:
    """Range of motion of each angle, and what lies between the sides."""
    rows, joint = [], {one.name: one.joint for one in angles.definitions}
    for name in (one for one in PAIRED if measured[one]):
        left, right = (_range(angles.of(f"{side}_{name}")) for side, _ in SIDES)
        whole = [f"{side}_{name}" for side, _ in SIDES]
        both = [shape_factor(joint[one]) * _median(sigmas[one]) for one in whole if sigmas]
        rows.append(
            (
                capital(joint_words(name)), *_words(left), *_words(right),
                with_unit((left[1] - left[0]) - (right[1] - right[0]), "°", 0),
                f"± {np.linalg.norm(both):.0f}°" if both and np.isfinite(both).all() else UNKNOWN,
            )
        )  # fmt: skip
    for name in (one for one in TRUNK if measured[one]):
        rows.append((capital(joint_words(name)), *_words(_range(angles.of(name))), "", "", "", ""))
    head = ("Angle", "Left: from … to", "Range", "Right: from … to", "Range", "Left less right", "Uncertain by")
    caption = (
        "Range of motion: between the values that 1 % of the frames are below and above. A difference between the "
        "sides that is smaller than twice its uncertainty says nothing; nor does one of movements that were not meant "
        "to be alike."
    )
    return [Table(head, rows, caption)] if rows else []


def _median(values: Array) -> float:
    good = values[np.isfinite(values)]
    return float(np.median(good)) if len(good) else float("nan")


def _range(values: Array) -> tuple[float, float]:
    low, high = np.nanquantile(values, WITHIN)
    return float(low), float(high)


def _words(ends: tuple[float, float]) -> tuple[str, str]:
    low, high = ends
    return f"{low:z.0f}° … {high:z.0f}°", f"{high - low:.0f}°"
