"""Real recordings, a row each: hips, knees and headings beside a reference, and what was found fault with."""

import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from vip_factors.benchmark.leg_angles import LegMotion, angle_errors, centres_error_mm, legs_of
from vip_factors.benchmark.real_recordings import RealRecording, real_recordings
from vip_factors.benchmark.recordings import smoothed_motion, streamed
from vip_factors.benchmark.walk import AngleError
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.evaluate.table import json_text, number
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.io.convert import import_recording
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings


@dataclass(frozen=True)
class RealTrial:
    """One real recording.

    Attributes:
        recording: its name.
        seconds: of it.
        batch, live: errors by joint of ``smooth``, and of the smoothed poses of ``stream``; empty without a reference.
        other: somebody else's name and errors.
        centres_mm: of hips, knees and ankles, batch and live, a rigid motion of each frame taken out; NaN without a
            reference.
        heading_deg: median and largest error of headings; NaN without a reference.
        batch_cpu_s, live_cpu_s: of the whole recording, this process alone.
        batch_findings, live_findings: sentences, each as often as it was told.
    """

    recording: str
    seconds: float
    batch: Mapping[str, AngleError]
    live: Mapping[str, AngleError]
    other: tuple[str, Mapping[str, AngleError]] | None
    centres_mm: tuple[float, float]
    heading_deg: tuple[float, float]
    batch_cpu_s: float
    live_cpu_s: float
    batch_findings: tuple[str, ...]
    live_findings: tuple[str, ...]


def run_real(
    folder: Path, named: str, with_live: bool, tell: Callable[[str, float], None],
    keep: Callable[[tuple[RealTrial, ...]], None] = lambda so_far: None,
) -> tuple[RealTrial, ...]:  # fmt: skip
    """Each recording in the folder whose name contains some letters is converted, smoothed and, if wanted, streamed.

    Raises:
        InputError: if there is none.
    """
    chosen = [one for one in real_recordings(folder) if named in one.name]
    if not chosen:
        raise InputError(
            f"{folder}: no recording '{named}' in it" if named else
            f"{folder}: none of the public recordings in it; expected folders like xsens_vicon_walk, opensense, vidimu"
        )  # fmt: skip
    trials: tuple[RealTrial, ...] = ()
    for done, one in enumerate(chosen):
        tell(one.name, done / len(chosen))
        trials += (_trial(one, folder, with_live),)
        keep(trials)
    return trials


def real_table(trials: Sequence[RealTrial]) -> str:
    """Markdown: RMSE in degrees, mean of both sides, in brackets with the mean removed; findings batch, live."""
    lines = [
        "| recording | s | knee ° | hip ° | centres mm | live: knee ° | hip ° | mm | headings ° | findings |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in trials:
        cells = [one.recording, f"{one.seconds:.0f}", _both(one.batch, "knee"), _both(one.batch, "hip")]
        cells += [number(one.centres_mm[0]), _both(one.live, "knee"), _both(one.live, "hip"), number(one.centres_mm[1])]
        cells += [_headings(one.heading_deg)]
        lines.append("| " + " | ".join([*cells, f"{len(one.batch_findings)}, {len(one.live_findings)}"]) + " |")
        if one.other is not None:
            name, errors = one.other
            lines.append(f"| — {name} | | {_both(errors, 'knee')} | {_both(errors, 'hip')} | | | | | | |")
    return "\n".join(lines) + "\n"


def real_json(trials: Sequence[RealTrial]) -> str:
    """Everything, as JSON."""
    return json_text({one.recording: asdict(one) for one in trials})


def _both(errors: Mapping[str, AngleError], joint: str) -> str:
    if f"left_{joint}" not in errors:
        return "n/a"
    left, right = errors[f"left_{joint}"], errors[f"right_{joint}"]
    return f"{(left.rmse + right.rmse) / 2:.1f} ({(left.without_offset + right.without_offset) / 2:.1f})"


def _headings(degrees: tuple[float, float]) -> str:
    return f"{degrees[0]:.0f}, at most {degrees[1]:.0f}" if np.isfinite(degrees[0]) else "n/a"


def _trial(one: RealRecording, folder: Path, with_live: bool) -> RealTrial:
    recording = _converted(one, folder)
    scene = Scene(one.name, (recording,))
    factors = Settings().factors
    agreeing = replace(factors, agreeing_headings=replace(factors.agreeing_headings, sigma_deg=one.agree_deg))
    begin = clock.process_time()
    estimate = smooth(recording, Settings(factors=agreeing))
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene, LiveSettings(factors=agreeing)) if with_live else []
    live_s = clock.process_time() - begin
    reference = None if one.angles is None else one.angles(folder)

    motions = (estimate.motion, smoothed_motion(answers, 0, scene))
    batch, live = (_errors(motion, reference) for motion in motions)
    other = None
    if one.other is not None and reference is not None:
        other = (one.other[0], angle_errors(one.other[1](folder), reference))
    start, end = recording.interval
    return RealTrial(
        one.name, end - start, batch[0], live[0], other, (batch[1], live[1]),
        _heading_errors(estimate.calibration, one.headings_deg), batch_s, live_s, estimate.findings,
        tuple(sentence for answer in answers for sentence in answer.findings),
    )  # fmt: skip


def _converted(one: RealRecording, folder: Path) -> Recording:
    if not one.columns:
        return import_recording(folder / one.log, one.options)
    with tempfile.TemporaryDirectory() as place:
        columns = Path(place) / "columns.toml"
        columns.write_text(one.columns, encoding="utf-8")
        return import_recording(folder / one.log, replace(one.options, columns=columns))


def _errors(motion: Motion | None, reference: LegMotion | None) -> tuple[Mapping[str, AngleError], float]:
    if motion is None or reference is None:
        return {}, np.nan
    ours = legs_of(motion)
    return angle_errors(ours, reference), centres_error_mm(ours, reference)


def _heading_errors(found: Calibration, reference: Mapping[str, float]) -> tuple[float, float]:
    """Median and largest in degrees; the whole suit may stand turned."""
    names = [name for name in reference if name in found]
    if not names:
        return np.nan, np.nan
    off = np.array([found[name].heading - np.deg2rad(reference[name]) for name in names])
    off = np.abs(wrap_angle(off - np.angle(np.exp(1j * off).sum())))
    return float(np.rad2deg(np.median(off))), float(np.rad2deg(off.max()))
