"""A repetition of an exercise, those of one wearer, and the signals that show them."""

import math
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from vip_factors.body.joint_angles import JointAngles, joint_angle_sigmas, joint_angles
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import SIDES, joint_index
from vip_factors.display import Summarised
from vip_factors.estimate import WearerEstimate, dataframe
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.imu_stream import low_passed

if TYPE_CHECKING:
    import pandas


MOVEMENT_HZ = 6.0  # people's limbs move below it (Winter, Biomechanics and Motor Control of Human Movement, 4th ed.)
# Share of the body's mass, and where its centre lies from the first joint to the second (de Leva 1996, J. Biomech. 29,
# men; women's centres of the whole body differ by millimetres). The head's lies at its joint's height plus the skull's,
# which is taken as the joint's own; hands go with the forearms.
_SEGMENTS = (
    ("hips", "shoulders", 0.4346, 0.55),
    ("neck", "head", 0.0694, 1.0),
    ("{}_shoulder", "{}_elbow", 0.0271, 0.577),
    ("{}_elbow", "{}_wrist", 0.0223, 0.6),
    ("{}_hip", "{}_knee", 0.1416, 0.41),
    ("{}_knee", "{}_ankle", 0.0433, 0.446),
    ("{}_ankle", "{}_foot", 0.0137, 0.5),
)


@dataclass(frozen=True, repr=False)
class Signals(Summarised):
    """A wearer's motion, low-passed without a delay; all ``(T,)`` unless said otherwise.

    Attributes:
        motion: of the wearer.
        time: seconds.
        angles: joint angles, not low-passed.
        sigmas: ``(T, N)`` degrees, of ``angles``; NaN where not known.
        p: ``(T, 24, 3)`` metres, joints in the world.
        mass_height, sole: metres, of the centre of mass and of the lower foot's ball, with the quick part that pushes
            and landings have.
        height_sigma: metres, of where the wearer is up and down; NaN where not known.
    """

    motion: Motion
    time: Array
    angles: JointAngles
    sigmas: Array
    p: Array
    mass_height: Array
    sole: Array
    height_sigma: Array

    @cached_property
    def legs(self) -> float:
        """Length of a straight leg in metres, from hip to ankle."""
        return self.motion.skeleton.bone_length("left_knee") + self.motion.skeleton.bone_length("left_ankle")

    @cached_property
    def reach(self) -> Array:
        """Height of the pelvis above the lower foot's ball, metres."""
        return self.height("pelvis") - self.lower_foot

    @cached_property
    def lower_foot(self) -> Array:
        """Height of the lower foot's ball, metres."""
        return np.minimum(self.height("left_foot"), self.height("right_foot"))

    @cached_property
    def apart(self) -> Array:
        """Distance of the left ankle in front of the right one along the pelvis' facing direction, metres."""
        facing = self.motion.state.R_world_bone[:, 0, :2, 2]
        between = (self.p[:, joint_index("left_ankle")] - self.p[:, joint_index("right_ankle")])[:, :2]
        return np.sum(between * facing, axis=1) / np.maximum(np.linalg.norm(facing, axis=1), 1e-9)

    @cached_property
    def fall(self) -> Array:
        """Downward acceleration of the centre of mass, m/s²."""
        step = 1 / self.motion.rate
        return -np.gradient(np.gradient(self.mass_height, step), step)

    def height(self, joint: str) -> Array:
        """Height of a joint in metres."""
        return self.p[:, joint_index(joint), 2]

    def flexion(self, side: str, joint: str) -> Array:
        """Low-passed flexion of a joint in degrees."""
        return low_passed(self.angles.of(f"{side}_{joint}_flexion"), self.motion.rate, MOVEMENT_HZ)

    def sigma(self, angle: str) -> Array:
        """Standard deviation of an angle in degrees; NaN where not known."""
        return self.sigmas[:, self.angles.names.index(angle)]

    def upper_arm(self, side: str) -> Array:
        """Which way an upper arm points, from shoulder to elbow, ``(T, 3)`` unit vectors in the chest's axes."""
        R_chest = self.motion.state.R_world_bone[:, joint_index("spine3")]
        arm = self.p[:, joint_index(f"{side}_elbow")] - self.p[:, joint_index(f"{side}_shoulder")]
        return (transpose(R_chest) @ (arm / np.linalg.norm(arm, axis=1, keepdims=True))[..., None])[..., 0]


def signals_of(wearer: WearerEstimate) -> Signals:
    """The signals of a wearer."""
    motion, covariance = wearer.motion, wearer.covariance
    angles, raw = joint_angles(motion), motion.state.p_world_joint
    sigmas, height_sigma = np.full(angles.degrees.shape, np.nan), np.full(len(motion), np.nan)
    if covariance is not None:
        sigmas = joint_angle_sigmas(motion, covariance.joints)
        height_sigma = np.sqrt(covariance.root[:, 2, 2])
    sole = np.min([raw[:, joint_index(f"{side}_foot"), 2] for side in SIDES], axis=0)
    force_hz = 12.0  # the push and the landing of a jump last for a tenth of a second
    mass_height, sole = (low_passed(signal, motion.rate, force_hz) for signal in (_mass_height(raw), sole))
    p = low_passed(raw, motion.rate, MOVEMENT_HZ)
    return Signals(motion, motion.time, angles, sigmas, p, mass_height, sole, height_sigma)


def _mass_height(p: Array) -> Array:
    """Height of the centre of mass ``(T,)``, of joints ``(T, 24, 3)``."""

    def height(name: str) -> Array:
        if name in ("hips", "shoulders"):
            return 0.5 * (height(f"left_{name[:-1]}") + height(f"right_{name[:-1]}"))
        return p[:, joint_index(name), 2]

    total, weight = np.zeros(len(p)), 0.0
    for start_joint, end_joint, mass, share in _SEGMENTS:
        for side in SIDES if "{}" in start_joint else ("",):
            total += mass * ((1 - share) * height(start_joint.format(side)) + share * height(end_joint.format(side)))
            weight += mass
    return total / weight


Kind = Literal["squat", "lunge", "jump", "curl"]
Side = Literal["left", "right", "both"]
UNKNOWN = float("nan")


@dataclass(frozen=True)
class Measured:
    """A value and its standard deviation, NaN if that is not known; both NaN of what there is not."""

    value: float = UNKNOWN
    sigma: float = UNKNOWN


@dataclass(frozen=True)
class Repetition:
    """One repetition; seconds on the recording's clock.

    Attributes:
        kind: of exercise.
        side: the leg in front in a lunge, the arm that curls.
        start, turn, end: when it begins, is deepest (a jump highest) and ends.
        down_s, hold_s, up_s: the ways there and back and the stay between; a jump's squat before it, and no stay.
        depth_m: that the pelvis sinks; a jump's before it. None of a curl.
        depth_deg: flexion of the knees, or elbows, at the turn; mean of the sides that take part.
        ranges_deg: of every principal angle, by name, between its least and most.
        left_less_right_deg: what the left knee's or elbow's range is larger than the right one's; of both sides alike
            only.
        flight_s: without a foot on the floor.
        flight_height_m: that free fall says of it: that the centre of mass rises beyond take-off.
        rise_m: of the centre of mass above that of standing before.
    """

    kind: Kind
    side: Side
    start: float
    turn: float
    end: float
    down_s: float
    hold_s: float
    up_s: float
    depth_m: Measured
    depth_deg: Measured
    ranges_deg: dict[str, Measured] = field(default_factory=dict)
    left_less_right_deg: Measured = Measured()
    flight_s: float = UNKNOWN
    flight_height_m: Measured = Measured()
    rise_m: Measured = Measured()

    def columns(self) -> dict[str, object]:
        """Columns of a table of numbers: standard deviations follow as ``…_sd_…``; an unknown number is empty text."""
        units = {"start": "start_s", "turn": "turn_s", "end": "end_s"}
        columns: dict[str, object] = {}
        for name, value in vars(self).items():
            ranges = {f"{angle}_range_deg": extent for angle, extent in self.ranges_deg.items()}
            for column, cell in (ranges if name == "ranges_deg" else {units.get(name, name): value}).items():
                if isinstance(cell, Measured):
                    quantity, _, unit = column.rpartition("_")
                    columns |= {column: _cell(cell.value), f"{quantity}_sd_{unit}": _cell(cell.sigma)}
                else:
                    columns[column] = _cell(cell) if isinstance(cell, float) else cell
        return columns


def _cell(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""


@dataclass(frozen=True, repr=False)
class WearerRepetitions(Summarised):
    """The repetitions of one wearer, in the order of time, and their signals."""

    name: str
    signals: Signals
    repetitions: tuple[Repetition, ...]

    @property
    def counts(self) -> str:
        """Numbers by kind, such as ``6 squats, 2 jumps``."""
        kinds = Counter(repetition.kind for repetition in self.repetitions)
        counts = (f"{kinds[kind]} {kind}{'s' if kinds[kind] > 1 else ''}" for kind in get_args(Kind) if kinds[kind])
        return ", ".join(counts) or "no repetitions"

    def summary(self) -> list[str]:
        """List the repetitions with their times."""
        title = f"{self.name or 'wearer'}: {self.counts}"
        return [
            title,
            *(
                f"{repetition.kind}: {repetition.start:.1f} to {repetition.end:.1f} s, {repetition.side}"
                for repetition in self.repetitions
            ),
        ]

    def to_dataframe(self) -> "pandas.DataFrame":
        """A pandas table with the columns of ``repetitions.csv``; an :class:`InputError` without pandas."""
        lines = [repetition.columns() for repetition in self.repetitions]
        names = list(dict.fromkeys(name for line in lines for name in line)) or ["kind", "side", "start_s", "end_s"]
        return dataframe([names, *([line.get(name, "") for name in names] for line in lines)])
