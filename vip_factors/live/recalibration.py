"""Calibration found anew while tracking: the batch stages over all that was measured so far.

A second of data, which tracking begins with, shows neither where every sensor points nor how long a limb is. After some
seconds the stages that batch uses find headings, mountings, the body, the axes of its hinges, the sensors' places, the
detector's offsets and a standing camera out of everything since the start, and tracking goes on from there.
"""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from vip_factors.assembly.objective import SceneObjective
from vip_factors.geometry.rotations import Array
from vip_factors.live.measurement import MeasuredStretch
from vip_factors.live.settings import LiveSettings
from vip_factors.live.start import (
    EarlierCalibration,
    TrackingStart,
    solve_stretch,
    tracking_start,
    unsettled_starts,
)
from vip_factors.problem.layout import Layout
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.solve.elimination import last_covariance
from vip_factors.stages.fusion import FusionSolution

NO_PRIOR = np.pi  # radians, of headings and mountings: what is known of them, the information says


def recalibrate(
    stretch: MeasuredStretch, settings: LiveSettings, earlier: EarlierCalibration | None = None
) -> TrackingStart:
    """The last frames of a stretch, with all that the whole of it teaches of what frames share.

    Args:
        stretch: all that is to be learnt from.
        settings: of all.
        earlier: from before a pause.

    Raises:
        RecordingError: if the sensors say too little.
        SolveError: if the problem is not determined.
    """
    own = settings.recalibration
    batch = replace(settings, calibration=own.calibration)
    with threadpool_limits(limits=1, user_api="blas"):
        coarse, end = solve_stretch(stretch, batch, earlier), stretch.tail(own.frames)
        model, state, spreads = coarse.at_full_rate(end, batch)
        wearers = tuple(_freed(*each, settings) for each in zip(model.wearers, state.wearers, strict=True))
        found = tracking_start(end, coarse, replace(model, wearers=wearers), state, spreads, settings)
        information = information_of(coarse.fused, found.problem.layout, own.inflation)
        return replace(found, information=information, findings=tuple(unsettled_starts(coarse)))


def information_of(fused: FusionSolution, layout: Layout, inflation: float) -> Array:
    """What a solved scene knows of the static variables of a layout: information ``(s, s)`` about its solution.

    Standard deviations are taken ``inflation`` times as large.

    Raises:
        SolveError: if the scene does not determine them.
    """
    objective = SceneObjective(fused.model)
    covariance = last_covariance(objective.linearise(fused.state), objective.static_keys)
    own, theirs = list[int](), list[int]()
    for owner, block, columns in layout.placed():
        found = objective.layout.columns(owner, block.name)
        if block.free and len(found) == block.width:
            own += range(columns.start, columns.stop)
            theirs += found.tolist()
    information = np.zeros((layout.static_width, layout.static_width))
    information[np.ix_(own, own)] = np.linalg.inv(covariance[np.ix_(theirs, theirs)]) / inflation**2
    return information


def _freed(model: WearerProblem, state: WearerState, settings: LiveSettings) -> WearerProblem:
    """A wearer's problem with calibration free, about what was found and without any other prior."""
    S = len(model.sensors)
    return replace(
        model,
        free_headings=settings.calibration.estimate_headings,
        free_mountings=settings.calibration.estimate_mountings,
        prior_headings=state.headings,
        heading_sigma=np.full(S, NO_PRIOR),
        prior_R_bone_sensor=state.R_bone_sensor,
        mounting_sigma=np.full(S, NO_PRIOR),
        p_world_start=state.p_world_pelvis[0],
    )
