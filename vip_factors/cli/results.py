"""Commands on an estimate: its body, its errors, files of other programs, strides and repetitions."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import UNPREFIXED, Output, WritingOptions, beside, keep_inputs
from vip_factors.cli.terminal import note, print_tables, progress_bar, say, waiting
from vip_factors.cli.views import open_one
from vip_factors.errors import InputError
from vip_factors.io.settings import ExportSettings

if TYPE_CHECKING:
    from vip_factors.evaluate.evaluation import Evaluation


@dataclass(frozen=True)
class BodyOptions(WritingOptions):
    """Write the estimated body into a file (TOML): skeleton, lengths and hinge axes with their uncertainty.

    It replaces the prior from stature in the next recording of the same person: vip-factors convert … --body ada.toml
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap) of a filmed wearer."""
    wearer: str | None = None
    """Name of the wearer; required if there are several."""
    out: Annotated[Path | None, Output(".toml")] = None
    """Body file (.toml) to write; default: ESTIMATE.body.toml."""


def execute_body(options: BodyOptions) -> None:
    """Run ``vip-factors body``."""
    from vip_factors.describe.estimates import hinge_table, length_table
    from vip_factors.io.body_file import body_of_estimate, write_body_file
    from vip_factors.io.mcap_estimate import read_estimate

    out = options.target(options.out, options.estimate, ".body.toml")
    estimate = read_estimate(options.estimate).wearer(options.wearer)
    write_body_file(out, body_of_estimate(estimate, options.estimate.name), options.overwrite)
    assert estimate.body is not None
    print_tables([length_table(estimate.body), hinge_table(estimate.body)])
    say(out)


@dataclass(frozen=True)
class EvaluateOptions(WritingOptions):
    """Compare an estimate with the truth: positions, orientations, path, calibration and consistency.

    The summary names the alignment of each error; tables of joints and sensors follow. Limbs without truth are
    excluded. --json FILE writes all metrics.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    truth: Path | None = None
    """Recording (.mcap) with the truth, or a true motion (.bvh …) that starts at the same time; default: the recording
    in the estimate's file."""
    json: Annotated[Path | None, Output()] = None
    """JSON file for all metrics."""


def execute_evaluate(options: EvaluateOptions) -> None:
    """Run ``vip-factors evaluate``."""
    with waiting(f"comparing {options.estimate.name} with the truth"):
        evaluation = _evaluation(options)
    say(evaluation)
    if options.json is not None:
        with atomic_open(options.json, "w", options.overwrite) as file:
            file.write(evaluation.to_json())


def _evaluation(options: EvaluateOptions) -> "Evaluation":
    from vip_factors.evaluate.comparison import doubts
    from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
    from vip_factors.io.mcap_estimate import read_start
    from vip_factors.sensors.recording import Truth

    opened = open_one(options.estimate)
    scene, estimate = opened.scene, opened.estimate
    if estimate is None:
        raise InputError(f"{options.estimate} holds no estimate: expected a file of vip-factors smooth")
    if options.truth is not None:
        truth = open_one(options.truth)
        if truth.motion is not None:
            return evaluate(estimate.wearer(), Truth(truth.motion))  # of headings and mountings it knows nothing
        scene = truth.scene
    source = options.truth or options.estimate
    if scene is None:
        raise InputError(
            f"{source} holds an estimate and no recording: say with --truth which recording, simulated say, holds the "
            "truth"
        )
    if all(wearer.truth is None for wearer in scene.wearers):
        raise InputError(f"{source} holds no truth: give a recording that does with --truth")
    if odd := doubts(estimate, scene, read_start(options.estimate)[0]):
        warnings.warn(odd, stacklevel=2)
    wearer = scene.wearers[0]
    if len(scene.wearers) == len(estimate.wearers) == 1 and scene.camera is None and wearer.truth is not None:
        return evaluate(estimate.wearers[0], wearer.truth)
    return evaluate_scene(estimate, scene)


@dataclass(frozen=True)
class ExportOptions(WritingOptions):
    """Write an estimate into files of other programs.

    The suffix names the format:
    - .bvh, .glb, .fbx (through Blender): animation; Maya and MotionBuilder expect --bvh.unit cm.
    - .csv: joint positions and joint angles, a row a frame; walk.angles.csv or walk.positions.csv has one of the two.
    - .trc, .mot, .sto: markers, joint angles and segment orientations for OpenSim.
    - .c3d: markers and joint angles.
    - .npz: poses as in AMASS; .pkl: poses, camera and 2D poses as in 3DPW.

    Example: vip-factors export walk.estimate.mcap walk.bvh walk.trc walk.mot

    Several wearers in a format that holds one person get a file each: walk.npz becomes walk.Ada.npz and walk.Bea.npz.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE FILE [FILE …]")]
    """Estimate (.mcap), and the files to write."""
    settings: Annotated[ExportSettings, UNPREFIXED] = field(default_factory=ExportSettings)


def execute_export(options: ExportOptions) -> None:
    """Run ``vip-factors export``."""
    if len(options.files) < 2:
        raise InputError("expected an estimate and at least one file to write: vip-factors export ESTIMATE FILE …")
    from vip_factors.io.export.files import export, export_format
    from vip_factors.io.mcap_estimate import read_estimate, read_start

    source, *targets = options.files
    keep_inputs([source], targets)
    for target in targets:
        export_format(target)
    with waiting(f"reading {source.name}"):
        estimate = read_estimate(source)
        start_ns, clock_s = read_start(source)
    for target in targets:
        with waiting(f"writing {target.name}"):
            written = export(estimate, target, options.settings, options.overwrite, note, start_ns, clock_s)
        for path in written:
            say(path)


@dataclass(frozen=True)
class GaitOptions(WritingOptions):
    """Detect strides and write their parameters: strides.csv, figures.csv, curves.csv (joint angles over the cycle),
    gait.json and gait.png.

    Events and lengths come from the foot sensors if --recording is given, otherwise from the motion of the legs.
    """

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE|RECORDING")]
    """Estimate (.mcap), or a recording (.mcap), which is reconstructed first."""
    recording: Path | None = None
    """Recording (.mcap) of the estimate; default: the one in the estimate's file."""
    count: tuple[Literal["start", "stop", "turn", "pause"], ...] = ()
    """Kinds of strides to include in the means."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder to write; default: beside the first file, ending in .gait."""


def execute_gait(options: GaitOptions) -> None:
    """Run ``vip-factors gait``."""
    from vip_factors.gait.analysis import gaits_of
    from vip_factors.gait.files import write_gait
    from vip_factors.io.mcap_recording import read_scene

    with progress_bar() as progress:
        progress("reading", 0.0)
        opened = open_one(options.source)
        scene = opened.scene if options.recording is None else read_scene(options.recording)
        if (estimate := opened.estimate) is None:
            if opened.scene is None:
                raise InputError(f"{options.source} is a motion: expected an estimate or a recording (.mcap)")
            from vip_factors.pipeline import smooth

            estimate = smooth(opened.scene, progress=progress)
        gaits = gaits_of(estimate, scene, options.count)
    if not any(gait.strides for gait in gaits):
        raise InputError(f"{options.source}: no walking was detected: no foot takes two steps")
    for gait in gaits:
        say(gait)
    for path in write_gait(gaits, options.out or beside(options.source, ".gait"), options.overwrite):
        say(path)


@dataclass(frozen=True)
class RepetitionOptions(WritingOptions):
    """Count squats, lunges, jumps and curls, and write their times, depth, tempo, ranges and symmetry into
    repetitions.csv, repetitions.json and repetitions.png.

    Standard deviations need an estimate made without --no-covariance.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder to write; default: beside the estimate, ending in .repetitions."""


def execute_repetitions(options: RepetitionOptions) -> None:
    """Run ``vip-factors repetitions``."""
    from vip_factors.io.mcap_estimate import read_estimate
    from vip_factors.repetitions.files import repetition_table, write_repetitions
    from vip_factors.repetitions.repetitions import repetitions_of

    with waiting(f"reading {options.estimate.name}"):
        wearers = tuple(map(repetitions_of, read_estimate(options.estimate).wearers))
    for wearer in wearers:
        if wearer.repetitions:
            print_tables([repetition_table(wearer)])
        else:
            say(wearer.summary()[0])
    for path in write_repetitions(wearers, options.out or beside(options.estimate, ".repetitions"), options.overwrite):
        say(path)
