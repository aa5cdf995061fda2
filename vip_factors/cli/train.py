"""``vip-factors train keypoints``: learn from recordings with a known motion where a detector puts its keypoints."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from vip_factors.atomic import check_target
from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import progress_bar
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class TrainOptions(WritingOptions):
    """Learn how far from the joints a 2D pose detector puts hips, knees, shoulders …, from recordings with truth.

    Each recording has a camera's 2D poses and the motion of an optical system that had no part in them (what was
    triangulated from the same 2D poses teaches nothing). For every keypoint set in them the file gets the mean offsets
    and how far people scatter about them; recordings of few people are believed little.

    To use it: vip-factors smooth … --camera.keypoint-offset.learned FILE. The package ships none: no public recording
    that we know of has both.
    """

    common: ClassVar = ("out", "overwrite")
    none_is_a_value: ClassVar = True
    what: tyro.conf.Positional[Literal["keypoints"]]
    """What to learn."""
    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recordings (.mcap) with cameras and truth; two of one person count as two people."""
    out: Annotated[Path, Output(".toml")]
    """File (.toml) to write."""
    # As in OffsetTraining, which imports more than help needs.
    prior_people: float = 4.0
    """As so many people the usual sigmas count, when it is asked how far people scatter about a detector's habit."""
    habit_share: float = 0.5
    """Of the usual variance the habit's share, which all people have in common; the rest is from one to the next."""
    least_sigma_m: float = 0.003
    """Truths are no better: markers on the skin, joints by regression."""


def main(options: TrainOptions) -> None:
    """Run the command."""
    from vip_factors.body.keypoints import KeypointOffsets, OffsetTraining, pooled_offsets
    from vip_factors.io.keypoint_offsets_file import KeypointOffsetsFile, write_keypoint_offsets
    from vip_factors.io.mcap_recording import read_scene
    from vip_factors.settings import Settings
    from vip_factors.stages.keypoint_offsets import offsets_in_recording
    from vip_factors.terms.keypoint_offset import KeypointOffsetSettings

    if not options.recordings:
        raise InputError("no recording named: expected one or more (.mcap) with cameras and truth")
    check_target(options.out, options.overwrite)
    found: dict[str, list[KeypointOffsets]] = {}
    with progress_bar() as progress:
        for path in options.recordings:
            for one in offsets_in_recording(read_scene(path), Settings(), partial(progress, path.name)):
                found.setdefault(one.keypoints, []).append(one.offsets)
    usual = KeypointOffsetSettings().sigmas
    training = OffsetTraining(options.prior_people, options.habit_share, options.least_sigma_m)
    sets = {name: pooled_offsets(those, usual, training) for name, those in found.items()}
    names = " ".join(path.name for path in options.recordings)
    content = KeypointOffsetsFile(sets, f"vip-factors train keypoints {names}")
    write_keypoint_offsets(options.out, content, options.overwrite)
    for name, pooled in sets.items():
        print(f"{name}: {pooled.people} {'person' if pooled.people == 1 else 'people'}")
        _print_result(pooled.offsets.mean, pooled.offsets.sigma)
    print(options.out)


def _print_result(mean: "Array", sigma: "Array") -> None:
    from vip_factors.body.keypoints import OFFSET_KEYPOINTS

    print("  mm           left       up  forward")
    for name, offset, spread in zip(OFFSET_KEYPOINTS, 1e3 * mean, 1e3 * sigma, strict=True):
        print(f"  {name:9s}" + "".join(f"{o:4.0f} ± {s:2.0f}" for o, s in zip(offset, spread, strict=True)))
