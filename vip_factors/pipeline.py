"""The pipeline on one page: recording → inertial tracker → sparse inertial poser → estimate."""

from vip_factors.estimate import Estimate, PoseCovariance
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.decode import decode, pose_covariance
from vip_factors.graph.model import InertialModel
from vip_factors.graph.state import GraphState
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings, flatten
from vip_factors.solve.marginals import chain_marginals
from vip_factors.stages.inertial import at_frames, inertial_tracker
from vip_factors.stages.inertial_model import FEW_SENSORS, alone, kept, loosened, with_contacts
from vip_factors.stages.solver import Progress, Solver

DEFAULT = Settings()


def smooth(recording: Recording, settings: Settings = DEFAULT, progress: Progress | None = None) -> Estimate:
    """Reconstruct a whole recording from its IMUs.

    First coarsely: the inertial tracker (IT; thesis eq. 4.10) starts the sparse inertial poser (SIP; thesis 3.3) on
    every n-th frame, with headings, mountings and the mean pose free. Then at the full rate, with those kept. The
    acceleration factor is exact at either rate.

    Args:
        recording: with at least one placed sensor.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    solver = Solver(settings.solve, progress or (lambda stage, fraction: None))
    coarse = settings.coarse_factor if settings.acceleration else 1
    frames = resample(recording, settings.frame_rate / coarse)
    tracked = inertial_tracker(recording, frames, settings, solver)
    model, state = tracked.model, tracked.state
    if not settings.acceleration:
        model = alone(model)
    else:
        free = loosened(model, settings.calibration)
        for _ in range(settings.calibration.passes):
            state = solver.solve(BatchObjective(with_contacts(free, state)), state, "calibration")
        model = kept(model, resample(recording, settings.frame_rate))
        state = at_frames(state, frames.time, model.frames.time)
        model = with_contacts(model, state)
        state = solver.solve(BatchObjective(model), state, "sparse inertial poser")
    covariance = _covariance(model, state) if settings.covariance else None
    return decode(
        recording.name, _method(model, settings), model, state, covariance, tuple(solver.reports), flatten(settings)
    )


def _method(model: InertialModel, settings: Settings) -> str:
    if settings.acceleration:
        return "SIP"
    return "SOP" if len(model.sensors) <= FEW_SENSORS else "IT"


def _covariance(model: InertialModel, state: GraphState) -> PoseCovariance:
    objective = BatchObjective(model)
    return pose_covariance(objective, chain_marginals(objective.linearise(state)))
