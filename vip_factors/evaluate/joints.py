"""Which joints each published metric averages over: named once, here."""

from collections.abc import Collection
from dataclasses import dataclass

from vip_factors.body.skeleton import JOINT_NAMES, joint_index, joints_placed_by


def _both(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for name in names for side in ("left", "right"))


# MPJPE of VIP and SIP (thesis 2.5.2): 14 joints.
POSITION_JOINTS = (*_both("hip", "knee", "ankle"), "neck", "head", *_both("shoulder", "elbow", "wrist"))
# MPJAE of VIP and SIP (thesis 2.5.2): 9 joints.
ORIENTATION_JOINTS = (*_both("hip", "knee"), "neck", *_both("shoulder", "elbow"))
# Kaichi et al. average over 16 joints without naming them: the 14 and the ends of the trunk's two halves are ours.
GLOBAL_JOINTS = ("pelvis", "spine3", *POSITION_JOINTS)
FEET = _both("foot")


def indices(names: tuple[str, ...]) -> list[int]:
    """Their rows in a motion's joint axis."""
    return [joint_index(name) for name in names]


@dataclass(frozen=True)
class Compared:
    """Which of the joints that a metric averages over are compared: those of which the truth knows anything.

    Attributes:
        bones: names of the bones whose motion the truth knows; None: all.
    """

    bones: frozenset[str] | None = None

    @classmethod
    def of(cls, bones: Collection[str] | None) -> "Compared":
        """Of a truth that knows some bones, or all (None)."""
        return cls(None if bones is None else frozenset(bones))

    def orientations(self, names: tuple[str, ...] = JOINT_NAMES) -> list[int]:
        """Rows of those bones among the named ones whose turn is known."""
        return [row for row in indices(names) if self.bones is None or JOINT_NAMES[row] in self.bones]

    def positions(self, names: tuple[str, ...] = JOINT_NAMES) -> list[int]:
        """Rows of those joints among the named ones whose place is known: they sit on the bone above."""
        return joints_placed_by(self.bones, indices(names))


EVERYTHING = Compared()
