"""The blueprint: a large 3D view that follows the person, the text, and the plots beside it."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.motion import Motion
from vip_factors.geometry.rotations import Array

BACKGROUND = (30, 33, 39)  # the tone of the panels around it
GRID = (70, 76, 86)
EYE_DISTANCE_M = {1: 3.0, 2: 4.4}  # by how many bodies stand apart: a person fills two thirds of the view's height
KIND_TITLES = {
    "joint_error_mm": "Joint error (mm)",
    "orientation_deg": "Orientation residual (°)",
    "acceleration_m_s2": "Acceleration residual (m/s²)",
    "specific_force_m_s2": "Specific force (m/s²)",
    "angular_rate_rad_s": "Angular rate (rad/s)",
}


def blueprint(
    shown: Motion,
    follow: str | None,
    floor: float,
    apart: int,
    has_error: bool,
    residuals: Sequence[str],
    imus: Sequence[str],
) -> rrb.Blueprint:
    """The layout of the viewer.

    Args:
        shown: the main body, for placing the eye.
        follow: entity that the eye follows, or None for a still scene.
        floor: height of the grid in metres.
        apart: how many bodies stand apart from each other, 1 or 2.
        has_error: whether ``plots/error/joint_error_mm`` exists.
        residuals: kinds below ``plots/residual``.
        imus: kinds below ``plots/imu``.
    """
    world = rrb.Spatial3DView(
        origin="/world",
        name="Motion",
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(
            visible=True, spacing=0.5, plane=rr.components.Plane3D([0, 0, 1], floor), stroke_width=1.0, color=GRID
        ),
        eye_controls=_eye(shown, follow, EYE_DISTANCE_M[apart]),
    )
    plots = [_plot("error", "joint_error_mm")] if has_error else []
    plots += [_plot("residual", kind) for kind in residuals]
    measured = [_plot("imu", kind) for kind in imus]
    text = rrb.TextDocumentView(origin="/summary", name="Summary")
    side: list[rrb.View | rrb.Container]
    if plots:
        side = [text, *plots]
        if measured:
            side.append(rrb.Tabs(*measured, name="Measured"))
    else:
        side = [text, *measured]
    shares = [2.0 if plots else 1.0, *[1.0] * (len(side) - 1)]
    return rrb.Blueprint(
        rrb.Horizontal(world, rrb.Vertical(*side, row_shares=shares), column_shares=[1.7, 1]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _plot(group: str, kind: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"/plots/{group}/{kind}", name=KIND_TITLES.get(kind, kind), plot_legend=rrb.PlotLegend(visible=False)
    )


def _eye(shown: Motion, follow: str | None, distance: float) -> rrb.EyeControls3D:
    """Look at the person from the front and left, a little from above."""
    forward: Array = shown.state.R_world_bone[0, 0, :, 2] * [1, 1, 0]
    norm = float(np.linalg.norm(forward))
    forward = forward / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    direction = 0.75 * forward + 0.60 * left + np.array([0.0, 0.0, 0.28])
    target = shown.p_world_pelvis[0]
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=follow,
    )
