"""The blueprint: a large 3D view that follows the person, the text, and the plots beside it."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour
from vip_factors.viz.rerun_eye import eye, forward_of
from vip_factors.viz.rerun_series import LEGEND

BACKGROUND: Colour = (222, 226, 231)  # bright, so that bodies stand out in every colour they have
GRID: Colour = (178, 185, 194)
UPRIGHT, LEVEL = 1.1, 2.3  # width by height of the world's view: alone, and above a camera's image
BESIDE_M = 0.6  # from the middle to either of two bodies that are compared side by side
LEGEND_SHARE = 0.85  # of a plot's height
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
    span: tuple[float, float],
    has_legend: bool,
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
        span: seconds that the plots show.
        has_legend: whether the legend of the sensors was logged.
    """
    spread = BESIDE_M * (apart - 1)
    controls = eye(shown.p_world_pelvis[0], forward_of(shown), spread, UPRIGHT, follow)
    world = world_view("Motion", floor, controls)
    plots = [_plot("error", "joint_error_mm", span)] if has_error else []
    plots += [_plot("residual", kind, span) for kind in residuals]
    measured = [_plot("imu", kind, span) for kind in imus]
    text = rrb.TextDocumentView(origin="/summary", name="Summary")
    side: list[rrb.View | rrb.Container] = [text, *plots]
    if plots and measured:
        side.append(rrb.Tabs(*measured, name="Measured"))
    elif measured:
        side += measured
    shares = [2.6 if plots else 1.0, *[1.0] * (len(side) - 1)]
    if has_legend:
        side, shares = [*side, legend_view()], [*shares, LEGEND_SHARE]
    return rrb.Blueprint(
        rrb.Horizontal(world, rrb.Vertical(*side, row_shares=shares), column_shares=[1.6, 1]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def world_view(
    name: str, floor: float, controls: rrb.EyeControls3D | None, left_out: Sequence[str] = ()
) -> rrb.Spatial3DView:
    """The 3D view: bright, with a grid on the floor.

    Args:
        name: its title.
        floor: height of the grid in metres.
        controls: of the eye.
        left_out: entities below the world that do not belong into it.
    """
    grid = rrb.LineGrid3D(
        visible=True, spacing=0.5, plane=rr.components.Plane3D([0, 0, 1], floor), stroke_width=1.0, color=GRID
    )
    return rrb.Spatial3DView(
        origin="/world",
        name=name,
        background=BACKGROUND,
        contents=["$origin/**", *(f"- /{entity}/**" for entity in left_out)],
        line_grid=grid,
        eye_controls=controls,
    )


def span_axis(span: tuple[float, float]) -> rrb.TimeAxis:
    """The time axis of a plot: the recording's span in seconds, not that of whatever else was logged."""
    at = rr.TimeRangeBoundary.absolute
    return rrb.TimeAxis(view_range=rr.TimeRange(start=at(seconds=span[0]), end=at(seconds=span[1])))


def legend_view() -> rrb.Spatial2DView:
    """The view of the legend of the sensors' colours, on the dark of the plots that it explains."""
    return rrb.Spatial2DView(origin=f"/{LEGEND}", name="Sensors' colours", background=(16, 17, 19))


def _plot(group: str, kind: str, span: tuple[float, float]) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"/plots/{group}/{kind}",
        name=KIND_TITLES.get(kind, kind),
        plot_legend=rrb.PlotLegend(visible=False),
        axis_x=span_axis(span),
    )
