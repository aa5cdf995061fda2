"""Which joints each published metric averages over: named once, here."""

from vip_factors.body.skeleton import joint_index


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
