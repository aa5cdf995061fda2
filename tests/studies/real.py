"""Real recordings, a row each: hips, knees and headings beside a reference, and what was found fault with."""

import tempfile
import time as clock
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies import qmt_mat
from tests.studies.gait import (
    Agreement,
    AngleError,
    GaitMotion,
    StrideErrors,
    agreement,
    angle_errors,
    body_errors_mm,
    centres_error_mm,
    gait_of,
    stride_errors,
)
from tests.studies.live_run import smoothed_motion, streamed
from tests.studies.marker_body import SIDES, CameraName, filmed
from tests.studies.real_recordings import RealRecording, real_recordings
from tests.studies.recordings import DEFAULT, RecordingTrial, recording_trials, recordings_table
from tests.studies.study import Study, Tell, table
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.io.convert import import_recording, recording_of_log
from vip_factors.io.mcap_recording import read_scene
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


@dataclass(frozen=True, kw_only=True)
class Real(Study):
    """Public recordings of real people, and any scenes beside them: all that was not made by this project."""

    data: Path
    """Folder with the public recordings: xsens_vicon_walk, xsens_treadmill_optical, opensense, vidimu and so on."""
    named: str = ""
    """Only those whose names contain this."""
    camera: CameraName | None = None
    """Only those with markers of the whole body, and with what a detector would have seen of these: a camera that
    stands, or one that is carried."""
    scenes: tuple[Path, ...] = ()
    """Recordings or scenes (.mcap) with a truth of their own, in a table below."""
    live: Flag = True
    """Stream them too."""

    def rows(self, tell: Tell) -> Iterator[RealTrial | RecordingTrial]:
        known = [one for one in real_recordings(self.data) if self.named in one.name]
        chosen = [one for one in known if self.camera is None or one.markers]
        if not chosen:
            raise InputError(
                f"{self.data}: no recording '{self.named}' with markers of the whole body in it, for a camera to film; "
                "expected geneva_gait" if self.camera is not None else
                f"{self.data}: no recording '{self.named}' in it" if self.named else
                f"{self.data}: none of the public recordings in it; expected folders like xsens_vicon_walk, opensense"
            )  # fmt: skip
        for done, one in enumerate(chosen):
            tell(one.name, done / len(chosen))
            yield _trial(one, self.data, self.live, self.camera)
        for path in self.scenes:
            tell(path.name, 1.0)
            yield from recording_trials(path.name, read_scene(path), self.live)

    def tables(self, rows: Sequence[RealTrial | RecordingTrial]) -> Iterator[str]:
        """RMSE in degrees, mean of both sides, in brackets with the mean removed; findings batch, live.

        Where a whole body's markers are known, a table of what they tell; where a video or strides are, one of how far
        these agree.
        """
        real = [one for one in rows if isinstance(one, RealTrial)]
        head = [
            "recording",
            "s",
            "knee °",
            "hip °",
            "centres mm",
            "live: knee °",
            "hip °",
            "mm",
            "headings °",
            "findings",
        ]
        lines: list[list[object]] = []
        for one in real:
            findings = f"{len(one.batch_findings)}, {len(one.live_findings)}"
            lines.append([one.recording, f"{one.seconds:.0f}", *_legs(one.batch), one.centres_mm[0], *_legs(one.live),
                          one.centres_mm[1], _headings(one.heading_deg), findings])  # fmt: skip
            if one.other is not None:
                lines.append([f"— {one.other[0]}", "", *_legs(one.other[1]), *[""] * 6])
        yield table(head, lines)
        if bodies := [one for one in real if one.body_mm[0]]:
            yield _body_table(bodies)
        if any(one.video for one in real):
            yield table(
                ["recording", "by", "joint", "lag s", "r", "difference °", "bends °"],
                [[one.recording, name, seen.joint, f"{seen.lag_s:.2f}", f"{seen.correlation:.2f}",
                  _offset(seen.degrees, seen.without_offset), f"{seen.least:.0f} to {seen.most:.0f}"]
                 for one in real for name, seen in one.video.items()],
            )  # fmt: skip
        if any(one.strides for one in real):
            yield table(
                ["recording", "strides", "length m", "error: mean cm", "standard deviation cm"],
                [[one.recording, seen.count, f"{seen.length:.2f}", f"{100 * seen.error_mean:+.1f}", 100 * seen.error_sd]
                 for one in real if (seen := one.strides) is not None],
            )  # fmt: skip
        if others := [one for one in rows if isinstance(one, RecordingTrial)]:
            yield recordings_table(others)


def _trial(one: RealRecording, folder: Path, with_live: bool, camera: CameraName | None) -> RealTrial:
    recording = converted(one, folder)
    scene = Scene(one.name, (recording,))
    if camera is not None and one.markers is not None:
        scene = filmed(recording, one.markers(folder), camera, seed=zlib.crc32(one.name.encode()))
    factors = Settings().factors
    agreeing = replace(factors, agreeing_headings=replace(factors.agreeing_headings, sigma_deg=one.agree_deg))
    begin = clock.process_time()
    estimate = smooth(scene, Settings(factors=agreeing))
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene, LiveSettings(factors=agreeing)) if with_live else []
    live_s = clock.process_time() - begin
    reference = None if one.angles is None else one.angles(folder)

    (own,) = estimate.wearers
    motions = (own.motion, smoothed_motion(answers, 0, scene, DEFAULT.frame_rate))
    batch, live = (_errors(motion, reference) for motion in motions)
    other = None
    if one.other is not None and reference is not None:
        other = (one.other[0], angle_errors(one.other[1](folder), reference))
    start, end = recording.interval
    return RealTrial(
        one.name, end - start, batch[0], live[0], other, (batch[1], live[1]), (batch[2], live[2]),
        _video(one, folder, own.motion), _strides(one, folder, own.motion),
        _heading_errors(own.calibration, one.headings_deg), batch_s, live_s,
        sentences(dict.fromkeys((*estimate.findings, *own.findings))),
        sentences(one for answer in answers for one in answer.findings),
    )  # fmt: skip


def converted(one: RealRecording, folder: Path) -> Recording:
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
        path = folder / one.log
        return (
            recording_of_log(qmt_mat.read(path), path, options)
            if path.suffix == ".mat"
            else import_recording(path, options)
        )


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


def _body_table(trials: Sequence[RealTrial]) -> str:
    """Of the whole body: errors of batch, then of live; the last row is the mean of all."""
    parts = ("body", "legs", "shoulders", "arms")
    found = []
    for one in trials:
        live = [*_pair(one.live.get("trunk")), one.body_mm[1].get("body", np.nan)]
        lean = [*_pair(one.batch.get("trunk")), *_pair(one.batch.get("thorax"))]
        found.append([*lean, *(one.body_mm[0][part] for part in parts), *live])
    rows = [*zip((one.recording for one in trials), found, strict=True), ("mean", np.mean(found, axis=0))]
    head = ["recording", "trunk °", "thorax °", *(f"{one} mm" for one in parts), "live: trunk °", "mm"]
    return table(head, [[k, _offset(*v[:2]), _offset(*v[2:4]), *v[4:8], _offset(*v[8:10]), v[10]] for k, v in rows])


def _pair(error: AngleError | None) -> tuple[float, float]:
    return (np.nan, np.nan) if error is None else (error.rmse, error.without_offset)


def _offset(whole: float, without: float) -> str:
    return f"{whole:.1f} ({without:.1f})" if np.isfinite(whole) else "n/a"


def _legs(errors: Mapping[str, AngleError]) -> list[str]:
    """Knees and hips, each the mean of both sides."""
    sides = [[_pair(errors.get(f"{side}_{joint}")) for side in SIDES] for joint in ("knee", "hip")]
    return [_offset(*np.mean(pairs, axis=0)) for pairs in sides]


def _headings(degrees: tuple[float, float]) -> str:
    return f"{degrees[0]:.0f}, at most {degrees[1]:.0f}" if np.isfinite(degrees[0]) else "n/a"
