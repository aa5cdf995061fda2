"""``vip-factors simulate``: a recording with known truth from a motion."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.cli.options import Flag, parse
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.settings import SimulateSettings

GESTURES = "gestures"  # in place of a file: the package's own motion
PresetName = Literal["sip6", "tnt10", "totalcapture13", "mvn17"]


@dataclass(frozen=True)
class SimulateOptions:
    """Make a recording with known truth from a motion: what sensors on that person would have measured."""

    motion: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION")]
    """Motion file (.bvh …), or the word gestures for a motion that the package makes."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap) to write."""
    placement: PresetName = "totalcapture13"
    """Where the sensors sit."""
    seed: int = 0
    """Of all errors: the same seed gives the same recording."""
    initial_pose: Literal["none", "n-pose", "t-pose"] = "n-pose"
    """Calibration pose that the person holds before the motion."""
    pose_error_deg: float = 3.0
    """How imperfectly that pose is held, sigma of each joint and axis; 3 add up to 10 to 15 at the hands."""
    seconds: float = 20.0
    """Length of the package's own motion."""
    noise_free: Flag = False
    """Perfect sensors instead of realistic ones; error options given besides are ignored."""
    overwrite: Flag = False
    """Replace the recording if it exists."""
    errors: Annotated[SimulateSettings, tyro.conf.arg(name="", prefix_name=False)] = field(
        default_factory=SimulateSettings
    )


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(SimulateOptions, prog, arguments, none_is_a_value=True)
    from vip_factors.io.atomic import check_target
    from vip_factors.io.mcap_recording import write_recording

    check_target(options.out, options.overwrite)
    from vip_factors.cli.terminal import waiting

    with waiting("simulating"):
        recording = simulated(options)
        write_recording(recording, options.out, overwrite=options.overwrite)
    start, end = recording.interval
    print(f"{len(recording.imus)} sensors, {end - start:.1f} s")
    print(options.out)


def simulated(options: SimulateOptions) -> Recording:
    """The recording that the options ask for."""
    from vip_factors.io.motions.files import read_motion
    from vip_factors.sensors.placement import preset
    from vip_factors.simulate.gestures import gestures
    from vip_factors.simulate.recording import simulate_recording
    from vip_factors.simulate.stance import with_initial_pose

    motion = gestures(options.seconds) if options.motion == GESTURES else read_motion(Path(options.motion))
    if options.initial_pose != "none":
        motion = with_initial_pose(
            motion, options.initial_pose, pose_error_deg=options.pose_error_deg, seed=options.seed
        )
    settings = SimulateSettings.noise_free() if options.noise_free else options.errors
    placement = preset(options.placement, motion.skeleton)
    return simulate_recording(motion, placement, settings, options.seed, motion.name, options.initial_pose)
