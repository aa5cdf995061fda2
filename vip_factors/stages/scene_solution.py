"""Solution of a scene on coarse frames: association, initial cameras, then all variables at once."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.problem.state import SceneState
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import frames_of
from vip_factors.settings import CommonSettings
from vip_factors.stages.association import AssociatedCamera, associate_cameras, first_association, usable_cameras
from vip_factors.stages.calibration_start import start_findings
from vip_factors.stages.findings import IMPLAUSIBLE_SCATTER, who_is_who
from vip_factors.stages.floor import on_floor
from vip_factors.stages.fusion import FusionSolution, fuse_finely, fuse_in_rounds, fusion_problem_on_frames
from vip_factors.stages.fusion_start import FusionStart, start_fusion
from vip_factors.stages.inertial import InertialSolution, at_frames
from vip_factors.stages.inertial_model import on_frames_with_fixed_calibration, with_contacts
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.sensor_checks import sampling_findings
from vip_factors.stages.solver import Solver
from vip_factors.terms.registry import unfilmed_problem


@dataclass(frozen=True)
class SceneSolution:
    """Solution of a scene on its coarse frames.

    Attributes:
        scene: the scene with corrected sensors.
        wearers: initial solution of each wearer, in one world in front of cameras, otherwise in its own.
        fusion: solution of all wearers and cameras together.
        start: start of the fusion; None if no camera shows a wearer.
        associated: usable cameras with the wearer of each detection.
        floor_findings: findings about the floor.
    """

    scene: Scene
    wearers: tuple[InertialSolution, ...]
    fusion: FusionSolution
    start: FusionStart | None = None
    associated: tuple[AssociatedCamera, ...] = ()
    floor_findings: tuple[Finding, ...] = ()

    @classmethod
    def unfilmed(cls, scene: Scene, wearers: Sequence[InertialSolution]) -> "SceneSolution":
        """Combine the solutions of wearers without cameras."""
        model = unfilmed_problem([wearer.model for wearer in wearers])
        state = SceneState.unfilmed([wearer.state for wearer in wearers])
        return cls(scene, tuple(wearers), FusionSolution(model, state, ()))

    @property
    def shown(self) -> int:
        """Number of wearers visible in a video."""
        return sum(any(len(camera.sightings[n]) for camera in self.associated) for n in range(len(self.wearers)))

    @property
    def is_world_known(self) -> bool:
        """True if the pose of a camera is given; the floor is then at z = 0."""
        return any(camera.camera.known_path is not None for camera in self.associated)

    def with_rivals_solved(self, settings: CommonSettings, solver: Solver) -> "SceneSolution":
        """Drop rival starts that lead to the same motion."""
        model, state = self.fusion.model, self.fusion.state
        return replace(
            self,
            wearers=tuple(
                replace(
                    wearer, starts=with_rivals_solved(wearer.starts, model, state, number, recording, settings, solver)
                )
                for number, (recording, wearer) in enumerate(zip(self.scene.wearers, self.wearers, strict=True))
            ),
        )

    def on_floor(self, settings: CommonSettings) -> "SceneSolution":
        """Move the solution so that its floor is at z = 0."""
        fusion = self.fusion
        state, findings = on_floor(fusion.model.wearers, fusion.state, settings.floor, self.is_world_known)
        return replace(self, fusion=replace(fusion, state=state), floor_findings=findings)

    def frames_at(self, time: Array) -> tuple[ImuFrames, ...]:
        """Frames of each wearer's sensors at the instants ``time`` ``(T,)``."""
        return tuple(
            frames_of(recording.imus, wearer.model.frames.sensors, time)
            for recording, wearer in zip(self.scene.wearers, self.wearers, strict=True)
        )

    def problem_on(self, frames: Sequence[ImuFrames], settings: CommonSettings) -> FusionSolution:
        """Build the problem on other ``frames`` of each wearer with fixed shared variables, and its initial state."""
        if self.start is not None:
            return fusion_problem_on_frames(self.start, self.fusion, self.associated, frames, settings)
        models, states = [], []
        for coarse, measured in zip(self.fusion.wearers, frames, strict=True):
            states.append(at_frames(coarse.state, coarse.model.frames.time, measured.time))
            models.append(with_contacts(on_frames_with_fixed_calibration(coarse.model, measured), states[-1]))
        return FusionSolution(unfilmed_problem(models), SceneState.unfilmed(states), ())

    def at_full_rate(self, frames: Sequence[ImuFrames], settings: CommonSettings, solver: Solver) -> FusionSolution:
        """Solve a filmed scene on other ``frames`` of each wearer, with fixed shared variables.

        Raises:
            SolveError: if the problem is not determined.
        """
        assert self.start is not None
        return fuse_finely(self.start, self.fusion, self.associated, frames, settings, solver)

    def start_findings(self) -> Iterator[Finding]:
        """Report sensors with too few samples and starts that the data do not determine."""
        for recording, wearer in zip(self.scene.wearers, self.wearers, strict=True):
            yield from sampling_findings(recording, wearer.model.frames)
            yield from start_findings(recording.subject.name, wearer.model.frames.sensors, wearer.starts)


def start_before_cameras(
    scene: Scene,
    trackers: Sequence[InertialSolution],
    settings: CommonSettings,
    solver: Solver,
    is_calibrated: bool = False,
) -> FusionStart | tuple[Finding, ...]:
    """Associate the cameras and compute initial wearers and cameras in one world; findings if no wearer is recognised.

    Args:
        scene: scene with cameras.
        trackers: inertial solution of each wearer.
        settings, solver: of the scene.
        is_calibrated: whether the trackers' calibration is as good as that of the sparse inertial poser.
    """
    if is_calibrated:
        associated = associate_cameras(scene, trackers, settings, solver.progress_of("association"))
    else:
        trackers, associated = first_association(scene, trackers, settings, solver)
    usable = usable_cameras(associated)
    return start_fusion(usable, trackers, settings) if usable else who_is_who(scene, associated)


def solve_from(start: FusionStart, scene: Scene, settings: CommonSettings, solver: Solver) -> SceneSolution:
    """Solve wearers and cameras together from a start, and leave out a camera that contradicts the others.

    Raises:
        SolveError: if the problem is not determined.
    """
    fusion, associated = fuse_in_rounds(start, settings, solver)
    spreads = [
        float(np.mean([spread for spread, view in zip(camera_spreads, views, strict=True) if view.seen.any()] or [0.0]))
        for camera_spreads, views in zip(fusion.measured_spreads(), fusion.model.views, strict=True)
    ]
    if max(spreads, default=0.0) > IMPLAUSIBLE_SCATTER > min(spreads):
        return solve_from(start.without_camera(int(np.argmax(spreads))), scene, settings, solver)
    return SceneSolution(scene, start.wearers, fusion, start, associated)
