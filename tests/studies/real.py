"""Real recordings, a row each: hips, knees and headings beside a reference, and what was found fault with."""

import tempfile
import time as clock
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies.filmed_markers import CameraName, filmed
from tests.studies.leg_angles import GaitMotion, angle_errors, body_errors_mm, centres_error_mm, gait_of
from tests.studies.real_recordings import RealRecording, real_recordings
from tests.studies.recordings import smoothed_motion, streamed
from tests.studies.strides import StrideErrors, stride_errors
from tests.studies.video_agreement import Agreement, agreement
from tests.studies.walk import AngleError
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.io.convert import import_recording
from vip_factors.live.settings import LiveSettings
from vip_factors.pipeline import smooth_scene
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
        body_mm: the same of the whole body and its parts, batch and live; empty where not all of them are known.
        video: how far ``smooth`` and OpenSense agree with somebody else's video; empty where there is none.
        strides: errors of ``smooth`` where strides were measured.
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
    body_mm: tuple[Mapping[str, float], Mapping[str, float]]
    video: Mapping[str, Agreement]
    strides: StrideErrors | None
    heading_deg: tuple[float, float]
    batch_cpu_s: float
    live_cpu_s: float
    batch_findings: tuple[str, ...]
    live_findings: tuple[str, ...]


def run_real(
    folder: Path, named: str, with_live: bool, tell: Callable[[str, float], None],
    keep: Callable[[tuple[RealTrial, ...]], None] = lambda so_far: None, camera: CameraName | None = None,
) -> tuple[RealTrial, ...]:  # fmt: skip
    """Each recording in the folder whose name contains some letters is converted, smoothed and, if wanted, streamed.

    With a camera, only those of which a whole body's markers are known, and what a detector would have seen of these.

    Raises:
        InputError: if there is none.
    """
    chosen = [one for one in real_recordings(folder) if named in one.name and (camera is None or one.markers)]
    if not chosen and camera is not None:
        raise InputError(
            f"{folder}: no recording '{named}' with markers of the whole body in it, for a camera to film; expected "
            "geneva_gait"
        )
    if not chosen:
        raise InputError(
            f"{folder}: no recording '{named}' in it" if named else
            f"{folder}: none of the public recordings in it; expected folders like xsens_vicon_walk, opensense, vidimu"
        )  # fmt: skip
    trials: tuple[RealTrial, ...] = ()
    for done, one in enumerate(chosen):
        tell(one.name, done / len(chosen))
        trials += (_trial(one, folder, with_live, camera),)
        keep(trials)
    return trials


def _trial(one: RealRecording, folder: Path, with_live: bool, camera: CameraName | None) -> RealTrial:
    recording = _converted(one, folder)
    scene = Scene(one.name, (recording,))
    if camera is not None and one.markers is not None:
        scene = filmed(recording, one.markers(folder), camera, seed=zlib.crc32(one.name.encode()))
    factors = Settings().factors
    agreeing = replace(factors, agreeing_headings=replace(factors.agreeing_headings, sigma_deg=one.agree_deg))
    begin = clock.process_time()
    estimate = smooth_scene(scene, Settings(factors=agreeing))
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene, LiveSettings(factors=agreeing)) if with_live else []
    live_s = clock.process_time() - begin
    reference = None if one.angles is None else one.angles(folder)

    (own,) = estimate.wearers
    motions = (own.motion, smoothed_motion(answers, 0, scene))
    batch, live = (_errors(motion, reference) for motion in motions)
    other = None
    if one.other is not None and reference is not None:
        other = (one.other[0], angle_errors(one.other[1](folder), reference))
    start, end = recording.interval
    return RealTrial(
        one.name, end - start, batch[0], live[0], other, (batch[1], live[1]), (batch[2], live[2]),
        _video(one, folder, own.motion), _strides(one, folder, own.motion),
        _heading_errors(own.calibration, one.headings_deg), batch_s, live_s,
        tuple(dict.fromkeys((*estimate.findings, *own.findings))),
        tuple(sentence for answer in answers for sentence in answer.findings),
    )  # fmt: skip


def _converted(one: RealRecording, folder: Path) -> Recording:
    held = one.options.pose_from
    options = one.options if held is None else replace(one.options, pose_from=str(folder / held))
    with tempfile.TemporaryDirectory() as place:
        columns, sites = Path(place) / "columns.toml", Path(place) / "placement.toml"
        columns.write_text(one.columns, encoding="utf-8")
        sites.write_text(one.sites, encoding="utf-8")
        if one.columns:
            options = replace(options, columns=columns)
        if one.sites:
            options = replace(options, placement=sites)
        return import_recording(folder / one.log, options)


def _errors(
    motion: Motion | None, reference: GaitMotion | None
) -> tuple[Mapping[str, AngleError], float, Mapping[str, float]]:
    if motion is None or reference is None:
        return {}, np.nan, {}
    ours = gait_of(motion)
    return angle_errors(ours, reference), centres_error_mm(ours, reference), body_errors_mm(ours, reference)


def _video(one: RealRecording, folder: Path, motion: Motion) -> dict[str, Agreement]:
    if one.video is None:
        return {}
    joint, video, opensense = one.video
    seen, other = video(folder), opensense(folder)
    found = {"smooth": agreement(joint, gait_of(motion), seen)}
    return found if other is None else found | {"OpenSense": agreement(joint, other, seen)}


def _strides(one: RealRecording, folder: Path, motion: Motion) -> StrideErrors | None:
    return None if one.strides is None else stride_errors(motion, one.strides(folder))


def _heading_errors(found: Calibration, reference: Mapping[str, float]) -> tuple[float, float]:
    """Median and largest in degrees; the whole suit may stand turned."""
    names = [name for name in reference if name in found]
    if not names:
        return np.nan, np.nan
    off = np.array([found[name].heading - np.deg2rad(reference[name]) for name in names])
    off = np.abs(wrap_angle(off - np.angle(np.exp(1j * off).sum())))
    return float(np.rad2deg(np.median(off))), float(np.rad2deg(off.max()))
