"""``vip-factors sync``: how far the video's clock is off the sensors', and a scene that says so."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.options import Flag, Output, WritingOptions
from vip_factors.cli.terminal import say, waiting
from vip_factors.errors import InputError
from vip_factors.settings import MAX_OFFSET_S

if TYPE_CHECKING:
    from vip_factors.initialise.clock import ClockOffset


@dataclass(frozen=True)
class SyncOptions(WritingOptions):
    """Estimate the offset between the clocks of video and sensors, and write it into a copy of the scene.

    The offset, in seconds to add to the video's times, is estimated from the motion of people. If the motion does not
    determine it, an error names the reason and no file is written. Above one minute the clock drift is estimated too.
    """

    scene: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """Scene (.mcap): sensors, and a camera with detections."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Scene (.mcap) to write; default: SCENE.synced.mcap."""
    seconds: float | None = None
    """Known offset in seconds; it is written without an estimate."""
    dry_run: Flag = False
    """Print the estimate and write no file."""
    max_offset: float = MAX_OFFSET_S
    """Largest offset to search, in seconds in both directions."""


def main(options: SyncOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.api import with_clock
    from vip_factors.initialise.clock import find_clock_offset
    from vip_factors.io.mcap_recording import read_scene, write_recording
    from vip_factors.sensors.camera import VideoClock

    out = options.out if options.dry_run else options.target(options.out, options.scene, ".synced.mcap")
    scene = read_scene(options.scene)
    if scene.camera is None:
        raise InputError(f"{options.scene} has no camera: there is no clock to compare with the sensors'")
    seconds = options.seconds
    for number, camera in enumerate(scene.cameras):
        clock, label = VideoClock(seconds or 0.0), f"camera '{camera.name}': " if len(scene.cameras) > 1 else ""
        if seconds is None:
            with waiting("comparing video and sensors"):
                offset = find_clock_offset(scene, options.max_offset, number)
            say(label + offset_text(offset, camera.clock.offset))
            if not offset.determined:
                if options.dry_run:
                    continue
                raise InputError(f"{options.scene}: {label}{offset.sentence}; or give the offset as --seconds")
            clock = offset.clock
        scene = with_clock(scene, clock, number)
    if options.dry_run or out is None:
        return
    write_recording(scene, out, overwrite=options.overwrite)
    say(out)


def offset_text(offset: "ClockOffset", previous_s: float = 0.0) -> str:
    """Format an offset as a small table with the other candidates."""
    lines = [offset.sentence] if offset.determined else []
    if offset.determined and previous_s:
        lines.append(f"the scene said {previous_s:+.3f} s before")
    lines.append(f"  {'offset':>10}  agreement")
    sigma = f"± {1e3 * offset.sigma:.0f} ms" if offset.determined else "undetermined"
    lines.append(f"  {offset.seconds:+8.3f} s  {100:7.0f} %  {sigma}")
    lines += [f"  {seconds:+8.3f} s  {100 * share:7.0f} %" for seconds, share in offset.alternatives[:4]]
    return "\n".join(lines)
