"""``vip-factors demo``: from nothing to a reconstruction that can be looked at, in one command."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import WritingOptions
from vip_factors.cli.terminal import progress_bar, say
from vip_factors.ranges import NotNegativeInt, Range, Rate


@dataclass(frozen=True)
class DemoOptions(WritingOptions):
    """Simulate a walk with unknown headings and mountings, reconstruct it, and compare and draw the result."""

    out: Path = Path("vip_factors_demo")
    """Folder for the files."""
    placement: Literal["sip6", "tnt10", "totalcapture13", "mvn17"] = "totalcapture13"
    """Preset of sensor sites."""
    seconds: Annotated[float, Range(above=0, most=86_400)] = 12.0
    """Length of the walk, after a calibration pose of two seconds."""
    seed: NotNegativeInt = 0
    """Seed of the sensor errors."""
    frame_rate: Rate = 60.0
    """Frames per second of the reconstruction."""


HEADING_OFFSET_DEG = 45.0  # thesis 4.4.2: "imprecise" placement
MOUNTING_ERROR_DEG = 10.0  # straps put on by eye


def main(options: DemoOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.api import simulate, write
    from vip_factors.evaluate.evaluation import evaluate
    from vip_factors.pipeline import smooth
    from vip_factors.settings import Settings
    from vip_factors.simulate.settings import SceneSettings, SimulateSettings
    from vip_factors.viz.drawn_scene import drawn_wearer
    from vip_factors.viz.picture import filmstrip
    from vip_factors.viz.rerun_view import show

    files = {
        name: options.out / name
        for name in ("recording.mcap", "estimate.mcap", "evaluation.json", "demo.png", "demo.rrd")
    }
    options.out.mkdir(parents=True, exist_ok=True)
    for path in files.values():
        check_target(path, options.overwrite)
    with progress_bar() as progress:
        progress("simulating", 0.0)
        errors = SimulateSettings(heading_offset_deg=HEADING_OFFSET_DEG, mounting_error_deg=MOUNTING_ERROR_DEG)
        recording = simulate(
            placement=options.placement, seconds=options.seconds, seed=options.seed, settings=SceneSettings(imu=errors)
        ).wearers[0]
        write(recording, files["recording.mcap"], options.overwrite)
        estimate = smooth(recording, Settings(frame_rate=options.frame_rate), progress).wearer()
        write(estimate, files["estimate.mcap"], options.overwrite)
        progress("drawing", 0.0)
        truth = recording.truth
        assert truth is not None
        evaluation = evaluate(estimate, truth)
        with atomic_open(files["evaluation.json"], "w", options.overwrite) as file:
            file.write(evaluation.to_json())
        drawn = drawn_wearer(recording, estimate)
        title = f"A simulated walk, reconstructed from body-worn sensors, {estimate.method}"
        filmstrip(drawn, files["demo.png"], title=title, overwrite=options.overwrite)
        show(drawn, files["demo.rrd"], options.overwrite)
    for name in ("mpjpe", "mpjae", "heading_error", "mounting_error"):
        if name in evaluation.metrics:
            metric = evaluation.metrics[name]
            say(f"{name:<15} {metric.value:6.1f} {metric.unit}")
    for path in files.values():
        say(path)
