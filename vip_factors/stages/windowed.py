"""The estimate of a recording that is solved window by window."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.estimate import Estimate, EstimateChunks, PoseCovariance, WearerEstimate
from vip_factors.sensors.sampled import SampledRecording
from vip_factors.settings import Settings, flatten
from vip_factors.stages.calibration_start import start_choice, start_findings
from vip_factors.stages.decode import calibration_of, motion_of
from vip_factors.stages.drift import drift_findings
from vip_factors.stages.inertial import Tracked, with_calibration_sigmas
from vip_factors.stages.inertial_model import method_of
from vip_factors.stages.solver import Progress, Solver
from vip_factors.stages.wearer_findings import posture_findings
from vip_factors.stages.window_join import joined
from vip_factors.stages.window_solve import SolvedWindow, calibrate, solve_windows, with_sensors_checked
from vip_factors.stages.windows import WindowPlan

WINDOWS = "windows"  # the stage, as progress tells it


def is_long(interval: tuple[float, float], settings: Settings) -> bool:
    """Whether a recording from one instant to another (seconds) is to be solved window by window."""
    return settings.windows.use and interval[1] - interval[0] > settings.windows.above_s


def smooth_windows(recording: SampledRecording, settings: Settings, progress: Progress) -> EstimateChunks:
    """The estimate of a recording; calibrated now, and solved as its chunks are asked for.

    Findings on accelerometers and on the wearer's posture are of the frames that calibrate, which are spread over the
    recording; clocks are compared in its middle.

    Raises:
        InputError, RecordingError: for a recording that cannot be used; for samples, as chunks are asked for.
        SolveError: if the problem is not determined; likewise.
    """
    plan = WindowPlan.of(recording.interval, settings)
    solver = Solver(settings.solve, progress, name=settings.solver)
    with threadpool_limits(limits=1, user_api="blas"):
        recording, about_sensors = with_sensors_checked(recording, plan, settings)
        found = calibrate(recording, plan, settings, solver)
        head = _head(recording, found, plan, settings)
        if settings.acceleration:
            head = with_calibration_sigmas(head, found, settings.calibration)
    head = replace(head, reports=tuple(solver.reports), findings=(*about_sensors, *head.findings))
    chunks = _chunks(recording, found, plan, settings, head, progress)
    return EstimateChunks(Estimate.of_one(head), (plan.frames,), map(Estimate.of_one, chunks))


def _chunks(
    recording: SampledRecording, found: Tracked, plan: WindowPlan, settings: Settings, head: WearerEstimate,
    progress: Progress,
) -> Iterator[WearerEstimate]:  # fmt: skip
    count = len(plan.windows())

    def solver(window: int) -> Solver:
        return Solver(settings.solve, lambda stage, fraction: None, name=settings.solver)

    def told(windows: Iterator[SolvedWindow]) -> Iterator[SolvedWindow]:
        for number, window in enumerate(windows):
            progress(WINDOWS, (number + 1) / count)
            yield window

    progress(WINDOWS, 0.0)
    with threadpool_limits(limits=1, user_api="blas"):
        yield from joined(told(solve_windows(found, recording, plan, settings, solver)), found.model, head)


def _head(recording: SampledRecording, found: Tracked, plan: WindowPlan, settings: Settings) -> WearerEstimate:
    """All but the frames."""
    head, model = recording.head, found.model
    sample = motion_of(model, found.state, head.name)
    calibration = calibration_of(model, found.state)
    motion = replace(
        sample, R_parent_child=np.zeros((0, JOINT_COUNT, 3, 3)), p_world_pelvis=np.zeros((0, 3)), rate=plan.rate,
        start=plan.start,
    )  # fmt: skip
    kinds = ("orientation_deg", *(("acceleration_m_s2",) if settings.acceleration else ()))
    who = f"wearer '{head.subject.name}'"
    return WearerEstimate(
        head.name,
        method_of(model, settings),
        motion,
        calibration,
        PoseCovariance(np.zeros((0, JOINT_COUNT, 3, 3)), np.zeros((0, 3, 3))) if settings.covariance else None,
        {kind: np.zeros((0, len(model.sensors))) for kind in kinds},
        model.frames.sensors,
        settings=flatten(settings),
        findings=(
            *start_findings(who, model.frames.sensors, found.starts),
            *posture_findings(who, head, sample, calibration, model.prior_R_bone_sensor),
            *drift_findings(who, calibration),
        ),
        start=start_choice(model.frames.sensors, found.starts),
    )
