"""Any recordings, one row for each wearer: batch and live beside their truth, and what is found fault with."""

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from tests.studies.live_run import smoothed_motion, streamed
from tests.studies.study import Study, Tell, columns
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, camera_pairs
from vip_factors.evaluate.evaluation import evaluate_motion
from vip_factors.evaluate.metrics import common_frames
from vip_factors.findings import sentences
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings

METRICS = ("mpjpe", "mpjae", "knee_flexion_rmse")
NOTHING = (np.nan, np.nan, np.nan)
DEFAULT = LiveSettings()


@dataclass(frozen=True)
class RecordingTrial:
    """One wearer of a recording.

    Attributes:
        recording, wearer: their names.
        seconds: of it.
        batch, live, late: MPJPE (mm), MPJAE (°) and RMSE of knee flexion (°) of ``smooth``, of the smoothed poses of
            ``stream``, and of these in the second half; NaN without truth.
        batch_cpu_s, live_cpu_s: of the whole recording, this process alone.
        batch_findings, live_findings: sentences, each as often as it was told.
        who_is_who: precision and recall of the wearer's detections before the first camera, in percent, of ``smooth``;
            NaN where the recording does not say whom they show.
    """

    recording: str
    wearer: str
    seconds: float
    batch: tuple[float, ...]
    live: tuple[float, ...]
    late: tuple[float, ...]
    batch_cpu_s: float
    live_cpu_s: float
    batch_findings: tuple[str, ...]
    live_findings: tuple[str, ...]
    who_is_who: tuple[float, float] = (np.nan, np.nan)


@dataclass(frozen=True, kw_only=True)
class Recordings(Study):
    """Recordings of your own, smoothed and streamed, one row for each wearer: errors where they have a truth."""

    recordings: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Recordings or scenes (.mcap)."""
    live: Flag = True
    """Stream them too."""

    def rows(self, tell: Tell) -> Iterator[RecordingTrial]:
        if not self.recordings:
            raise InputError("no recording to measure: expected one .mcap file or more")
        for done, path in enumerate(self.recordings):
            tell(path.name, done / len(self.recordings))
            yield from recording_trials(path.name, read_scene(path), self.live)

    def tables(self, rows: Sequence[RecordingTrial]) -> Iterator[str]:
        yield recordings_table(rows)


def recordings_table(rows: Sequence[RecordingTrial]) -> str:
    """A line for each wearer."""
    return columns(rows, {
        "recording": lambda one: one.recording, "wearer": lambda one: one.wearer, "s": lambda one: f"{one.seconds:.0f}",
        "batch mm / °": lambda one: one.batch[:2], "knee °": lambda one: one.batch[2],
        "who is who: precision / recall %": lambda one: one.who_is_who, "live": lambda one: one.live[:2],
        "live, second half": lambda one: one.late[:2],
        "findings: batch, live": lambda one: f"{len(one.batch_findings)}, {len(one.live_findings)}",
    })  # fmt: skip


def recording_trials(name: str, scene: Scene, with_live: bool) -> Iterator[RecordingTrial]:
    """All wearers of a scene, smoothed and, if wanted, streamed."""
    begin = clock.process_time()
    estimate = smooth(scene)
    batch_s, begin = clock.process_time() - begin, clock.process_time()
    answers = streamed(scene, DEFAULT) if with_live else []
    live_s = clock.process_time() - begin
    said = sentences(finding for answer in answers for finding in answer.findings)
    for wearer, (recording, own) in enumerate(zip(scene.wearers, estimate.wearers, strict=True)):
        truth = None if recording.truth is None else recording.truth.motion
        start, end = recording.interval
        motion = smoothed_motion(answers, wearer, scene, DEFAULT.frame_rate)
        live, late = (_errors(motion, truth, since) for since in (start, (start + end) / 2))
        yield RecordingTrial(
            name, recording.subject.name, end - start, _errors(own.motion, truth, start), live, late, batch_s, live_s,
            sentences(dict.fromkeys((*estimate.findings, *own.findings))), said,
            who_is_who(scene, estimate, wearer),
        )  # fmt: skip


def who_is_who(scene: Scene, estimate: Estimate, wearer: int) -> tuple[float, float]:
    """Precision and recall of one wearer's detections in all cameras in percent; NaN without truth or detections."""
    true, given = [np.zeros(0, int)], [np.zeros(0, int)]
    for camera, estimated in camera_pairs(scene, estimate):
        if camera.truth is not None and len(estimated.wearer_of_detection):
            true.append(camera.truth.wearer)
            given.append(estimated.wearer_of_detection)
    is_true, is_given = (np.concatenate(labels) == wearer for labels in (true, given))
    right = np.sum(is_true & is_given)
    counts = [np.sum(labels) for labels in (is_given, is_true)]
    precision, recall = (float(100 * right / count) if count else np.nan for count in counts)
    return precision, recall


def _errors(motion: Motion | None, truth: Motion | None, since: float) -> tuple[float, ...]:
    if motion is None or truth is None:
        return NOTHING
    ours, true, _ = common_frames(motion, truth)
    later = slice(int(np.searchsorted(ours.time, since)), len(ours))
    metrics = evaluate_motion(ours.frames(later), true.frames(later)).metrics
    return tuple(metrics[name].value if name in metrics else np.nan for name in METRICS)
