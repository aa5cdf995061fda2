"""The viewer's layout for a stream: the world above the camera's image, findings and curves beside them."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.motion import Motion
from vip_factors.sensors.live import LiveSetup
from vip_factors.viz.layout import BACKGROUND, GRID
from vip_factors.viz.live_series import HEADING_SIGMAS, HEADINGS, POSE_SIGMAS, UPDATE_MS
from vip_factors.viz.scene_layout import IMAGE_BACKGROUND

SHOWN_S = 30.0  # seconds of the curves before now
EYE_DISTANCE_M = 4.0  # everything within arm's reach of the wearer, and a second one beside


def live_blueprint(
    setup: LiveSetup, shown: Motion, body: str, image: str, findings: str, floor: float
) -> rrb.Blueprint:
    """The layout.

    Args:
        setup: of what is streamed.
        shown: the first wearer's first pose, for placing the eye.
        body: entity of that wearer's body, which the eye follows.
        image: entity of the first camera's image.
        findings: entity of the sentences for the user.
        floor: height of the grid in metres.
    """
    world = rrb.Spatial3DView(
        origin="/world",
        name="World",
        background=BACKGROUND,
        contents=["$origin/**", f"- /{image}/body/**", f"- /{image}/detected/**"],
        line_grid=rrb.LineGrid3D(
            visible=True, spacing=0.5, plane=rr.components.Plane3D([0, 0, 1], floor), stroke_width=1.0, color=GRID
        ),
        eye_controls=_eye(shown, f"{body}/pelvis"),
    )
    left: rrb.View | rrb.Container = world
    if setup.camera is not None:
        model = setup.camera.model
        rim = 0.02 * model.width
        bounds = rrb.VisualBounds2D(x_range=(-rim, model.width + rim), y_range=(-rim, model.height + rim))
        camera = rrb.Spatial2DView(origin=f"/{image}", name="Camera", background=IMAGE_BACKGROUND, visual_bounds=bounds)
        left = rrb.Vertical(world, camera, row_shares=[1, 1])
    right = rrb.Vertical(
        rrb.TextLogView(origin=f"/{findings}", name="Findings"),
        _plot(HEADINGS, "Headings (°)"),
        _plot(HEADING_SIGMAS, "Standard deviation of the headings (°)"),
        _plot(POSE_SIGMAS, "Standard deviation of the newest joints (°)"),
        _plot(UPDATE_MS, "Update (ms)"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1.45, 1]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _plot(entity: str, title: str) -> rrb.TimeSeriesView:
    now = rrb.TimeRangeBoundary.cursor_relative
    recent = rrb.VisibleTimeRange("time", start=now(seconds=-SHOWN_S), end=now())
    return rrb.TimeSeriesView(
        origin=f"/{entity}", name=title, plot_legend=rrb.PlotLegend(visible=False), time_ranges=[recent]
    )


def _eye(shown: Motion, follow: str) -> rrb.EyeControls3D:
    """From the wearer's front and left, a little from above."""
    forward = shown.state.R_world_bone[0, 0, :, 2] * [1, 1, 0]
    norm = float(np.linalg.norm(forward))
    forward = forward / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    direction = 0.75 * forward + 0.60 * left + np.array([0.0, 0.0, 0.28])
    target = shown.p_world_pelvis[0]
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + EYE_DISTANCE_M * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=follow,
    )
