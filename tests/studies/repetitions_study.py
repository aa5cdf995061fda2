"""Repetitions counted by hand beside those found: daily tasks of real people, and clips of motion capture, filmed."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import vip_factors as vip
from tests.studies.real import converted
from tests.studies.real_recordings import real_recordings
from tests.studies.study import Study, Tell, table
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.repetitions.repetition import Repetition
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.sensors.scene import Scene

# Counted by hand: in the videos of the sit-to-stands, and by what the index of the clips says and the motion shows.
REAL = ("vidimu", "opensense", "geneva_gait", "xsens_vicon_walk")
COUNTS: Mapping[str, Mapping[str, int]] = {
    "vidimu S40_A04_T02": {"squat": 5}, "vidimu S42_A04_T02": {"squat": 5},
    "02_04": {"jump": 1}, "02_06": {"squat": 6}, "02_10": {"squat": 4}, "06_15": {"jump": 1},
}  # fmt: skip
# Beside those: walking, running, dancing, dribbling, football, boxing.
NONE_IN = ("02_01", "02_03", "05_02", "06_02", "10_01", "12_02", "13_18")
MATCH_S = 0.5  # between the highest moments of one jump


@dataclass(frozen=True)
class RepetitionTrial:
    """One wearer of a recording.

    Attributes:
        recording: its name.
        true, found: repetitions by kind.
        verdict: on the estimate.
        flight_m, rise_m: of every true jump that was found: found and true height, by the flight and by the rise.
    """

    recording: str
    true: Mapping[str, int]
    found: Mapping[str, int]
    verdict: str
    flight_m: tuple[tuple[float, float], ...] = ()
    rise_m: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class RepetitionStudy(Study):
    """Squats, lunges, jumps and curls: counts beside those made by hand, heights of jumps beside the true motion's."""

    data: Path
    """Folder with the public recordings: vidimu, opensense, geneva_gait, xsens_vicon_walk, cmu_bvh."""
    seeds: tuple[int, ...] = (0, 1)
    """Of the errors of the sensors and the detector that film each clip."""
    recordings: tuple[Path, ...] = ()
    """Recordings (.mcap) of your own besides, whose truth is counted by the same rules as the estimate."""
    named: str = ""
    """Only those whose names contain this."""

    def rows(self, tell: Tell) -> Iterator[RepetitionTrial]:
        real = [
            recording
            for recording in real_recordings(self.data)
            if recording.name.startswith(REAL) and self.named in recording.name
        ]
        clips = [
            (name, path, seed)
            for name in sorted({*COUNTS, *NONE_IN})
            for path in self.data.glob(f"cmu_bvh/*/{name}.bvh")
            for seed in self.seeds
            if self.named in name
        ]
        if not real and not clips and not self.recordings:
            raise InputError(f"{self.data}: no recording '{self.named}' of these folders in it")
        count, done = len(real) + len(clips) + len(self.recordings), 0
        for one in real:
            tell(one.name, done / count)
            done += 1
            yield trial(one.name, smooth(converted(one, self.data)), COUNTS.get(one.name, {}))
        for name, path, seed in clips:
            tell(name, done / count)
            done += 1
            scene = vip.simulate(path, camera="fixed", seed=seed)
            yield trial(f"clip {name}, seed {seed}", smooth(scene), COUNTS.get(name, {}), scene)
        for path in self.recordings:
            tell(path.name, done / count)
            done += 1
            scene = read_scene(path)
            yield trial(path.stem, smooth(scene), None, scene)

    def tables(self, rows: Sequence[RepetitionTrial]) -> Iterator[str]:
        """A line of each recording that has some, or is told some; the rest in one."""
        shown = [row for row in rows if row.true or row.found]
        lines = [[one.recording, _words(one.true), _words(one.found), one.verdict] for one in shown]
        rest = len(rows) - len(shown)
        yield table(["recording", "true", "found", "verdict"], [*lines, [f"{rest} others", "none", "none", ""]])
        heights = {
            "flight": [pair for row in rows for pair in row.flight_m],
            "rise": [pair for row in rows for pair in row.rise_m],
        }
        known = [[name, len(pairs), *_errors_cm(pairs)] for name, pairs in heights.items() if pairs]
        if known:
            yield table(["height of jumps by", "jumps", "RMS cm", "worst cm", "mean cm"], known)


def _errors_cm(pairs: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    found, true = 100 * np.array(pairs).T
    error = found - true
    return float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()), float(error.mean())


def _words(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in counts.items()) or "none"


def trial(name: str, estimate: Estimate, true: Mapping[str, int] | None, scene: Scene | None = None) -> RepetitionTrial:
    found = repetitions_of(estimate.wearers[0]).repetitions
    known = _of_truth(scene)
    if true is None:
        true = _counts(known)
    pairs = [
        (one, other)
        for other in known
        if other.kind == "jump"
        for one in found
        if one.kind == "jump" and abs(one.turn - other.turn) < MATCH_S
    ]
    return RepetitionTrial(
        name, dict(true), _counts(found), str(estimate.verdict.severity),
        tuple((float(one.flight_height_m.value), float(other.flight_height_m.value)) for one, other in pairs),
        tuple((float(one.rise_m.value), float(other.rise_m.value)) for one, other in pairs),
    )  # fmt: skip


def _of_truth(scene: Scene | None) -> tuple[Repetition, ...]:
    truth = None if scene is None else scene.wearers[0].truth
    if truth is None:
        return ()
    return repetitions_of(WearerEstimate("truth", "truth", truth.motion, {})).repetitions


def _counts(repetitions: Sequence[Repetition]) -> dict[str, int]:
    return dict(Counter(repetition.kind for repetition in repetitions))
