"""The viewer's layout: a 3D view that follows people, what cameras saw below it, and text and plots beside it."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.scene import Scene
from vip_factors.viz.compare import APART_TITLE, Compare
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.rerun_body import see_through, time_column
from vip_factors.viz.rerun_series import HEADING_SIGMAS, HEADINGS, HEADINGS_IMAGE, LEGEND, POSE_SIGMAS, UPDATE_MS

BACKGROUND: Colour = (222, 226, 231)  # bright, so that bodies stand out in every colour they have
GRID: Colour = (178, 185, 194)
UPRIGHT, LEVEL = 1.1, 2.3  # width by height of the world's view: alone, and above a camera's image
LEGEND_SHARE = 0.85  # of a plot's height
IMAGE_BACKGROUND = (74, 81, 92)  # mid-tone: fine bright lines and coloured ones stand out
IN_IMAGE = ("body", "detected")  # of a camera's image what does not belong into the world
BESIDE = 3  # plots that stand below each other; the others are tabs
SHOWN_S = 30.0  # seconds of a stream's curves before now
ROOM_TO_MOVE_M = 0.2  # to either side of where people stand at the start of a stream
# Rerun's viewer shows as many metres of height as its eye is away, nearly.
HEIGHT_PER_METRE = 1.03
ROOM_M = 0.55  # beside the outermost pelvis: an arm held out
NEAREST_M, WIDEST_M = 2.5, 14.0  # a whole person fits; farther off nobody is seen
EYE_TURN = 0.68  # radians to the left of straight ahead: from there a body has depth
TURNS_DEG = (0.0, -20.0, 20.0, -40.0, 40.0, -60.0, 60.0)  # that are tried, the least first
UP = 0.29  # of the direction to the eye: a little from above, so that the floor shows where people stand


def forward_of(motion: Motion) -> Array:
    """The horizontal direction ``(3,)`` that a body faces in its first frame."""
    forward: Array = motion.state.R_world_bone[0, 0, :, 2] * [1, 1, 0]
    norm = float(np.linalg.norm(forward))
    return forward / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])


def centre_path(motions: Sequence[Motion]) -> tuple[Array, Array]:
    """The point between the wearers over time: seconds ``(T,)`` of the first, metres ``(T, 3)``.

    Its height is the pelvises' mean, always: an eye that bobs with the steps is no pleasure.
    """
    time = motions[0].time
    paths = np.array([[np.interp(time, one.time, one.p_world_pelvis[:, axis]) for axis in range(3)] for one in motions])
    centre: Array = paths.mean(axis=0).T
    centre[:, 2] = centre[:, 2].mean()
    return time, centre


def spread_of(motions: Sequence[Motion]) -> float:
    """Metres from the point between the wearers to the outermost one, most of the time."""
    time, centre = centre_path(motions)
    off = [
        np.hypot(*(np.interp(time, one.time, one.p_world_pelvis[:, axis]) - centre[:, axis] for axis in range(2)))
        for one in motions
    ]
    return float(np.percentile(np.max(off, axis=0), 95))


def abreast(motions: Sequence[Motion], ahead: Array) -> Array:
    """The horizontal direction ``(3,)`` within 60° of ``ahead`` for which people at the start hide each other least."""
    places = np.array([one.p_world_pelvis[0] for one in motions])
    turned = [rotation_z(np.deg2rad(degrees)) @ ahead for degrees in TURNS_DEG]
    across = [float(np.ptp(places @ (rotation_z(EYE_TURN) @ [-one[1], one[0], 0.0]))) for one in turned]
    return turned[int(np.argmax(np.round(across, 2)))]


def eye(target: Array, ahead: Array, spread: float, aspect: float, follow: str | None) -> rrb.EyeControls3D:
    """An eye before people and to their left.

    Args:
        target: ``(3,)`` metres, between them at the start.
        ahead: ``(3,)`` horizontal direction in which the eye lies, from which the eye is turned to see depth.
        spread: metres from there to the outermost of them.
        aspect: width of the view by its height.
        follow: entity that the eye follows, or None.
    """
    distance = (spread + ROOM_M) / (0.5 * HEIGHT_PER_METRE * aspect) + spread
    distance = float(np.clip(distance, NEAREST_M, WIDEST_M))
    direction = rotation_z(EYE_TURN) @ ahead + np.array([0.0, 0.0, UP])
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + distance * direction / np.linalg.norm(direction),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=follow,
    )


CENTRE = "world/centre"
RADIUS_M = 0.001  # something must be drawn for Rerun to follow it


def log_centre(stream: rr.RecordingStream, time: Array, p_world_centre: Array) -> None:
    """Log where it is: seconds ``(T,)``, metres ``(T, 3)``."""
    stream.log(CENTRE, rr.Points3D([[0.0, 0.0, 0.0]], radii=RADIUS_M), static=True)
    columns = rr.Transform3D.columns(translation=p_world_centre.astype(np.float32))
    stream.send_columns(CENTRE, indexes=[time_column(time)], columns=columns)


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
    models: list[CameraModel] = []
    if drawn.detections is not None and drawn.model is not None:
        models = [drawn.model, *(camera.model for camera in drawn.further)]
    controls = _eye(drawn, follow)
    left = _world_and_images(drawn.apart, floor, controls, images, models, [] if drawn.video is not None else bodies)
    return _arranged(
        left,
        _panels(drawn, plots, has_legend),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing", loop_mode="all"),
    )


def _world_and_images(
    apart: bool,
    floor: float,
    controls: rrb.EyeControls3D | None,
    images: Mapping[str, str],
    models: Sequence[CameraModel],
    bodies: Sequence[str],
) -> rrb.View | rrb.Container:
    """The 3D view, above what cameras of these models saw."""
    left_out = [f"{image}/{what}" for image in images.values() for what in IN_IMAGE]
    world = world_view(f"World ({APART_TITLE})" if apart else "World", floor, controls, left_out)
    seen = [image_view(*named, model, bodies) for named, model in zip(images.items(), models, strict=False)]
    if not seen:
        return world
    return rrb.Vertical(world, seen[0] if len(seen) == 1 else rrb.Tabs(*seen, active_tab=0), row_shares=[1.15, 1])


def _arranged(left: rrb.View | rrb.Container, right: rrb.Container, time: rrb.TimePanel) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1.45, 1]),
        time,
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
    """Seconds from the first to the last that is drawn: of bodies, video frames, or single sensors."""
    times = [wearer.shown.time for wearer in drawn.wearers if wearer.shown is not None]
    if drawn.detections is not None and len(drawn.detections.time):
        times.append(drawn.detections.time)
    if drawn.one_alone:
        times += [np.array(one.recording.interval) for one in drawn.wearers if one.recording is not None]
    return min(float(one[0]) for one in times), max(float(one[-1]) for one in times)


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


def legend_view() -> rrb.Spatial2DView:
    """The view of the legend of the sensors' colours, on the dark of the plots that it explains."""
    return rrb.Spatial2DView(origin=f"/{LEGEND}", name="Sensors' colours", background=(16, 17, 19))


def _plot(entity: str, title: str, span: tuple[float, float]) -> rrb.TimeSeriesView:
    many = entity.startswith(("plots/heading", "plots/residual", "plots/imu"))
    legend = rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop) if not many else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=f"/{entity}", name=title, plot_legend=legend, axis_x=span_axis(span))


def _eye(drawn: DrawnScene, follow: str | None) -> rrb.EyeControls3D | None:
    """From the camera's side, so that the picture below shows the same; without it, from the first one's front."""
    shown = [body for one in drawn.wearers if (body := one.shown or one.rest) is not None]
    if drawn.compare is Compare.SIDE:
        shown += [one.truth for one in drawn.wearers if one.motion is not None and one.truth is not None]
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


def live_blueprint(
    setup: Scene,
    shown: list[Motion],
    follow: str,
    bodies: list[str],
    image: str,
    summary: str,
    floor: float,
    apart: bool,
) -> rrb.Blueprint:
    """The layout of a stream.

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
    models = [setup.camera.model] if setup.camera is not None else []
    target = np.mean([one.p_world_pelvis[0] for one in shown], axis=0)
    ahead = abreast(shown, forward_of(shown[0]))
    controls = eye(target, ahead, spread_of(shown) + ROOM_TO_MOVE_M, LEVEL if models else UPRIGHT, follow)
    left = _world_and_images(apart, floor, controls, {"Camera": image}, models, bodies)
    right = rrb.Vertical(
        rrb.TextDocumentView(origin=f"/{summary}", name="Summary"),
        _live_plot(HEADINGS, "Headings (°)"),
        _live_plot(HEADING_SIGMAS, "Standard deviation of the headings (°)"),
        rrb.Tabs(
            _live_plot(POSE_SIGMAS, "Standard deviation of the newest joints (°)"),
            _live_plot(UPDATE_MS, "Update (ms)"),
            active_tab=0,
        ),
        legend_view(),
        row_shares=[2.2, 1.0, 1.0, 1.0, LEGEND_SHARE],
    )  # fmt: skip
    return _arranged(left, right, rrb.TimePanel(state="collapsed", timeline="time", play_state="following"))


def _live_plot(entity: str, title: str) -> rrb.TimeSeriesView:
    now = rrb.TimeRangeBoundary.cursor_relative
    recent = rrb.VisibleTimeRange("time", start=now(seconds=-SHOWN_S), end=now())
    return rrb.TimeSeriesView(
        origin=f"/{entity}", name=title, plot_legend=rrb.PlotLegend(visible=False), time_ranges=[recent]
    )
