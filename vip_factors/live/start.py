"""How tracking begins, and begins again: the stages of the batch pipeline over the last second or so."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.coarse import CoarseSolution, Known, solve_coarsely
from vip_factors.live.problem import LagFrame, LagProblem, lag_frame
from vip_factors.live.settings import LiveSettings
from vip_factors.live.state import FrameState, without_frames
from vip_factors.problem.scene import KeypointView, SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.calibration_start import start_findings
from vip_factors.terms.camera_pose import CameraPoses


@dataclass(frozen=True)
class Started:
    """Where tracking begins.

    Attributes:
        problem: of any stretch from here on.
        shared: what all frames share, without frames.
        frames, states: of the stretch.
        associated: of the cameras that are of use: who is who in each of their video frames.
        spreads: by camera and wearer, scatter of the detections in OKS sigmas.
        information: ``(s, s)`` about ``shared``, from frames that are not here; None without any.
        findings: sentences about a start that the stretch does not settle.
    """

    problem: LagProblem
    shared: SceneState
    frames: list[LagFrame]
    states: list[FrameState]
    associated: tuple[AssociatedCamera, ...]
    spreads: tuple[tuple[float, ...], ...]
    information: Array | None = None
    findings: tuple[str, ...] = ()

    @property
    def filmed(self) -> bool:
        """Whether a camera sees a wearer."""
        return bool(self.associated)


def start(stretch: MeasuredStretch, settings: LiveSettings, known: Known | None = None) -> Started:
    """Begin with a stretch: coarsely by the batch stages, as they would a short scene, then frame by frame.

    Args:
        stretch: a second or so.
        settings: of all.
        known: from before, where this is not the first start.

    Raises:
        RecordingError: if a wearer has no sensor that measures.
        SolveError: if the problem is not determined.
    """
    silent = [wearer.name for wearer in stretch.setup.wearers if not stretch.alive(wearer.name)]
    if silent:
        raise RecordingError(f"no sensor of '{silent[0]}' has measured in the last {len(stretch.time)} frames")
    coarse = solve_coarsely(stretch, settings, known)
    model, state, spreads = coarse.at_full_rate(stretch, settings)
    associated = coarse.associated
    if known is not None and ((associated and associated[0].camera.known_path is None) or not associated):
        state = _shifted(state, known.p_world_pelvis[0] - state.wearers[0].p_world_pelvis[0])
    freed = tuple(
        _freed(one, tracked.model, settings, own.p_world_pelvis[0])
        for one, tracked, own in zip(model.wearers, coarse.wearers, state.wearers, strict=True)
    )
    begun = started(stretch, coarse, replace(model, wearers=freed), state, spreads, settings)
    return replace(begun, findings=tuple(unsettled(coarse)))


def unsettled(coarse: CoarseSolution) -> Iterator[str]:
    """Sentences about starts that the data does not settle."""
    for recording, one in zip(coarse.scene.wearers, coarse.wearers, strict=True):
        yield from start_findings(f"wearer '{recording.subject.name}'", one.model.frames.sensors, one.starts)


def _freed(model: WearerProblem, tracked: WearerProblem, settings: LiveSettings, p_start: Array) -> WearerProblem:
    """A wearer's problem with the calibration free."""
    pose = tracked.initial_pose
    if pose is not None:
        pose = replace(pose, frames=pose.frames * settings.coarse_factor)
    return replace(
        model,
        free_headings=tracked.free_headings,
        free_mountings=tracked.free_mountings,
        initial_pose=pose,
        p_world_start=p_start,
    )


def _shifted(state: SceneState, shift: Array) -> SceneState:
    camera, poses = state.camera, state.camera.poses
    poses = CameraPoses(poses.R_world_camera, poses.p_world_camera + shift)
    return SceneState(tuple(one.turned(0.0, shift) for one in state.wearers), replace(camera, poses=poses))


def started(
    stretch: MeasuredStretch, coarse: CoarseSolution, model: SceneProblem, state: SceneState,
    spreads: tuple[tuple[float, ...], ...], settings: LiveSettings,
) -> Started:  # fmt: skip
    """A problem on all frames of a stretch, frame by frame."""
    frames = _lag_frames(stretch, model, state)
    states = [_frame_state(state, t) for t in range(len(frames))]
    problem = _lag_problem(stretch, coarse, model, state, settings)
    return Started(problem, without_frames(state), frames, states, coarse.associated, spreads)


def _lag_problem(
    stretch: MeasuredStretch, coarse: CoarseSolution, model: SceneProblem, state: SceneState, settings: LiveSettings
) -> LagProblem:
    sensors = [
        np.array([stretch.column(recording.subject.name, name) for name in one.frames.sensors], dtype=int)
        for recording, one in zip(coarse.scene.wearers, model.wearers, strict=True)
    ]
    if model.camera.imu is not None:
        sensors.append(np.array([stretch.column(coarse.associated[0].camera.name, model.camera.imu.sensors[0])]))
    views = model.viewpoints(state.camera)[0].views
    step = model.wearers[0].frames.step
    return LagProblem(model.wearers, model.camera, views, model.further, sensors, step, settings)


def _lag_frames(stretch: MeasuredStretch, model: SceneProblem, state: SceneState) -> list[LagFrame]:
    cameras, frames = model.viewpoints(state.camera), list[LagFrame]()
    after: Sequence = [*stretch.measurements[1:], None]
    for t, (one, following) in enumerate(zip(stretch.measurements, after, strict=True)):
        seen: list[tuple[KeypointView, ...] | None] = [
            tuple(view.at_frames(slice(t, t + 1)) for view in camera.views) for camera in cameras
        ]
        frame = lag_frame(one, seen)
        if following is not None:
            frame.take_accelerations(following)
        frame.contacts = [own.contact_confidence[t] for own in model.wearers]
        frames.append(frame)
    return frames


def _frame_state(state: SceneState, t: int) -> FrameState:
    poses = state.camera.poses
    at = t if len(poses) > 1 else 0
    return FrameState(
        np.stack([own.R_parent_child[t] for own in state.wearers]),
        np.stack([own.p_world_pelvis[t] for own in state.wearers]),
        poses.R_world_camera[at],
        poses.p_world_camera[at],
    )
