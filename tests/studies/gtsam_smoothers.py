"""GTSAM's own fixed-lag smoothers on the factors of a stream, beside the tracker's smoother on the very same factors.

The frames are those that the tracker smoothed: what its association chose, where its estimate stood when they left the
lag, which is where all of them start from. GTSAM's smoothers know nothing of bodies: factors, values, and the number
of each variable's frame.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import gtsam

from vip_factors.errors import RecordingError
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.factor_graph.variables import values_of
from vip_factors.live.frames import FrameState, LagProblem, LiveFrame, stacked
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.problem.state import SceneState
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings

NEVER_S = 1e9  # between steps of what frames share: GTSAM's smoothers hold it constant


class LagOfGtsam:
    """``BatchFixedLagSmoother``; time is counted in frames."""

    def __init__(self, lag: int) -> None:
        self._smoother = gtsam.BatchFixedLagSmoother(float(lag), gtsam.LevenbergMarquardtParams())

    def update(
        self, newest: int, factors: gtsam.NonlinearFactorGraph, values: gtsam.Values, frames: Mapping[int, int],
        shared: Sequence[int],
    ) -> gtsam.Values:  # fmt: skip
        """Put in what is new (``frames``: number by key); all variables of the lag then."""
        times = {key: float(frame) for key, frame in frames.items()}
        times.update(dict.fromkeys(shared, float(newest)))
        self._smoother.update(factors, values, times)  # type: ignore[arg-type]  # its Mapping is invariant in its keys
        return self._smoother.calculateEstimate()


@dataclass(frozen=True)
class RecordedWindow:
    """Consecutive frames of a stream, with all that a smoother needs to start at the first of them.

    Attributes:
        problem: with priors on what frames share where the tracker had it.
        frames, states: as they left the tracker's lag.
        shared: as the tracker had it at the last of them.
    """

    problem: LagProblem
    frames: tuple[LiveFrame, ...]
    states: tuple[FrameState, ...]
    shared: SceneState


def without_walk(settings: LiveSettings) -> LiveSettings:
    """What frames share stays as it is."""
    return replace(settings, walk=replace(settings.walk, every_s=NEVER_S))


def recorded_window(samples: Iterable[LiveSample], setup: Scene, settings: LiveSettings, count: int) -> RecordedWindow:
    """Run the tracker until ``count`` frames have left the lag without a new start, and keep these."""
    tracker = FixedLagTracker(setup, settings)
    smoother: LagSmoother | None = None
    frames: list[LiveFrame] = []
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
    problem: LagProblem, frames: Sequence[LiveFrame], states: Sequence[FrameState], shared: SceneState,
    settings: LiveSettings,
) -> RecordedWindow:  # fmt: skip
    frames = [replace(frame, number=number) for number, frame in enumerate(frames)]
    model = problem.model(frames, beginning=True)
    wearers = [
        replace(
            one, prior_headings=own.headings, prior_R_bone_sensor=own.R_bone_sensor,
            p_world_start=states[0].p_world_pelvis[number], initial_pose=None,
        )
        for number, (one, own) in enumerate(zip(model.wearers, shared.wearers, strict=True))
    ]  # fmt: skip
    cameras = [
        replace(camera, prior_heading=imu.heading, prior_R_camera_imu=imu.R_camera_imu)
        for camera, imu in zip(model.cameras, shared.cameras, strict=True)
    ]
    fresh = LagProblem(wearers, cameras, model.views, problem.sensors, model.step, settings)
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


def feed(window: RecordedWindow, first: int) -> Iterator[Arrival]:
    """The window's GTSAM factors, each with the last of its frames: up to ``first`` at once, then frame by frame."""
    state = stacked(window.states, window.shared)
    problem = window.problem.model(window.frames, beginning=True)
    whole, moving = factor_graph_of(problem, state), problem.cameras[0].moving
    of_frames = [
        variable
        for variable in whole.variables
        if variable.is_of_a_frame or (variable.is_of_the_camera_path and moving)
    ]
    static = [variable for variable in whole.variables if variable not in set(of_frames)]
    for begin, newest in [(0, first), *((t, t) for t in range(first + 1, problem.frames))]:
        graph = gtsam.NonlinearFactorGraph()
        for factor in whole.factors:
            if begin <= factor.frames[-1] <= newest:
                graph.push_back(factor.factor)
        fresh = [frame for frame in of_frames if begin <= frame.frame <= newest]
        values = values_of(state, [*fresh, *(static if begin == 0 else ())])
        frames = {one.key: one.frame for one in fresh}
        yield Arrival(newest, graph, values, frames, tuple(one.key for one in static))
