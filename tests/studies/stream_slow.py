"""A machine half as fast as a stream needs, for a while: what is dropped, how old answers get, when all is good again.

The program runs as a process of its own and is stopped ever again, so that it gets no more than a share of the
processor time that it took before: nothing in it knows of that.
"""

import os
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import Any

import numpy as np

from tests.studies.long_stream import LEAST_SCENE_S, LongStream, LongStreamTrials, stream_scene
from tests.studies.processes import ProcessTree, apart, process_tree
from tests.studies.stream_hour import dropped
from tests.studies.stream_program import COMMAND, StreamProgram
from tests.studies.stream_run import error_over_time
from tests.studies.study import MB, NAN, Fixed, Study, Tell, bullets, table
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.scene_settings import CameraKind

SETTLED_S = 12.0  # of the stream: by then the first calibrations have been found anew, and the program's share is usual
TURN_S = 0.02  # between looks whether it has had its share
IN_TIME_S = 0.5  # an answer no older is in time: a frame, waiting for late packets, an update
GOOD_S = 2.0  # for which all answers are to be in time, to say that all is good again


@dataclass(frozen=True)
class SlowPart:
    """Some of the stream: before, while the machine is slow, after.

    Attributes:
        name: which.
        answers, missing: how many frames have one and how many have none.
        latency_s: of answers: median, 99 %, worst.
        newest_mm: mean error of the newest poses' joints after a rigid alignment of each.
        sigma_mm: of where the pelvis is, as told with smoothed poses: median, worst.
        dropped: video frames and samples of IMUs.
        memory: resident bytes of the program at the end.
        said: sentences with the stream's time.
    """

    name: str
    answers: int
    missing: int
    latency_s: tuple[float, float, float]
    newest_mm: float
    sigma_mm: tuple[float, float]
    dropped: tuple[int, int]
    memory: int
    said: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class SlowStream:
    """Before, during and after.

    Attributes:
        needed: share of a processor that the program took before.
        parts: before, during, after.
        good_after_s: seconds from the end of the load until all answers of two seconds were in time; NaN if never.
        code: exit code.
    """

    needed: float
    parts: tuple[SlowPart, ...]
    good_after_s: float
    code: int


@dataclass(frozen=True, kw_only=True)
class StreamSlow(Study):
    """What a stream does on a machine half as fast as it needs, for a while, and how soon it recovers (Linux)."""

    seconds: float = 75.0
    """Of the simulated stream, in real time: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    begin_s: float = 25.0
    """When the machine becomes slow."""
    end_s: float = 50.0
    """And when it is fast again."""
    share: float = 0.5
    """Of the processor time that the program took before, which it gets meanwhile."""
    frame_rate: float = 60.0
    """Frames per second."""
    camera: CameraKind = "hand-held"
    """What films."""
    command: Fixed[tuple[str, ...]] = COMMAND

    def __post_init__(self) -> None:
        if not SETTLED_S < self.begin_s < self.end_s < self.seconds or not 0 < self.share < 1:
            raise InputError(
                f"a slow machine from {self.begin_s:g} to {self.end_s:g} s of {self.seconds:g} s, with {self.share:g} "
                f"of its time: expected these one after the other, behind {SETTLED_S:g} s, and a share between 0 and 1"
            )

    def rows(self, tell: Tell) -> Iterator[SlowStream]:
        if not hasattr(signal, "SIGSTOP") or process_tree(os.getpid()) is None:
            raise InputError("a slow machine can be made on Linux alone, where a process can be stopped and timed")
        trials = LongStreamTrials(
            self.seconds, max(self.seconds + 1.0, LEAST_SCENE_S), self.camera
        )  # all of it forwards
        scene = apart(stream_scene, trials)
        stream, watch, trees = LongStream(scene, trials), Answers(), dict[float, ProcessTree]()
        marks = [SETTLED_S, self.begin_s, self.end_s]
        with TemporaryDirectory() as name:
            options = ["--out", str(Path(name) / "stream.mcap"), "--frame-rate", f"{self.frame_rate:g}"]
            with StreamProgram(options, watch.take, self.command) as program:
                brake = _Brake(program.pid)
                for now in program.send(stream.setup, (one for one in stream if one.time <= self.seconds)):
                    if not marks or now < marks[0]:
                        continue
                    mark = marks.pop(0)
                    trees[mark] = process_tree(program.pid) or ProcessTree(0, 0, NAN)
                    tell("stream", now / self.seconds)
                    if mark == self.begin_s:
                        brake.begin(self.share * self._needed(trees))
                    elif mark == self.end_s:
                        brake.release()
                last = process_tree(program.pid) or ProcessTree(0, 0, NAN)
                code = program.end()
        begin, end = self.begin_s, self.end_s
        spans = {"before": (SETTLED_S, begin), "during": (begin, end), "after": (end, np.inf)}
        memory = {"before": trees[begin].own, "during": trees[end].own, "after": last.own}
        parts = [watch.part(name, span, memory[name], scene, self.frame_rate) for name, span in spans.items()]
        yield SlowStream(self._needed(trees), tuple(parts), watch.good_after(end), code)

    def _needed(self, trees: Mapping[float, ProcessTree]) -> float:
        used = trees[self.begin_s].cpu_s - trees[SETTLED_S].cpu_s
        return used / (self.begin_s - SETTLED_S)

    def tables(self, rows: Sequence[SlowStream]) -> Iterator[str]:
        (result,) = rows
        yield (
            f"A program that took {result.needed:.2f} of a processor, at {self.frame_rate:g} frames per second, got "
            f"{self.share:g} of that from {self.begin_s:g} to {self.end_s:g} s"
        )
        head = ["", "answers", "missing", "latency s: median", "99 %", "worst", "MPJPE mm of newest",
                "sigma mm: median", "worst", "dropped: video", "IMU", "MB"]  # fmt: skip
        yield table(head, [
            [part.name, part.answers, part.missing, *(f"{one:.2f}" for one in part.latency_s), part.newest_mm,
             *(f"{one:.0f}" for one in part.sigma_mm), *part.dropped, f"{part.memory / MB:.0f}"]
            for part in result.parts
        ])  # fmt: skip
        good = f"{result.good_after_s:.1f} s" if np.isfinite(result.good_after_s) else "NOT"
        yield f"Answers were in time again {good} after the load. Exit code {result.code}."
        yield bullets("", (f"{time:.1f} s: {sentence}" for part in result.parts for time, sentence in part.said))


class _Brake:
    """Stops a process (SIGSTOP) whenever it has had more than its share of processor time, and lets it go on."""

    def __init__(self, pid: int) -> None:
        self._pid, self._over = pid, Event()
        self._thread: Thread | None = None

    def begin(self, share: float) -> None:
        """From now on it gets ``share`` seconds of processor time a second."""
        self._thread = Thread(target=self._run, args=(share,), daemon=True)
        self._thread.start()

    def release(self) -> None:
        """All that it wants, from now on."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, share: float) -> None:
        tree, begun = process_tree(self._pid), time.monotonic()
        first = tree.cpu_s if tree is not None else 0.0
        while not self._over.wait(TURN_S) and (tree := process_tree(self._pid)) is not None:
            much = tree.cpu_s - first > share * (time.monotonic() - begun)
            os.kill(self._pid, signal.SIGSTOP if much else signal.SIGCONT)
        os.kill(self._pid, signal.SIGCONT)


class Answers:
    """What was answered, from the thread that reads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._rows: list[tuple[float, float, float]] = []  # time, age, sigma of the pelvis's place in m
        self._poses: list[LivePose] = []
        self._said: list[tuple[float, str]] = []  # when it was read, by the stream's clock

    def take(self, answer: dict[str, Any], age: float) -> None:
        wearer, time = answer["wearers"][0], float(answer["time"])
        late = (wearer["smoothed"] or {}).get("root_sigma")
        sigma = float(np.linalg.norm(late)) if late is not None and None not in late else float("nan")
        pose = wearer["newest"]
        R = matrix_from_quaternion(np.array(pose["rotations"]), Order.WXYZ)
        with self._lock:
            self._rows.append((time, age, sigma))
            self._poses.append(LivePose(float(pose["time"]), R, np.array(pose["root"])))
            self._said += [(time + age, sentence) for sentence in answer.get("findings", ())]

    def part(self, name: str, span: tuple[float, float], memory: int, scene: Scene, rate: float) -> SlowPart:
        """Of answers that were read within ``span``, by the stream's clock."""
        rows = np.array(self._rows)
        read = rows[:, 0] + rows[:, 1]
        chosen = np.flatnonzero((read >= span[0]) & (read < span[1]))
        time, age, sigma = rows[chosen].T
        said = tuple(one for one in self._said if span[0] <= one[0] < span[1])
        lost = sum((dropped(sentence) for _, sentence in said), np.zeros(2, int))
        wearer = scene.wearers[0]
        assert wearer.truth is not None
        poses = [self._poses[index] for index in chosen]
        truth = wearer.truth.motion
        error = error_over_time(poses, wearer.subject.body(), truth, rate, span[0])[:, 0]
        gaps = np.round(np.diff(time) * rate).astype(int) - 1
        told = sigma[np.isfinite(sigma)] if np.any(np.isfinite(sigma)) else np.array([np.nan])
        median, late, worst = np.quantile(age, [0.5, 0.99, 1.0]).tolist()
        return SlowPart(
            name, len(chosen), int(gaps.sum()), (median, late, worst), float(np.nanmean(error)),
            (1e3 * float(np.median(told)), 1e3 * float(told.max())), (int(lost[0]), int(lost[1])), memory, said,
        )  # fmt: skip

    def good_after(self, end: float) -> float:
        """Seconds from ``end`` (s) until the first of two seconds in which all answers were in time."""
        rows = np.array(self._rows)
        read = rows[:, 0] + rows[:, 1]
        late = read[(rows[:, 1] > IN_TIME_S) & (read >= end)]
        if not len(late):
            return 0.0
        edges = np.append(late, read[-1] + 1e-9)
        free = [
            at for at, until in pairwise(edges) if until - at > GOOD_S and np.any((read > at) & (read <= at + GOOD_S))
        ]
        return float(free[0] - end) if free else float("nan")
