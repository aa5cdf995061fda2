"""The blueprint of a scene: the world above the camera's image, text and plots beside them."""

from collections.abc import Mapping

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.viz.layout import BACKGROUND, GRID
from vip_factors.viz.rerun_scene_series import HEADINGS_IMAGE
from vip_factors.viz.scene_world import DrawnScene

IMAGE_BACKGROUND = (22, 24, 28)
IN_IMAGE = ("body", "detected")  # of a camera's image what does not belong into the world
BESIDE = 3  # plots that stand below each other; the others are tabs
WIDEST_M = 14.0  # an eye farther off sees nobody


def scene_blueprint(
    drawn: DrawnScene, images: Mapping[str, str], floor: float, plots: Mapping[str, str]
) -> rrb.Blueprint:
    """The layout of the viewer.

    Args:
        drawn: what is shown, for placing the eye.
        images: entities of the cameras' images by title, the first camera's first.
        floor: height of the grid in metres.
        plots: titles by entity, the main ones first.
    """
    world = rrb.Spatial3DView(
        origin="/world",
        name="World",
        background=BACKGROUND,
        contents=["$origin/**", *(f"- /{image}/{what}/**" for image in images.values() for what in IN_IMAGE)],
        line_grid=rrb.LineGrid3D(
            visible=True, spacing=0.5, plane=rr.components.Plane3D([0, 0, 1], floor), stroke_width=1.0, color=GRID
        ),
        eye_controls=_eye(drawn),
    )
    left: rrb.View | rrb.Container = world
    if drawn.detections is not None and drawn.model is not None:
        models = [drawn.model, *(camera.model for camera in drawn.further)]
        views2d = [_image(*named, model) for named, model in zip(images.items(), models, strict=True)]
        below = views2d[0] if len(views2d) == 1 else rrb.Tabs(*views2d, active_tab=0)
        left = rrb.Vertical(world, below, row_shares=[1, 1])
    views = [_plot(entity, title) for entity, title in plots.items()]
    text = rrb.TextDocumentView(origin="/summary", name="Summary")
    headings = rrb.Spatial2DView(origin=f"/{HEADINGS_IMAGE}", name="Headings", background=(255, 255, 255))
    estimated = any(wearer.estimate is not None for wearer in drawn.wearers)
    odd = drawn.estimate is not None and len(drawn.estimate.findings) > 0  # then the text comes first
    top = rrb.Tabs(*([headings, text] if estimated else [text]), active_tab=1 if estimated and odd else 0)
    more = [rrb.Tabs(*views[BESIDE:])] if len(views) > BESIDE else []
    right = rrb.Vertical(top, *views[:BESIDE], *more, row_shares=[2.2, *[1.0] * (len(views[:BESIDE]) + len(more))])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1.45, 1]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _image(title: str, entity: str, model: CameraModel) -> rrb.Spatial2DView:
    rim = 0.02 * model.width
    bounds = rrb.VisualBounds2D(x_range=(-rim, model.width + rim), y_range=(-rim, model.height + rim))
    return rrb.Spatial2DView(origin=f"/{entity}", name=title, background=IMAGE_BACKGROUND, visual_bounds=bounds)


def _plot(entity: str, title: str) -> rrb.TimeSeriesView:
    many = entity.startswith("plots/heading")
    legend = rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop) if not many else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=f"/{entity}", name=title, plot_legend=legend)


def _eye(drawn: DrawnScene) -> rrb.EyeControls3D | None:
    """From beside the line between camera and wearers, a little from above, so that both are in view."""
    paths = [wearer.shown.p_world_pelvis for wearer in drawn.wearers if wearer.shown is not None]
    if not paths:
        return None
    people = np.concatenate(paths)
    centre = people.mean(axis=0)
    ahead = np.array([1.0, 0.0, 0.0])
    points = people
    if drawn.path is not None:
        points = np.concatenate([people, drawn.path.p_world_camera])
        ahead = (centre - drawn.path.p_world_camera.mean(axis=0)) * [1, 1, 0]
        norm = float(np.linalg.norm(ahead))
        ahead = ahead / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    target: Array = (points.min(axis=0) + points.max(axis=0)) / 2
    target[2] = float(people[:, 2].mean())
    size = float(np.linalg.norm(np.ptp(points[:, :2], axis=0))) / 2 + 0.8
    across = np.array([ahead[1], -ahead[0], 0.0])
    direction = 0.85 * across - 0.55 * ahead + np.array([0.0, 0.0, 0.42])
    # Without an image below it, the view is upright and takes in less to the sides.
    distance = min((0.9 if drawn.detections is not None else 1.5) * size + 1.1, WIDEST_M)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )
