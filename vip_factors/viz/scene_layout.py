"""The blueprint of a scene: the world above the camera's image, text and plots beside them."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun.blueprint as rrb

from vip_factors.sensors.camera_model import CameraModel
from vip_factors.viz.compare import APART_TITLE
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.rerun_body import see_through
from vip_factors.viz.rerun_eye import abreast, centre_path, eye, forward_of, spread_of
from vip_factors.viz.rerun_layout import LEGEND_SHARE, LEVEL, UPRIGHT, legend_view, span_axis, world_view
from vip_factors.viz.rerun_scene_series import HEADINGS_IMAGE

IMAGE_BACKGROUND = (74, 81, 92)  # mid-tone: fine bright lines and coloured ones stand out
IN_IMAGE = ("body", "detected")  # of a camera's image what does not belong into the world
BESIDE = 3  # plots that stand below each other; the others are tabs


def scene_blueprint(
    drawn: DrawnScene,
    images: Mapping[str, str],
    floor: float,
    plots: Mapping[str, str],
    follow: str | None,
    has_legend: bool,
    bodies: Sequence[str] = (),
) -> rrb.Blueprint:
    """The layout of the viewer.

    Args:
        drawn: what is shown, for placing the eye.
        images: entities of the cameras' images by title, the first camera's first.
        floor: height of the grid in metres.
        plots: titles by entity, the main ones first.
        follow: entity that the eye follows, or None.
        has_legend: whether the legend of the sensors was logged.
        bodies: entities of the bodies as drawn, for cameras without a video.
    """
    left_out = [f"{image}/{what}" for image in images.values() for what in IN_IMAGE]
    title = f"World ({APART_TITLE})" if drawn.apart else "World"
    left: rrb.View | rrb.Container = world_view(title, floor, _eye(drawn, follow), left_out)
    if drawn.detections is not None and drawn.model is not None:
        models = [drawn.model, *(camera.model for camera in drawn.further)]
        solid = [] if drawn.video is not None else bodies
        views2d = [image_view(*named, model, solid) for named, model in zip(images.items(), models, strict=True)]
        below = views2d[0] if len(views2d) == 1 else rrb.Tabs(*views2d, active_tab=0)
        left = rrb.Vertical(left, below, row_shares=[1.15, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, _panels(drawn, plots, has_legend), column_shares=[1.45, 1]),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _panels(drawn: DrawnScene, plots: Mapping[str, str], has_legend: bool) -> rrb.Vertical:
    """The text, with the headings behind it, above the plots and the legend of the sensors."""
    span = span_of(drawn)
    views: list[rrb.View | rrb.Container] = [_plot(entity, title, span) for entity, title in plots.items()]
    if len(views) > BESIDE:
        views = [*views[:BESIDE], rrb.Tabs(*views[BESIDE:])]
    tabs: list[rrb.View] = [rrb.TextDocumentView(origin="/summary", name="Summary")]
    if any(wearer.estimate is not None for wearer in drawn.wearers):
        tabs.append(rrb.Spatial2DView(origin=f"/{HEADINGS_IMAGE}", name="Headings", background=(255, 255, 255)))
    shares = [2.8, *[1.0] * len(views)]
    if has_legend:
        views, shares = [*views, legend_view()], [*shares, LEGEND_SHARE]
    return rrb.Vertical(rrb.Tabs(*tabs, active_tab=0), *views, row_shares=shares)


def span_of(drawn: DrawnScene) -> tuple[float, float]:
    """Seconds from the first to the last that is drawn: of bodies, or of video frames without any."""
    times = [wearer.shown.time for wearer in drawn.wearers if wearer.shown is not None]
    if drawn.detections is not None and len(drawn.detections.time):
        times.append(drawn.detections.time)
    return min(float(one[0]) for one in times), max(float(one[-1]) for one in times)


def image_view(title: str, entity: str, model: CameraModel, bodies: Sequence[str]) -> rrb.Spatial2DView:
    """What a camera saw.

    Args:
        title: of the view.
        entity: of the camera's image.
        model: for the image's size.
        bodies: entities in the world to be seen through the camera, where no video shows the people themselves.
    """
    hidden = [f"- /{body}/{what}" for body in bodies for what in ("joints/**", "head/name/**")]
    looks = [see_through(body) for body in bodies]
    rim = 0.02 * model.width
    return rrb.Spatial2DView(
        origin=f"/{entity}",
        name=title,
        background=IMAGE_BACKGROUND,
        contents=["$origin/**", *(f"/{body}/**" for body in bodies), *hidden],
        overrides={f"/{one}": look for body in looks for one, look in body.items()},
        visual_bounds=rrb.VisualBounds2D(x_range=(-rim, model.width + rim), y_range=(-rim, model.height + rim)),
    )


def _plot(entity: str, title: str, span: tuple[float, float]) -> rrb.TimeSeriesView:
    many = entity.startswith("plots/heading")
    legend = rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop) if not many else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=f"/{entity}", name=title, plot_legend=legend, axis_x=span_axis(span))


def _eye(drawn: DrawnScene, follow: str | None) -> rrb.EyeControls3D | None:
    """From the camera's side, so that the picture below shows the same; without it, from the first one's front."""
    shown = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    if not shown:
        return None
    target = centre_path(shown)[1][0]
    ahead = forward_of(shown[0])
    if drawn.path is not None:
        towards = (drawn.path.p_world_camera[0] - target) * [1, 1, 0]
        norm = float(np.linalg.norm(towards))
        ahead = towards / norm if norm > 1e-6 else ahead
    ahead = abreast(shown, ahead)
    return eye(target, ahead, spread_of(shown), LEVEL if drawn.detections is not None else UPRIGHT, follow)
