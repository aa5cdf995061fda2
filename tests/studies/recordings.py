"""Any recordings, one row for each wearer: batch and live beside their truth, and how much is found fault with."""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from tests.studies.live_run import filled_motion
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.evaluate.evaluation import evaluate_motion
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.table import json_text, number
from vip_factors.io.mcap_scene_recording import read_scene
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.live import LiveSetup, live_samples
from vip_factors.sensors.scene import Scene

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


def run_recordings(
    paths: Sequence[Path], with_live: bool, tell: Callable[[str, float], None],
    keep: Callable[[tuple[RecordingTrial, ...]], None] = lambda so_far: None,
) -> tuple[RecordingTrial, ...]:  # fmt: skip
    """Each recording smoothed and, if wanted, streamed.

    Raises:
        InputError: for a file that is not a recording, or that cannot be used.
    """
    if not paths:
        raise InputError("no recording to measure: expected one .mcap file or more")
    found: tuple[RecordingTrial, ...] = ()
    for done, path in enumerate(paths):
        tell(path.name, done / len(paths))
        found += _trials(path.name, read_scene(path), with_live)
        keep(found)
    return found


def recordings_table(trials: Sequence[RecordingTrial]) -> str:
    """Markdown, a row for each wearer."""
    lines = [
        "| recording | wearer | s | batch mm / ° | knee ° | who is who: precision / recall % | live | "
        "live, second half | findings: batch, live |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in trials:
        told = f"{len(one.batch_findings)}, {len(one.live_findings)}"
        cells = [one.recording, one.wearer, f"{one.seconds:.0f}", _pair(one.batch), number(one.batch[2])]
        cells.append(_pair(one.who_is_who))
        lines.append("| " + " | ".join([*cells, _pair(one.live), _pair(one.late), told]) + " |")
    return "\n".join(lines) + "\n"


def recordings_json(trials: Sequence[RecordingTrial]) -> str:
    """Everything, as JSON."""
    return json_text({f"{one.recording} {one.wearer}": asdict(one) for one in trials})


def _pair(errors: Sequence[float]) -> str:
    return f"{errors[0]:.1f} / {errors[1]:.1f}" if np.isfinite(errors[0]) else "n/a"


def _trials(name: str, scene: Scene, with_live: bool) -> tuple[RecordingTrial, ...]:
    begin = clock.process_time()
    estimate = smooth_scene(scene)
    batch_s = clock.process_time() - begin
    begin = clock.process_time()
    answers = streamed(scene) if with_live else []
    live_s = clock.process_time() - begin
    said = tuple(sentence for answer in answers for sentence in answer.findings)
    trials = []
    for wearer, (recording, own) in enumerate(zip(scene.wearers, estimate.wearers, strict=True)):
        truth = None if recording.truth is None else recording.truth.motion
        start, end = recording.interval
        motion = smoothed_motion(answers, wearer, scene)
        live, late = (_errors(motion, truth, since) for since in (start, (start + end) / 2))
        trials.append(
            RecordingTrial(
                name, recording.subject.name, end - start, _errors(own.motion, truth, start), live, late,
                batch_s, live_s, tuple(dict.fromkeys((*estimate.findings, *own.findings))), said,
                _who_is_who(scene, estimate.wearer_of_detection, wearer),
            )
        )  # fmt: skip
    return tuple(trials)


def _who_is_who(scene: Scene, given: np.ndarray, wearer: int) -> tuple[float, float]:
    """Precision and recall of one wearer's detections in percent; NaN without truth, or where there is none."""
    if scene.truth is None or len(given) != len(scene.truth.wearer):
        return np.nan, np.nan
    right = np.sum((given == wearer) & (scene.truth.wearer == wearer))
    counts = [np.sum(one == wearer) for one in (given, scene.truth.wearer)]
    precision, recall = (float(100 * right / count) if count else np.nan for count in counts)
    return precision, recall


def streamed(scene: Scene, settings: LiveSettings = DEFAULT) -> list[LiveEstimate]:
    """What the tracker answers to a scene, as fast as it goes."""
    tracker = FixedLagTracker(LiveSetup.of(scene), settings)
    return [*(answer for sample in live_samples(scene) for answer in tracker.push(sample)), *tracker.finish()]


def smoothed_motion(answers: Sequence[LiveEstimate], wearer: int, scene: Scene) -> Motion | None:
    """The smoothed poses, on the body that was believed at the end."""
    poses = [pose for answer in answers if (pose := answer.wearers[wearer].smoothed) is not None]
    if not poses:
        return None
    body = answers[-1].wearers[wearer].skeleton or scene.wearers[wearer].subject.body()
    return filled_motion(poses, body, DEFAULT.frame_rate, scene.wearers[wearer].subject.name)


def _errors(motion: Motion | None, truth: Motion | None, since: float) -> tuple[float, ...]:
    if motion is None or truth is None:
        return NOTHING
    ours, true, _ = common_frames(motion, truth)
    later = slice(int(np.searchsorted(ours.time, since)), len(ours))
    metrics = evaluate_motion(ours.frames(later), true.frames(later)).metrics
    return tuple(metrics[name].value if name in metrics else np.nan for name in METRICS)
