"""The viewer's layout for a stream: the world above the camera's image, findings and curves beside them."""

import numpy as np
import rerun.blueprint as rrb

from vip_factors.body.kinematics import Motion
from vip_factors.sensors.live import LiveSetup
from vip_factors.viz.compare import APART_TITLE
from vip_factors.viz.live_series import HEADING_SIGMAS, HEADINGS, POSE_SIGMAS, UPDATE_MS
from vip_factors.viz.rerun_eye import abreast, eye, forward_of, spread_of
from vip_factors.viz.rerun_layout import LEGEND_SHARE, LEVEL, UPRIGHT, legend_view, world_view
from vip_factors.viz.scene_layout import IN_IMAGE, image_view

SHOWN_S = 30.0  # seconds of the curves before now
ROOM_M = 0.2  # to either side of where people stand at the start: they will move


def live_blueprint(
    setup: LiveSetup,
    shown: list[Motion],
    follow: str,
    bodies: list[str],
    image: str,
    summary: str,
    floor: float,
    apart: bool,
) -> rrb.Blueprint:
    """The layout.

    Args:
        setup: of what is streamed.
        shown: the wearers' first poses, for placing the eye.
        follow: entity that the eye follows.
        bodies: entities of the newest bodies.
        image: entity of the first camera's image.
        summary: entity of the text: findings, and what is drawn how.
        floor: height of the grid in metres.
        apart: whether the wearers are set apart.
    """
    filmed = setup.camera is not None
    target = np.mean([one.p_world_pelvis[0] for one in shown], axis=0)
    ahead = abreast(shown, forward_of(shown[0]))
    controls = eye(target, ahead, spread_of(shown) + ROOM_M, LEVEL if filmed else UPRIGHT, follow)
    left_out = [f"{image}/{what}" for what in IN_IMAGE]
    left: rrb.View | rrb.Container = world_view(
        f"World ({APART_TITLE})" if apart else "World", floor, controls, left_out
    )
    if setup.camera is not None:
        camera = image_view("Camera", image, setup.camera.model, bodies)
        left = rrb.Vertical(left, camera, row_shares=[1.15, 1])
    right = rrb.Vertical(
        rrb.TextDocumentView(origin=f"/{summary}", name="Summary"),
        _plot(HEADINGS, "Headings (°)"),
        _plot(HEADING_SIGMAS, "Standard deviation of the headings (°)"),
        rrb.Tabs(
            _plot(POSE_SIGMAS, "Standard deviation of the newest joints (°)"), _plot(UPDATE_MS, "Update (ms)"),
            active_tab=0,
        ),
        legend_view(),
        row_shares=[2.2, 1.0, 1.0, 1.0, LEGEND_SHARE],
    )  # fmt: skip
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
