"""SOP and SIP with six sensors, simulated from motion capture that the pose prior has not seen (thesis 3.4, 4.4.2)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.studies.declared_pose import with_nominal_pose
from tests.studies.first_frame import calibrated_at_first_frame
from vip_factors.body.held_out_clips import HELD_OUT_CLIPS
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.metrics import mpjae, mpjpe
from vip_factors.io.motions.files import motion_files, read_motion
from vip_factors.pipeline import smooth
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.stance import with_initial_pose

POSE, HOLD_S, BLEND_S = "t-pose", 2.0, 1.0  # TotalCapture's subjects start in a T-pose
LEAST_S = 0.5  # of a clip left after the blend
Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class SipTrials:
    """Which trials are run."""

    seconds: float = 8.0  # of each clip, from its middle: lest the long takes of acting set the run time
    seeds: int = 1  # recordings of each clip, each with other sensor errors
    # Of the held T-pose, per joint and axis. Along the chain 8° add up to some 30° at a forearm: told, not shown.
    pose_error_deg: float = 8.0
    sensors: SimulateSettings = field(default_factory=SimulateSettings.realistic)
    settings: Settings = field(default_factory=Settings)  # of the estimator; its calibration is each variant's own


@dataclass(frozen=True)
class Variant:
    """A tracker and what it is told.

    Attributes:
        method: ``"SOP"`` or ``"SIP"``.
        start: ``"true pose"``: mountings from the true first pose; ``"zero pose"``: from the nominal T-pose, taken at
            its word; ``"zero pose, calibrated"``: from there on estimated, as the pipeline does by default.
    """

    method: str
    start: str

    @property
    def calibration(self) -> CalibrationSettings:
        """What the pipeline is to do about headings and mountings."""
        free = self.start == "zero pose, calibrated"
        return CalibrationSettings(
            estimate_headings=free, estimate_mountings=free, from_truth=self.start == "true pose"
        )


VARIANTS = (
    Variant("SOP", "true pose"),
    Variant("SIP", "true pose"),
    Variant("SOP", "zero pose"),
    Variant("SIP", "zero pose"),
    Variant("SIP", "zero pose, calibrated"),
)


@dataclass(frozen=True)
class Trial:
    """Errors of one variant on one recording: MPJPE in mm, MPJAE in degrees, over ``frames`` frames."""

    variant: Variant
    kind: str
    clip: str
    seed: int
    frames: int
    mpjpe_mm: float
    mpjae_deg: float
    solve_seconds: float


def run_sip(
    motions: Path, trials: SipTrials | None = None, tell: Tell | None = None,
    clips: dict[str, Sequence[str]] | None = None,
) -> list[Trial]:  # fmt: skip
    """Run all variants on all clips.

    Args:
        motions: folder with the motion files of the clips, searched with all folders below it.
        trials: how much, and with which errors.
        tell: called with what is done and the fraction of it.
        clips: names of clips by kind; those held out of the pose prior's training if absent.

    Raises:
        InputError: if a clip has no file in the folder, or is too short.
    """
    trials, clips = trials or SipTrials(), clips or dict(HELD_OUT_CLIPS)
    files = find_clips(motions, [name for names in clips.values() for name in names])
    work = [(kind, name, seed) for kind, names in clips.items() for name in names for seed in range(trials.seeds)]
    results = []
    for done, (kind, name, seed) in enumerate(work):
        recording = recording_of(read_motion(files[name]), name, trials, seed)
        for number, variant in enumerate(VARIANTS):
            if tell is not None:
                tell("benchmark", (done + number / len(VARIANTS)) / len(work))
            results.append(_trial(recording, variant, kind, name, seed, trials))
    return results


def find_clips(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    """The file of each clip, found by its stem.

    Raises:
        InputError: if one is missing.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of motion files")
    files = {path.stem: path for path in motion_files(folder)}
    missing = [name for name in names if name not in files]
    if missing:
        raise InputError(f"{folder}: no motion file named {missing[0]}; the benchmark needs {', '.join(names)}")
    return {name: files[name] for name in names}


def recording_of(motion: Motion, name: str, trials: SipTrials, seed: int) -> Recording:
    """The middle of a clip after a carelessly held T-pose, as six realistic sensors record it."""
    length = len(motion) / motion.rate
    if length < BLEND_S + LEAST_S:
        raise InputError(f"clip {name} lasts {length:.2f} s: expected at least {BLEND_S + LEAST_S:g} s")
    count = min(len(motion), round(trials.seconds * motion.rate) + 1)
    start = (len(motion) - count) // 2
    middle = replace(motion.frames(slice(start, start + count)), start=0.0)
    posed = with_initial_pose(middle, POSE, HOLD_S, BLEND_S, trials.pose_error_deg, seed)
    return simulate_recording(posed, preset("sip6", motion.skeleton), trials.sensors, seed, name, POSE)


def _trial(recording: Recording, variant: Variant, kind: str, name: str, seed: int, trials: SipTrials) -> Trial:
    settings = with_nominal_pose(trials.settings)
    settings = replace(settings, acceleration=variant.method == "SIP", calibration=variant.calibration)
    told = recording
    if variant.start == "true pose":
        told = replace(calibrated_at_first_frame(recording), initial_pose="none")
    estimate = smooth(told, settings)
    if recording.truth is None:
        raise InputError(f"recording '{recording.name}' has no truth")
    moving = estimate.motion.frames(slice(int(np.ceil((HOLD_S + BLEND_S) * estimate.motion.rate)), None))
    motion, truth, _ = common_frames(moving, recording.truth.motion)
    seconds = sum(report.seconds for report in estimate.reports)
    return Trial(variant, kind, name, seed, len(motion), mpjpe(motion, truth), mpjae(motion, truth), seconds)


def means_by_kind(trials: Sequence[Trial], variant: Variant) -> dict[str, tuple[float, float]]:
    """``(MPJPE mm, MPJAE deg)`` of a variant by kind of motion, every recording alike, and ``mean`` of the kinds."""
    return dict(_means(trials, variant))


def _means(trials: Sequence[Trial], variant: Variant) -> Iterator[tuple[str, tuple[float, float]]]:
    own = [trial for trial in trials if trial.variant == variant]
    kinds = list(dict.fromkeys(trial.kind for trial in own))
    table = np.array(
        [np.mean([(t.mpjpe_mm, t.mpjae_deg) for t in own if t.kind == kind], axis=0) for kind in kinds]
    ).reshape(-1, 2)
    for name, (position, angle) in zip([*kinds, "mean"], [*table, table.mean(axis=0)], strict=True):
        yield name, (float(position), float(angle))
