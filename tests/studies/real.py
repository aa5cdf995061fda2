"""Real recordings, a row each: hips and knees beside a reference, and what was found fault with."""

import tempfile
import time as clock
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies.gait import (
    Agreement,
    AngleError,
    GaitMotion,
    agreement,
    angle_errors,
    body_errors_mm,
    centres_error_mm,
    gait_of,
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
from vip_factors.io.convert import import_recording
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene


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
        known = [recording for recording in real_recordings(self.data) if self.named in recording.name]
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

        Where a whole body's markers are known, a table of what they tell; where a video is, one of how far it agrees.
        """
        real = [row for row in rows if isinstance(row, RealTrial)]
        head = ["recording", "s", "knee °", "hip °", "centres mm", "live: knee °", "hip °", "mm", "findings"]
        lines: list[list[object]] = []
        for one in real:
            findings = f"{len(one.batch_findings)}, {len(one.live_findings)}"
            lines.append([one.recording, f"{one.seconds:.0f}", *_legs(one.batch), one.centres_mm[0], *_legs(one.live),
                          one.centres_mm[1], findings])  # fmt: skip
            if one.other is not None:
                lines.append([f"— {one.other[0]}", "", *_legs(one.other[1]), *[""] * 5])
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
        if others := [row for row in rows if isinstance(row, RecordingTrial)]:
            yield recordings_table(others)


def _trial(one: RealRecording, folder: Path, with_live: bool, camera: CameraName | None) -> RealTrial:
    recording = converted(one, folder)
    scene = Scene(one.name, (recording,))
    if camera is not None and one.markers is not None:
        scene = filmed(recording, one.markers(folder), camera, seed=zlib.crc32(one.name.encode()))
    begin = clock.process_time()
    estimate = smooth(scene)
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene, DEFAULT) if with_live else []
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
        _video(one, folder, own.motion), batch_s, live_s,
        sentences(dict.fromkeys((*estimate.findings, *own.findings))),
        sentences(finding for answer in answers for finding in answer.findings),
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


def _body_table(trials: Sequence[RealTrial]) -> str:
    """Of the whole body: errors of batch, then of live; the last row is the mean of all."""
    parts = ("body", "legs", "shoulders", "arms")
    found = []
    for trial in trials:
        live = [*_pair(trial.live.get("trunk")), trial.body_mm[1].get("body", np.nan)]
        lean = [*_pair(trial.batch.get("trunk")), *_pair(trial.batch.get("thorax"))]
        found.append([*lean, *(trial.body_mm[0][part] for part in parts), *live])
    rows = [*zip((trial.recording for trial in trials), found, strict=True), ("mean", np.mean(found, axis=0))]
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
