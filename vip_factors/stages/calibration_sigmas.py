"""How sure headings and mountings are that were found without a camera."""

from dataclasses import replace

from vip_factors.assembly.objective import WearerObjective
from vip_factors.errors import SolveError
from vip_factors.estimate import Estimate
from vip_factors.problem.extra import ExtraTerms
from vip_factors.problem.scene import SceneProblem
from vip_factors.settings import CalibrationSettings
from vip_factors.solve.marginals import last_marginals
from vip_factors.stages.inertial import Tracked
from vip_factors.stages.inertial_model import loosened, with_contacts
from vip_factors.stages.scene_decode import with_sigmas

UNDETERMINED = "the data do not determine all headings and mountings: in part they are guesses"


def with_calibration_sigmas(
    estimate: Estimate, found: Tracked, settings: CalibrationSettings, extra: ExtraTerms | None = None
) -> Estimate:
    """The estimate with standard deviations of headings and mountings; with a finding, if they are not determined.

    They are marginals at the solution that found them, on its coarse frames: at the full
    rate headings and mountings are kept, as if they were known. That costs as much as one of its iterations.

    Args:
        estimate: whose calibration is that of ``found``.
        found: as :func:`~vip_factors.stages.inertial.calibrated` returns it.
        settings, extra: with which it was found.
    """
    objective = WearerObjective(with_contacts(loosened(found.model, settings), found.state), extra)
    keys = objective.scene.static_keys
    if not keys:
        return estimate
    try:
        marginals = last_marginals(objective.linearise(found.state), keys)
    except SolveError:
        return replace(estimate, findings=(*estimate.findings, UNDETERMINED))
    return with_sigmas(estimate, SceneProblem.unfilmed([objective.problem]), 0, marginals)
