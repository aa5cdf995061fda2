"""GTSAM's own smoothers on the factors of a stream, beside the tracker's smoother on the very same factors.

The frames are those that the tracker smoothed: what its association chose, where its estimate stood when they left the
lag, which is where all of them start from.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter, process_time

import gtsam
import numpy as np
from threadpoolctl import ThreadpoolController

from tests.studies.reference_smoothers import Isam2Chain, LagOfGtsam, TimeOrderedIsam2
from tests.studies.study import Tell
from vip_factors.errors import RecordingError
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.factor_graph.keys import root_key
from vip_factors.factor_graph.variables import values_of
from vip_factors.geometry.rotations import Array
from vip_factors.live.problem import FrameState, LagFrame, LagProblem, stacked
from vip_factors.live.settings import LiveSettings
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene

NEVER_S = 1e9  # between steps of what frames share: GTSAM's smoothers hold it constant
OURS = "ours"
Timed = tuple[Array, Array]


@dataclass(frozen=True)
class ReferenceTime:
    """One smoother.

    Attributes:
        name: of it.
        updates: that were timed: those after the lag was filled.
        median_s, worst_s: wall time of an update.
        median_cpu_s: CPU time of it.
        differs_m: by how much its newest root positions differ from ours, at most, metres.
    """

    name: str
    updates: int
    median_s: float
    worst_s: float
    median_cpu_s: float
    differs_m: float


@dataclass(frozen=True)
class RecordedWindow:
    """Consecutive frames of a stream, with all that a smoother needs to start at the first of them.

    Attributes:
        problem: with priors on what frames share where the tracker had it.
        frames, states: as they left the tracker's lag.
        shared: as the tracker had it at the last of them.
    """

    problem: LagProblem
    frames: tuple[LagFrame, ...]
    states: tuple[FrameState, ...]
    shared: SceneState


def run_references(
    samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, updates: int, tell: Tell
) -> tuple[ReferenceTime, ...]:
    """Time each smoother on ``updates`` frames after as many as the lag holds; ours is the first."""
    lag = max(1, round(settings.lag_s * settings.frame_rate))
    settings = without_walk(settings)
    with ThreadpoolController().limit(limits=1, user_api="blas"):  # as the tracker does
        return _timed(recorded_window(samples, setup, settings, lag + 1 + updates), settings, lag, tell)


def _timed(window: RecordedWindow, settings: LiveSettings, lag: int, tell: Tell) -> tuple[ReferenceTime, ...]:
    times: dict[str, Timed] = {}
    for done, (name, run) in enumerate(_smoothers(window, settings, lag).items()):
        tell("references", done / 5)
        times[name] = run()
    ours = times[OURS][1]
    return tuple(
        ReferenceTime(
            name, len(seconds), float(np.median(seconds[:, 0])), float(seconds[:, 0].max()),
            float(np.median(seconds[:, 1])), float(np.linalg.norm(found - ours, axis=1).max()),
        )
        for name, (seconds, found) in times.items()
    )  # fmt: skip


def _smoothers(window: RecordedWindow, settings: LiveSettings, lag: int) -> dict[str, Callable[[], Timed]]:
    layout = window.problem.layout
    return {
        OURS: lambda: timed_lag(window, settings, lag),
        "ISAM2, our linear factors": lambda: timed_lag(
            window, settings, lag, Isam2Chain(layout.frame_width, layout.static_width)
        ),
        "ISAM2 in time order": lambda: timed_reference(window, TimeOrderedIsam2(lag), lag),
        "IncrementalFixedLagSmoother": lambda: timed_reference(window, LagOfGtsam.incremental(lag), lag),
        "BatchFixedLagSmoother, one iteration": lambda: timed_reference(window, LagOfGtsam.batch(lag, 1), lag),
    }


def without_walk(settings: LiveSettings) -> LiveSettings:
    """What frames share stays as it is."""
    return replace(settings, walk=replace(settings.walk, every_s=NEVER_S))


def recorded_window(samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, count: int) -> RecordedWindow:
    """Run the tracker until ``count`` frames have left the lag without a new start, and keep these."""
    tracker = FixedLagTracker(setup, settings)
    smoother: LagSmoother | None = None
    frames: list[LagFrame] = []
    states: list[FrameState] = []
    for sample in samples:
        if not tracker.push(sample) or tracker._tracking is None:
            continue
        if tracker._tracking.smoother is not smoother:
            smoother, frames, states = tracker._tracking.smoother, [], []
        oldest = smoother.numbers[0]
        if not frames or oldest > frames[-1].number:
            frames.append(smoother.frame(oldest))
            states.append(smoother.state(oldest))
        if len(frames) == count:
            return _window(smoother.problem, frames, states, smoother.shared, settings)
    raise RecordingError(f"the stream is too short for {count} smoothed frames: ask for more seconds")


def _window(
    problem: LagProblem,
    frames: Sequence[LagFrame],
    states: Sequence[FrameState],
    shared: SceneState,
    settings: LiveSettings,
) -> RecordedWindow:
    frames = [replace(frame, number=number) for number, frame in enumerate(frames)]
    model = problem.model(frames, beginning=True)
    wearers = [
        replace(
            one, prior_headings=own.headings, prior_R_bone_sensor=own.R_bone_sensor,
            p_world_start=states[0].p_world_pelvis[number], initial_pose=None,
        )
        for number, (one, own) in enumerate(zip(model.wearers, shared.wearers, strict=True))
    ]  # fmt: skip
    imu = shared.camera
    camera = replace(model.camera, prior_heading=imu.heading, prior_R_camera_imu=imu.R_camera_imu)
    fresh = LagProblem(wearers, camera, model.views, model.further, problem.sensors, model.step, settings)
    return RecordedWindow(fresh, tuple(frames), tuple(states), shared)


@dataclass(frozen=True)
class Arrival:
    """What one update brings.

    Attributes:
        newest: number of the newest frame.
        factors: that can exist now and could not before.
        values: where their new variables start.
        frames: numbers of the new variables' frames, by key.
        shared: keys of what frames share.
    """

    newest: int
    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    frames: dict[int, int]
    shared: tuple[int, ...]


def arrivals(problem: SceneProblem, state: SceneState, first: int) -> Iterator[Arrival]:
    """A scene's GTSAM factors, each with the last of its frames: up to ``first`` at once, then frame by frame."""
    whole, moving = factor_graph_of(problem, state), problem.camera.moving
    of_frames = [one for one in whole.variables if one.is_of_a_frame or (one.is_of_the_camera_path and moving)]
    static = [one for one in whole.variables if one not in set(of_frames)]
    shared = tuple(one.key for one in static)
    for begin, newest in [(0, first), *((t, t) for t in range(first + 1, problem.frames))]:
        graph = gtsam.NonlinearFactorGraph()
        for factor in whole.factors:
            if begin <= factor.frames[-1] <= newest:
                graph.push_back(factor.factor)
        fresh = [one for one in of_frames if begin <= one.frame <= newest]
        frames = {one.key: one.frame for one in fresh}
        yield Arrival(newest, graph, values_of(state, [*fresh, *(static if begin == 0 else ())]), frames, shared)


def feed(window: RecordedWindow, first: int) -> list[Arrival]:
    """The window's GTSAM factors, update by update."""
    problem = window.problem
    state = stacked(window.states, window.shared)
    return list(arrivals(problem.model(window.frames, beginning=True), state, first))


def timed_reference(window: RecordedWindow, smoother: LagOfGtsam | TimeOrderedIsam2, lag: int) -> Timed:
    """Wall and CPU time of each update ``(n, 2)``, and the newest root positions ``(n, 3)`` of the first wearer."""
    seconds, found = [], []
    for one in feed(window, lag):
        begin = perf_counter(), process_time()
        values = smoother.update(one.newest, one.factors, one.values, one.frames, one.shared)
        seconds.append((perf_counter() - begin[0], process_time() - begin[1]))
        found.append(values.atPoint3(root_key(one.newest)))
    return np.array(seconds[1:]), np.array(found[1:])


def timed_lag(window: RecordedWindow, settings: LiveSettings, lag: int, chain: Isam2Chain | None = None) -> Timed:
    """The same of the tracker's smoother, with another chain in it if there is one."""
    smoother = LagSmoother(window.problem, window.shared, settings)
    if chain is not None:
        smoother._chain = chain  # type: ignore[assignment]
    for frame, state in zip(window.frames[: lag + 1], window.states[: lag + 1], strict=True):
        smoother.append(frame, state)
    smoother.update(0)
    smoother.marginalise_before(0)
    seconds, found = [], []
    for frame, state in zip(window.frames[lag + 1 :], window.states[lag + 1 :], strict=True):
        begin = perf_counter(), process_time()
        smoother.append(frame, state)
        smoother.update()
        found.append(smoother.state(frame.number).p_world_pelvis[0])
        smoother.marginalise_before(frame.number - lag)
        seconds.append((perf_counter() - begin[0], process_time() - begin[1]))
    return np.array(seconds), np.array(found)
