"""Coarse frames of a scene, solved with all that frames share: who is who, where cameras are, then all at once."""

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
    """A scene, solved on every n-th frame.

    Attributes:
        scene: what was solved, its sensors put right.
        wearers: where each began: in front of cameras in one world, else by itself.
        fused: all together.
        start: where the fusion with the cameras started; None where no camera shows a wearer.
        associated: the cameras that are of use: who is who in each of their video frames.
        about_floor: what is odd about it.
    """

    scene: Scene
    wearers: tuple[InertialSolution, ...]
    fused: FusionSolution
    start: FusionStart | None = None
    associated: tuple[AssociatedCamera, ...] = ()
    about_floor: tuple[Finding, ...] = ()

    @classmethod
    def unfilmed(cls, scene: Scene, wearers: Sequence[InertialSolution]) -> "SceneSolution":
        """Of wearers as they were solved without a camera."""
        model = unfilmed_problem([wearer.model for wearer in wearers])
        state = SceneState.unfilmed([wearer.state for wearer in wearers])
        return cls(scene, tuple(wearers), FusionSolution(model, state, ()))

    @property
    def shown(self) -> int:
        """How many wearers were found in a video."""
        return sum(any(len(each.seen[n]) for each in self.associated) for n in range(len(self.wearers)))

    @property
    def is_world_known(self) -> bool:
        """Whether the pose of a camera was given: the floor is at z = 0 then."""
        return any(each.camera.known_path is not None for each in self.associated)

    def with_rivals_solved(self, settings: CommonSettings, solver: Solver) -> "SceneSolution":
        """The same, but for starts whose rivals end in the same motion: those are settled."""
        model, state = self.fused.model, self.fused.state
        return replace(
            self,
            wearers=tuple(
                replace(one, starts=with_rivals_solved(one.starts, model, state, number, recording, settings, solver))
                for number, (recording, one) in enumerate(zip(self.scene.wearers, self.wearers, strict=True))
            ),
        )

    def on_floor(self, settings: CommonSettings) -> "SceneSolution":
        """The same with its floor at z = 0."""
        fused = self.fused
        state, findings = on_floor(fused.model.wearers, fused.state, settings.floor, self.is_world_known)
        return replace(self, fused=replace(fused, state=state), about_floor=findings)

    def frames_at(self, time: Array) -> tuple[ImuFrames, ...]:
        """Frames of each wearer's sensors at the instants ``time`` ``(T,)``."""
        return tuple(
            frames_of(recording.imus, wearer.model.frames.sensors, time)
            for recording, wearer in zip(self.scene.wearers, self.wearers, strict=True)
        )

    def problem_on(self, frames: Sequence[ImuFrames], settings: CommonSettings) -> FusionSolution:
        """The problem on other ``frames`` of each wearer, with all that they share kept, and where to start."""
        if self.start is not None:
            return fusion_problem_on_frames(self.start, self.fused, self.associated, frames, settings)
        models, states = [], []
        for coarse, measured in zip(self.fused.wearers, frames, strict=True):
            states.append(at_frames(coarse.state, coarse.model.frames.time, measured.time))
            models.append(with_contacts(on_frames_with_fixed_calibration(coarse.model, measured), states[-1]))
        return FusionSolution(unfilmed_problem(models), SceneState.unfilmed(states), ())

    def at_full_rate(self, frames: Sequence[ImuFrames], settings: CommonSettings, solver: Solver) -> FusionSolution:
        """A filmed scene solved on other ``frames`` of each wearer, with all that they share kept.

        Raises:
            SolveError: if the problem is not determined.
        """
        assert self.start is not None
        return fuse_finely(self.start, self.fused, self.associated, frames, settings, solver)

    def about_starts(self) -> Iterator[Finding]:
        """Sensors that cannot tell a motion, and starts that the data does not settle."""
        for recording, wearer in zip(self.scene.wearers, self.wearers, strict=True):
            yield from sampling_findings(recording, wearer.model.frames)
            yield from start_findings(recording.subject.name, wearer.model.frames.sensors, wearer.starts)


def start_before_cameras(
    scene: Scene, trackers: Sequence[InertialSolution], settings: CommonSettings, solver: Solver,
    is_calibrated: bool = False,
) -> FusionStart | tuple[Finding, ...]:  # fmt: skip
    """Who is who, and all wearers and cameras in one world; findings, if the cameras show nobody whom they know.

    Args:
        scene: with cameras.
        trackers: each wearer by the sensors alone.
        settings, solver: of the scene.
        is_calibrated: whether the trackers' calibration is as good as the sparse inertial poser would make it.
    """
    if is_calibrated:
        associated = associate_cameras(scene, trackers, settings, solver.progress_of("association"))
    else:
        trackers, associated = first_association(scene, trackers, settings, solver)
    usable = usable_cameras(associated)
    return start_fusion(usable, trackers, settings) if usable else who_is_who(scene, associated)


def _misfit(fused: FusionSolution) -> int | None:
    """Number of the camera whose detections fit the wearers worst, if they hardly do and those of another camera do."""
    spreads = [
        float(np.mean([spread for spread, view in zip(own, views, strict=True) if view.seen.any()] or [0.0]))
        for own, views in zip(fused.measured_spreads(), fused.model.views, strict=True)
    ]
    worst = int(np.argmax(spreads)) if len(spreads) > 1 else 0
    return worst if len(spreads) > 1 and spreads[worst] > IMPLAUSIBLE_SCATTER > min(spreads) else None


def solve_from(start: FusionStart, scene: Scene, settings: CommonSettings, solver: Solver) -> SceneSolution:
    """Wearers and cameras solved together from where they start, without cameras that do not fit the others.

    Raises:
        SolveError: if the problem is not determined.
    """
    fused, associated = fuse_in_rounds(start, settings, solver)
    misfit = _misfit(fused)
    if misfit is not None:
        return solve_from(start.without_camera(misfit), scene, settings, solver)
    return SceneSolution(scene, start.wearers, fused, start, associated)
