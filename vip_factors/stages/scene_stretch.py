"""What all frames of a long scene share, found on coarse frames of a stretch of it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.estimate import SceneEstimate
from vip_factors.sensors.long_scene import LongScene
from vip_factors.settings import Settings
from vip_factors.solve.levenberg_marquardt import SolveSettings
from vip_factors.stages.associated_cameras import of_use
from vip_factors.stages.calibration_start import start_choice, start_findings
from vip_factors.stages.filming import start_filming
from vip_factors.stages.first_association import first_association
from vip_factors.stages.fusion_rounds import fuse_in_rounds
from vip_factors.stages.inertial import Tracked, inertial_trackers
from vip_factors.stages.reporting import scene_estimate
from vip_factors.stages.scene_calibration import SceneCalibration
from vip_factors.stages.sensor_checks import checked_scene
from vip_factors.stages.sensor_corrections import SensorCorrections
from vip_factors.stages.solver import Progress, Solver
from vip_factors.stages.windows import WindowPlan

LOOKS = 3  # at stretches that are spread over a scene, where the first does not show every wearer


def calibrate_scene(
    source: LongScene, plan: WindowPlan, settings: Settings, progress: Progress
) -> tuple[SceneCalibration, SceneEstimate] | None:
    """What all frames share, and the coarse estimate of the stretch that says it: the first that shows everybody.

    Of none does, that which shows most of them; None if nobody is seen in any.
    """
    coarse = -(-plan.frames // plan.factor)
    best: tuple[int, SceneCalibration, SceneEstimate] | None = None
    for begin in sorted({round(one) for one in np.linspace(0, max(coarse - plan.stretch, 0), LOOKS)}):
        stretch = slice(begin, min(begin + plan.stretch, coarse))
        found = _stretch(source, plan, stretch, settings, Solver(stiff(settings), progress, name=settings.solver))
        if found is not None and (best is None or found[0] > best[0]):
            best = found
        if best is not None and best[0] == len(source.wearers):
            break
    return None if best is None else best[1:]


def _stretch(
    source: LongScene, plan: WindowPlan, stretch: slice, settings: Settings, solver: Solver
) -> tuple[int, SceneCalibration, SceneEstimate] | None:
    """One stretch of coarse frames solved with everything free: how many wearers it shows, and what it says."""
    time = plan.coarse_time(stretch)
    scene = source.between(float(time[0]), float(time[-1]))
    if stretch.start:
        scene = replace(scene, wearers=tuple(replace(one, initial_pose="none") for one in scene.wearers))
    measured = scene
    scene, about_sensors = checked_scene(measured, settings)
    corrections = [SensorCorrections.between(*one) for one in zip(measured.wearers, scene.wearers, strict=True)]
    wearers = inertial_trackers(scene, time, settings, solver)
    wearers, filmed_by = first_association(scene, wearers, settings, solver)
    associated = of_use(filmed_by)
    if not associated:
        return None
    names = [one.subject.name for one in scene.wearers]
    filmed = start_filming(associated, wearers, settings)
    fused, associated = fuse_in_rounds(filmed, associated, names, settings, solver)
    estimate = scene_estimate(
        scene, fused, fused, associated, tuple(solver.reports), replace(settings, covariance=False)
    )
    estimate = _with_starts(replace(estimate, findings=(*about_sensors, *estimate.findings)), names, wearers)
    sigmas = [np.array([one.calibration[name].mounting_sigma for name in one.sensors]) for one in estimate.wearers]
    shown = sum(any(len(each.seen[number]) for each in associated) for number in range(len(names)))
    found = SceneCalibration.of(scene, fused, associated[0].camera, sigmas, corrections)
    return shown, found, estimate


def _with_starts(estimate: SceneEstimate, names: Sequence[str], wearers: Sequence[Tracked]) -> SceneEstimate:
    """The estimate, told how the wearers' starts were found."""
    told = tuple(
        replace(one, start=start_choice(tracked.model.frames.sensors, tracked.starts))
        for one, tracked in zip(estimate.wearers, wearers, strict=True)
    )
    about = (
        sentence
        for name, one in zip(names, wearers, strict=True)
        for sentence in start_findings(f"wearer '{name}'", one.model.frames.sensors, one.starts)
    )
    return replace(estimate, wearers=told, findings=(*estimate.findings, *about))


def stiff(settings: Settings) -> SolveSettings:
    """The optimiser's settings in front of cameras."""
    return replace(settings.solve, relative_decrease=settings.fusion.relative_decrease)
