"""The program ``vip-factors stream`` as a user runs it, over minutes or an hour: a process of its own, samples over the
loopback in real time, lines of JSON read from its output, an estimate and Rerun's file written; on a machine that has
time for it, or one that is too slow for a while.

Such a machine is made by stopping the program ever again, so that it gets no more than a share of the processor time
that it took before: nothing in it knows of that.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import IO, Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.live_sender import sample_message
from tests.studies.live_run import error_over_time
from tests.studies.long_stream import LEAST_SCENE_S, LongStream, LongStreamTrials, stream_scene
from tests.studies.processes import ProcessTree, apart, process_tree
from tests.studies.study import MB, NAN, Fixed, Study, Tell, bullets, table
from vip_factors.atomic import partial_path
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.live_messages import header_message
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.live import LiveSample, VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.settings import CameraKind
from vip_factors.viz.viewer import is_whole

COMMAND = (sys.executable, "-m", "vip_factors")
SOURCE = "ws://127.0.0.1:0"  # a free port, which the program tells
LISTEN_S = 120.0  # that it may take to listen
END_S = 600.0  # and to complete its files: Rerun's file has three minutes by itself
LAST_LINES = 200  # of what it says that are kept
START_S = 10.0  # of the stream: the first answers come together, once there is a second to answer
SETTLED_S = 12.0  # of the stream: by then the first calibrations have been found anew, and the program's share is usual
LOOK_S = 5.0  # between looks at memory
TURN_S = 0.02  # between looks whether a program that is slowed has had its share
IN_TIME_S = 0.5  # an answer no older is in time: a frame, waiting for late packets, an update
GOOD_S = 2.0  # for which all answers are to be in time, to say that all is good again
ESTIMATE, RERUN = "stream.mcap", "stream.rrd"
DROPPED = re.compile(r"does not keep up: (?:(\d+) video frames)?(?: and )?(?:(\d+) IMU samples)? were dropped")
HEAD = (
    "until s", "answers", "missing", "latency s: median", "99 %", "worst", "newest poses mm", "dropped: video", "IMU",
    "findings", "MB", "MB of its processes", "MB at most", "CPU share", "estimate MB", "Rerun MB",
)  # fmt: skip
Take = Callable[[dict[str, Any], float], None]


class StreamProgram:
    """Runs the program and feeds it; a context manager, which kills what is still there.

    Args:
        options: of ``vip-factors stream``, after its source.
        take: gets each line of JSON as an object, and its age: seconds since the newest sample that it answers was
            due to be sent. Called from another thread.
        command: that runs ``vip-factors``.

    Attributes:
        said: its last lines on stderr.
        latest_s: by how much the sender was behind its own schedule at most, seconds.
    """

    def __init__(self, options: Sequence[str], take: Take, command: Sequence[str] = COMMAND) -> None:
        self._arguments = [*command, "stream", SOURCE, *options, "--json", "--limits.next-client-wait", "0"]
        self._take = take
        self._begun = NAN
        self.said: deque[str] = deque(maxlen=LAST_LINES)
        self.latest_s = 0.0

    def __enter__(self) -> "StreamProgram":
        self._process = subprocess.Popen(
            self._arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL
        )
        work = ((self._listen, self._process.stderr), (self._read, self._process.stdout))
        self._readers = [Thread(target=target, args=(pipe,), daemon=True) for target, pipe in work]
        for reader in self._readers:
            reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def pid(self) -> int:
        return self._process.pid

    def send(self, setup: Scene, samples: Iterable[LiveSample]) -> Iterator[float]:
        """Send the header, and each sample when it is due; yields its time."""
        frames: Counter[str] = Counter()
        try:
            with connect(f"ws://127.0.0.1:{self._port()}", compression=None) as connection:
                connection.send(header_message(setup).SerializeToString())
                self._begun = time.monotonic()
                for sample in samples:
                    number = 0
                    if isinstance(sample, VideoFrame):
                        number = frames[sample.camera]
                        frames[sample.camera] += 1
                    data = sample_message(sample, setup.start_ns, number).SerializeToString()
                    late = time.monotonic() - self._begun - sample.time
                    time.sleep(max(0.0, -late))
                    self.latest_s = max(self.latest_s, late)
                    connection.send(data)
                    yield sample.time
        except (OSError, ConnectionClosed) as error:
            raise VipFactorsError(f"the stream has hung up: {error}; it said: {self._last}") from error

    def end(self) -> int:
        """Its exit code, once it has ended."""
        try:
            code = self._process.wait(END_S)
        except subprocess.TimeoutExpired as error:
            raise VipFactorsError(f"the stream did not end within {END_S:g} s; it said: {self._last}") from error
        for reader in self._readers:
            reader.join()
        return code

    @property
    def _last(self) -> str:
        return self.said[-1] if self.said else "nothing"

    def _port(self) -> int:
        until = time.monotonic() + LISTEN_S
        while time.monotonic() < until and self._process.poll() is None:
            for line in list(self.said):
                _, here, address = line.partition("listening at ws://127.0.0.1:")
                if here:
                    return int(address.partition("/")[0])
            time.sleep(0.05)
        raise VipFactorsError(f"the stream did not begin to listen; it said: {self._last}")

    def _listen(self, stream: IO[bytes]) -> None:
        for line in stream:
            self.said.append(line.decode(errors="replace").rstrip())

    def _read(self, stream: IO[bytes]) -> None:
        with stream:  # closed even where an answer cannot be taken: the program must not wait for a reader
            for line in stream:
                now = time.monotonic()
                answer = json.loads(line)
                self._take(answer, now - self._begun - answer["time"])


class Brake:
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


@dataclass(frozen=True)
class StreamSpan:
    """Some of the stream.

    Attributes:
        until: the stream's time at the end, seconds.
        answers, missing: frames with a line of JSON, and without one.
        latency_s: of answers, from when their newest sample was due to when their line was read: median, 99 %, worst;
            those of the first ten seconds of the stream are left out.
        newest_mm: mean error of the newest poses' joints after a rigid alignment of each; NaN beyond the scene's end.
        dropped: video frames and samples of IMUs that the program dropped.
        memory: resident bytes of the program, of the processes that it has begun, and the most of all together that
            was seen.
        cpu_share: of a processor, that the program took, without the processes that it has begun.
        bytes: of the estimate and of Rerun's file.
        said: sentences with the stream's time.
    """

    until: float
    answers: int
    missing: int
    latency_s: tuple[float, float, float]
    newest_mm: float
    dropped: tuple[int, int]
    memory: tuple[int, int, int]
    cpu_share: float
    bytes: tuple[int, int]
    said: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class StreamEnd:
    """How it ended.

    Attributes:
        latest_s: by which the sender itself was late at most, seconds.
        code: exit code.
        estimate_s: duration of the estimate that can be read.
        rerun: whether Rerun's file is whole.
        good_after_s: of a machine that was slow, seconds from then until all answers of two seconds were in time; NaN
            if they never were.
    """

    latest_s: float
    code: int
    estimate_s: float
    rerun: bool
    good_after_s: float | None = None


class Answers:
    """What was answered, from the thread that reads."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.rows: list[tuple[float, float]] = []  # time and age, s
        self.poses: list[LivePose] = []
        self.said: list[tuple[float, str]] = []  # when it was read, by the stream's clock

    def take(self, answer: dict[str, Any], age: float) -> None:
        pose, answered = answer["wearers"][0]["newest"], float(answer["time"])
        joints = pose["joints"]
        R = matrix_from_quaternion(np.array([one["rotation_wxyz"] for one in joints.values()]), Order.WXYZ)
        with self.lock:
            self.rows.append((answered, age))
            self.poses.append(LivePose(float(pose["time"]), R, np.array(joints["pelvis"]["position"])))
            self.said += [(answered + age, one["text"]) for one in answer["findings"]]

    def good_after(self, end: float) -> float:
        """Seconds from ``end`` (s) until the first of two seconds in which all answers were in time."""
        answered, age = np.array(self.rows).T
        read = answered + age
        late = read[(age > IN_TIME_S) & (read >= end)]
        if not len(late):
            return 0.0
        for at, until in pairwise([*late, read[-1] + 1e-9]):
            if until - at > GOOD_S and np.any((read > at) & (read <= at + GOOD_S)):
                return float(at - end)
        return NAN


def dropped(sentences: Iterable[str]) -> tuple[int, int]:
    """Video frames and samples of IMUs that findings say were dropped."""
    found = [one.groups(default="0") for one in map(DROPPED.search, sentences) if one is not None]
    video, imu = np.sum(np.array(found, int).reshape(-1, 2), axis=0).tolist()
    return video, imu


class Watch:
    """Looks at the program and at what it answers, span by span."""

    def __init__(self, scene: Scene, rate: float, folder: Path) -> None:
        self.answers, self._scene, self._rate, self._folder = Answers(), scene, rate, folder
        self._tree, self._most, self._next_look = ProcessTree(0, 0, 0.0), 0, 0.0
        self._begin, self._cpu_s, self._answered, self._said = 0.0, 0.0, 0, 0

    def look(self, now: float, pid: int, at_once: bool = False) -> None:
        """At memory and processor time, every few seconds."""
        if (now >= self._next_look or at_once) and (tree := process_tree(pid)) is not None:
            self._tree, self._most, self._next_look = tree, max(self._most, tree.own + tree.others), now + LOOK_S

    def span(self, until: float) -> StreamSpan:
        """What came since the last one."""
        with self.answers.lock:
            # With the last answer of the span before, after which frames may be missing.
            rows = np.array(self.answers.rows[max(0, self._answered - 1) :]).reshape(-1, 2)
            poses, said = self.answers.poses[self._answered :], tuple(self.answers.said[self._said :])
        missing = int((np.round(np.diff(rows[:, 0]) * self._rate).astype(int) - 1).sum())
        ages = rows[len(rows) - len(poses) :][rows[len(rows) - len(poses) :, 0] >= START_S, 1]
        median, late, worst = np.quantile(ages if len(ages) else [NAN], [0.5, 0.99, 1.0]).tolist()
        wearer, tree, seconds = self._scene.wearers[0], self._tree, until - self._begin
        assert wearer.truth is not None
        error = error_over_time(poses, wearer.subject.body(), wearer.truth.motion, self._rate)
        video, estimate = (_size(self._folder / name) for name in (RERUN, ESTIMATE))
        span = StreamSpan(
            until, len(poses), missing, (median, late, worst),
            float(np.nanmean(error)) if np.any(np.isfinite(error)) else NAN, dropped(one for _, one in said),
            (tree.own, tree.others, self._most), (tree.cpu_s - self._cpu_s) / seconds if seconds > 0 else NAN,
            (estimate, video), said,
        )  # fmt: skip
        self._begin, self._cpu_s, self._most = until, tree.cpu_s, 0
        self._answered, self._said = self._answered + len(poses), self._said + len(said)
        return span


def _size(path: Path) -> int:
    """Of a file under its final name or the one that it has until then."""
    return max((one.stat().st_size for one in (path, partial_path(path)) if one.exists()), default=0)


def streamed_spans(
    trials: LongStreamTrials, frame_rate: float, ends: Sequence[float], tell: Tell, command: Sequence[str] = COMMAND,
    slow: float | None = None,
) -> Iterator[StreamSpan | StreamEnd]:  # fmt: skip
    """Send a long stream to the program in real time; ``ends`` of spans in seconds, the last one's is the stream's.

    With ``slow`` the program gets, from the last but two to the last but one of them, that share of the processor time
    that it took in the span before.
    """
    scene = apart(stream_scene, trials)
    stream, begin, end = LongStream(scene, trials), *(ends[-3:-1] if slow is not None else (NAN, NAN))
    with TemporaryDirectory() as name:
        folder, left = Path(name), list(ends[:-1])
        watch = Watch(scene, frame_rate, folder)
        files = ["--out", str(folder / ESTIMATE), "--rerun-save", str(folder / RERUN)]
        with StreamProgram([*files, "--frame-rate", f"{frame_rate:g}"], watch.answers.take, command) as program:
            brake = Brake(program.pid)
            for now in program.send(stream.setup, stream):
                watch.look(now, program.pid, at_once=bool(left) and now >= left[0])
                tell("stream", now / trials.seconds)
                if left and now >= left[0]:
                    mark, span = left.pop(0), watch.span(now)
                    yield span
                    if mark == begin and slow is not None:
                        brake.begin(slow * span.cpu_share)
                    elif mark == end:
                        brake.release()
            watch.look(trials.seconds, program.pid, at_once=True)
            code = program.end()
            yield watch.span(trials.seconds)
        estimate = read_estimate(folder / ESTIMATE).wearers[0].motion
        good = None if slow is None else watch.answers.good_after(end)
        seconds = (len(estimate) - 1) / estimate.rate
        yield StreamEnd(program.latest_s, code, seconds, is_whole(folder / RERUN), good)


def span_tables(rows: Sequence[StreamSpan | StreamEnd]) -> Iterator[str]:
    """A line for each span, the end, and all that was said."""
    spans = [one for one in rows if isinstance(one, StreamSpan)]
    lines = []
    for one in spans:
        latency, memory = (f"{s:.2f}" for s in one.latency_s), (f"{size / MB:.0f}" for size in one.memory)
        sizes = (size / MB for size in one.bytes)
        lines.append([one.until, one.answers, one.missing, *latency, one.newest_mm, *one.dropped, len(one.said),
                      *memory, f"{one.cpu_share:.2f}", *sizes])  # fmt: skip
    yield table(HEAD, lines)
    for end in (one for one in rows if isinstance(one, StreamEnd)):
        yield (
            f"The sender itself was {1e3 * end.latest_s:.0f} ms late at most. Exit code {end.code}; estimate readable, "
            f"{end.estimate_s:.1f} s; Rerun's file {'whole' if end.rerun else 'NOT whole'}."
        )
        if end.good_after_s is not None:
            good = f"{end.good_after_s:.1f} s" if np.isfinite(end.good_after_s) else "NOT"
            yield f"Answers were in time again {good} after the load."
    yield bullets("", (f"{when:.1f} s: {sentence}" for one in spans for when, sentence in one.said))


@dataclass(frozen=True, kw_only=True)
class StreamHour(Study):
    """Whether an hour of the whole program stays as fast and as small as it began."""

    minutes: float = 60.0
    """Of the simulated stream, in real time: 13 IMUs at 60 Hz, 18 keypoints at 30 Hz."""
    scene_s: float = 60.0
    """Of the scene that is played forwards and backwards, with new noise."""
    camera: CameraKind = "hand-held"
    """What films."""
    part_minutes: float = 5.0
    """Between looks at what was answered."""
    frame_rate: float = 60.0
    """Frames per second."""
    command: Fixed[tuple[str, ...]] = COMMAND

    @property
    def stream(self) -> LongStreamTrials:
        return LongStreamTrials(60 * self.minutes, self.scene_s, self.camera)

    def rows(self, tell: Tell) -> Iterator[StreamSpan | StreamEnd]:
        step, seconds = 60 * self.part_minutes, self.stream.seconds
        ends = [*np.arange(step, seconds - step / 2, step).tolist(), seconds]
        yield from streamed_spans(self.stream, self.frame_rate, ends, tell, self.command)

    def tables(self, rows: Sequence[StreamSpan | StreamEnd]) -> Iterator[str]:
        stream = self.stream
        yield (
            f"The whole program at {self.frame_rate:g} frames per second: {stream.placement} at {stream.imu_rate:g} Hz "
            f"and a {stream.camera} camera at {stream.video_rate:g} Hz over the loopback in real time; an estimate, "
            "Rerun's file and lines of JSON written"
        )
        yield from span_tables(rows)


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
    core: int | None = None
    """Number of a processor: the program has only this one, and shares it with a busy loop from its first moment on;
    the machine is not made slow otherwise."""
    command: Fixed[tuple[str, ...]] = COMMAND

    def __post_init__(self) -> None:
        if not SETTLED_S < self.begin_s < self.end_s < self.seconds or not 0 < self.share < 1:
            raise InputError(
                f"a slow machine from {self.begin_s:g} to {self.end_s:g} s of {self.seconds:g} s, with {self.share:g} "
                f"of its time: expected these one after the other, behind {SETTLED_S:g} s, and a share between 0 and 1"
            )

    def rows(self, tell: Tell) -> Iterator[StreamSpan | StreamEnd]:
        if not hasattr(signal, "SIGSTOP") or process_tree(os.getpid()) is None:
            raise InputError("a slow machine can be made on Linux alone, where a process can be stopped and timed")
        # All of the scene is played forwards, but for a minute of what may take longer: there its truth is at hand.
        scene_s = min(self.seconds, 60.0) if self.core is not None else self.seconds
        trials = LongStreamTrials(self.seconds, max(scene_s + 1.0, LEAST_SCENE_S), self.camera)
        ends = [SETTLED_S, self.begin_s, self.end_s, self.seconds]
        if self.core is None:
            yield from streamed_spans(trials, self.frame_rate, ends, tell, self.command, self.share)
            return
        alone, all_of_them = ("taskset", "-c", str(self.core)), os.sched_getaffinity(0)
        os.sched_setaffinity(0, all_of_them - {self.core} or all_of_them)  # the sender and the reader are not tried
        busy_loop = f"import os\nwhile os.getppid() == {os.getpid()}: pass"  # it ends with us
        busy = subprocess.Popen([*alone, sys.executable, "-c", busy_loop])
        try:
            yield from streamed_spans(trials, self.frame_rate, ends, tell, (*alone, *self.command))
        finally:
            busy.kill()
            busy.wait()
            os.sched_setaffinity(0, all_of_them)

    def tables(self, rows: Sequence[StreamSpan | StreamEnd]) -> Iterator[str]:
        slow = (
            f"got {self.share:g} of the processor time that it took before, from {self.begin_s:g} to {self.end_s:g} s"
        )
        if self.core is not None:
            slow = "shared its only processor with a busy loop"
        yield f"A program at {self.frame_rate:g} frames per second {slow}"
        yield from span_tables(rows)
