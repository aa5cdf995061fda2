"""A stretch of a stream solved by the stages of the batch pipeline, as they would solve a short scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.assembly.objective import WearerObjective
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.settings import LiveSettings
from vip_factors.problem.scene import KeypointView, SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.frames import coarser
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.stages.association import AssociatedCamera, first_association, of_use
from vip_factors.stages.filming import Filmed, start_filming
from vip_factors.stages.fusion import Fused, at_full_rate, fuse_in_rounds
from vip_factors.stages.inertial import Tracked, at_frames, first_calibration, inertial_tracker
from vip_factors.stages.inertial_model import kept, with_contacts
from vip_factors.stages.solver import Solver

UNKNOWN_HEADING = np.pi  # radians: of a sensor that comes late, before it has been seen to move


@dataclass(frozen=True)
class Known:
    """What an earlier start and all since has taught.

    Attributes:
        calibration: of each wearer's sensors, with standard deviations.
        p_world_pelvis: ``(W, 3)`` metres, of the wearers at the first frame of the new start, or where they were lost.
        bodies: of wearers whose lengths have been found.
    """

    calibration: Mapping[str, Calibration]
    p_world_pelvis: Array
    bodies: Mapping[str, Skeleton] = field(default_factory=dict)

    def embodied(self, wearer: Recording) -> Recording:
        """A wearer with the body that was found."""
        found = self.bodies.get(wearer.subject.name)
        return wearer if found is None else replace(wearer, subject=replace(wearer.subject, skeleton=found))


@dataclass(frozen=True)
class CoarseSolution:
    """A stretch, solved on every n-th frame.

    Attributes:
        scene: the stretch as a scene.
        wearers: each by its IMUs alone.
        fused: all together.
        filmed: where the fusion with the cameras started from; None where no camera shows a wearer.
        associated: of the cameras that are of use: who is who in each of their video frames.
    """

    scene: Scene
    wearers: tuple[Tracked, ...]
    fused: Fused
    filmed: Filmed | None = None
    associated: tuple[AssociatedCamera, ...] = ()

    def at_full_rate(
        self, stretch: MeasuredStretch, settings: LiveSettings
    ) -> tuple[SceneProblem, SceneState, tuple[tuple[float, ...], ...]]:
        """The problem on all frames of a stretch, with all that they share kept, where to start, and spreads.

        Args:
            stretch: what was solved, or a part of it.
            settings: that it was solved with.
        """
        if self.filmed is not None:
            return at_full_rate(self.scene, self.filmed, self.fused, self.associated, stretch.time, settings)
        models, states = [], []
        for recording, model, state in zip(
            self.scene.wearers, self.fused.model.wearers, self.fused.state.wearers, strict=True
        ):
            fine = stretch.frames(recording.subject.name, model.frames.sensors)
            states.append(at_frames(state, model.frames.time, stretch.time))
            models.append(with_contacts(kept(model, fine), states[-1]))
        problem = SceneProblem.unfilmed(models)
        unseen = tuple(KeypointView.unseen((), len(stretch.time)) for _ in models)
        return replace(problem, views=unseen), SceneState.unfilmed(states), ()


def solve_coarsely(stretch: MeasuredStretch, settings: LiveSettings, known: Known | None = None) -> CoarseSolution:
    """Inertial trackers, association and fusion of a stretch.

    Raises:
        RecordingError: if the sensors say too little.
        SolveError: if the problem is not determined.
    """
    scene, solver = stretch.scene(), Solver(settings.solve, lambda stage, fraction: None)
    if known is not None:
        scene = replace(scene, wearers=tuple(known.embodied(one) for one in scene.wearers))
    wearers = tuple(_tracked(stretch, one, settings, solver, known) for one in scene.wearers)
    if scene.cameras and settings.fusion.use_camera:
        filmed = _filmed(scene, wearers, settings, solver)
        if filmed is not None:
            return filmed
    models = [with_contacts(replace(one.model, free_pose_mean=False), one.state) for one in wearers]
    states = [
        solver.solve_wearer(WearerObjective(model), one.state, "start")
        for model, one in zip(models, wearers, strict=True)
    ]
    fused = Fused(SceneProblem.unfilmed(models), SceneState.unfilmed(states), ())
    return CoarseSolution(scene, wearers, fused)


def _filmed(scene: Scene, wearers: Sequence[Tracked], settings: LiveSettings, solver: Solver) -> CoarseSolution | None:
    """The solution in front of cameras; None if they do not show anybody whom it knows."""
    if not any(len(camera.detections) for camera in scene.cameras):
        return None
    names = [one.subject.name for one in scene.wearers]
    wearers, filmed_by = first_association(scene, wearers, settings, solver)
    associated = of_use(filmed_by)
    if not associated:
        return None
    filmed = start_filming(associated, wearers, settings)
    fused, associated = fuse_in_rounds(filmed, associated, names, settings, solver)
    return CoarseSolution(scene, tuple(wearers), fused, filmed, tuple(associated))


def _tracked(
    stretch: MeasuredStretch, recording: Recording, settings: LiveSettings, solver: Solver, known: Known | None
) -> Tracked:
    frames = coarser(stretch.frames(recording.subject.name, recording.placed), settings.coarse_factor)
    if known is None:
        return inertial_tracker(recording, frames, settings, solver)
    own = dict(known.calibration[recording.subject.name])
    if any(name not in own for name in frames.sensors):
        fresh = first_calibration(recording, frames, settings)
        for s, name in enumerate(frames.sensors):
            sigma = np.full(3, recording.placement.site(name).mounting_sigma)
            heading = float(fresh.headings[s])
            own.setdefault(name, SensorCalibration(heading, fresh.R_bone_sensor[s], UNKNOWN_HEADING, sigma))
    one = [own[name] for name in frames.sensors]
    sigma = np.array([each.heading_sigma for each in one])
    calibration = InitialCalibration(
        np.array([each.heading for each in one]), sigma, np.stack([each.R_bone_sensor for each in one])
    )
    tracked = inertial_tracker(recording, frames, settings, solver, calibration)
    mounting = np.array([np.sqrt(np.mean(each.mounting_sigma**2)) for each in one])
    return replace(tracked, model=replace(tracked.model, mounting_sigma=mounting))
