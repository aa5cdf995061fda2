"""Numbers and names as people write them."""

from collections.abc import Sequence

import numpy as np

UNKNOWN = "\u2013"  # a dash


def count(number: int, one: str) -> str:
    """``1 sensor``, ``13 sensors``."""
    return f"{number} {one if number == 1 else one + 's'}"


def listed(words: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def seconds_words(seconds: float) -> str:
    """``12.3 s``, ``4 min 05 s``."""
    return f"{seconds:.1f} s" if seconds < 120 else f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def number(value: float, decimals: int = 1) -> str:
    """Without a minus before zero; a dash for what is not known."""
    return f"{value:z.{decimals}f}" if np.isfinite(value) else UNKNOWN


def with_unit(value: float, unit: str, decimals: int = 1) -> str:
    """``1.75 m``, ``3.1°``; a dash for what is not known."""
    space = "" if unit in ("°", "") else "\u202f"
    return f"{value:z.{decimals}f}{space}{unit}" if np.isfinite(value) else UNKNOWN


def plus_minus(value: float, sigma: float, unit: str = "", decimals: int = 0, sigma_decimals: int = 0) -> str:
    """A value and its standard deviation, which is left out if it is not known."""
    text = with_unit(value, unit, decimals)
    return f"{text} ± {sigma:.{sigma_decimals}f}" if np.isfinite(sigma) and np.isfinite(value) else text


def joint_words(name: str) -> str:
    """``left_knee`` → ``left knee``."""
    return name.replace("_", " ")


def capital(text: str) -> str:
    """With a large first letter."""
    return text[:1].upper() + text[1:]


BONE_WORDS = {"hip": "thigh", "knee": "shank", "ankle": "foot", "shoulder": "upper arm", "elbow": "forearm",
              "wrist": "hand", "foot": "toes", "hand": "fingers", "collar": "collar bone",
              "spine1": "lower back", "spine2": "middle back", "spine3": "chest"}  # fmt: skip


def bone_words(bone: str) -> str:
    """What people call a bone: ``left_knee`` is the left shank."""
    side, _, joint = bone.rpartition("_")
    return f"{side} {BONE_WORDS.get(joint, joint)}".strip()
