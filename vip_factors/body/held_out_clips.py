"""Clips of the CMU database that the pose prior is never trained on, so that simulated trials on them are fair.

Chosen from the descriptions in the database's index and from the heights of pelvis and hands: the clips under
``low`` come nearest to the floor of all in subjects 2–12 (pelvis down to 0.36 m, hands down to 0.15 m)
that the conversion to BVH has left whole: the dancer's (subject 05) flip their ankles.
"""

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
