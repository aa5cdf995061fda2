"""The Rerun layout: curves, summaries in Markdown, panels and the eye."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.describe.estimates import RESIDUALS, estimate_tables, figure_table
from vip_factors.describe.recordings import detection_rows, recording_facts
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.findings import Finding, verdict
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.tables import Quantity, Row, Table, facts, markdown, plain
from vip_factors.viz.colours import colour_name, sensor_colours, wearer_colour
from vip_factors.viz.drawn_scene import APART, DrawnScene, DrawnWearer
from vip_factors.viz.rerun_body import GLASS_ALPHA, WORLD


def sensor_colours_of(
    wearers: Iterable[Recording | None], estimates: Iterable[WearerEstimate | None] = ()
) -> dict[str, Colour]:
    """One colour for sensors of the same name, whoever wears them."""
    names: dict[str, None] = {}
    for recording in wearers:
        if recording is not None:
            names |= dict.fromkeys([*(site.sensor for site in recording.placement.sites), *recording.imus])
    for estimate in estimates:
        if estimate is not None:
            names |= dict.fromkeys([*estimate.calibration, *estimate.sensors])
    return sensor_colours(list(names))


def log_curves(
    stream: rr.RecordingStream, entity: str, time: Array, values: Array, curves: Mapping[str, Colour]
) -> None:
    """Log curves with the same times: values ``(T, n)``, and the ``n`` names with their colours."""
    log_curve_style(stream, entity, curves)
    log_points(stream, entity, time, values)


def log_curve_style(stream: rr.RecordingStream, entity: str, curves: Mapping[str, Colour]) -> None:
    """Log names and colours of the curves of an entity."""
    style = rr.SeriesLines(colors=list(curves.values()), names=list(curves), widths=[1.5] * len(curves))
    stream.log(entity, style, static=True)


def log_points(stream: rr.RecordingStream, entity: str, time: Array, values: Array) -> None:
    """Log points ``(T, n)`` of curves, all of them or the next ones; curves are interrupted where they are NaN."""
    if np.any(np.isfinite(values)):
        columns = rr.Scalars.columns(scalars=values.reshape(-1)).partition([values.shape[1]] * len(values))
        stream.send_columns(entity, indexes=[rr.TimeColumn("time", duration=time)], columns=columns)


def log_series(stream: rr.RecordingStream, drawn: DrawnScene, colours: Mapping[str, Colour]) -> dict[str, str]:
    """Log all curves that can be drawn below ``/plots``; returns their entities and titles, the main ones first.

    ``colours`` are the sensors'.
    """
    titles: dict[str, str] = {}
    for wearer in drawn.wearers:
        name, curve = rr.escape_entity_path_part(wearer.name), {wearer.name: wearer_colour(wearer.index)}
        for camera, time, pixels in _reprojection_px(drawn, wearer):
            entity, place = "/plots/reprojection_px", f", {camera}" if len(drawn.cameras) > 1 else ""
            path = f"{entity}/{rr.escape_entity_path_part(camera)}/{name}" if place else f"{entity}/{name}"
            log_curves(stream, path, time, pixels[:, None], {wearer.name + place: wearer_colour(wearer.index)})
            titles[entity] = "Reprojection error (px)"
        if wearer.error_mm is not None and wearer.motion is not None:
            entity = "/plots/joint_error_mm"
            log_curves(stream, f"{entity}/{name}", wearer.motion.time, wearer.error_mm[:, None], curve)
            titles[entity] = "Joint error (mm)"
        if drawn.one_alone and (estimate := wearer.estimate) is not None:
            sensors = {sensor: colours[sensor] for sensor in estimate.sensors}
            for kind, values in estimate.residuals.items():
                entity, (title, unit) = f"/plots/residual/{kind}", RESIDUALS.get(kind, (kind, ""))
                log_curves(stream, entity, estimate.motion.time, values, sensors)
                titles[entity] = f"{title.capitalize()} residual ({unit})"
    return titles


HEADING_SIGMAS, POSE_SIGMAS, UPDATE_MS = "/plots/heading_sigma", "/plots/pose_sigma", "/plots/update_ms"


class LiveSeries:
    """Curves of a stream: its updates, and standard deviations of poses and headings."""

    def __init__(self, stream: rr.RecordingStream, setup: Scene, colours: Mapping[str, Colour]) -> None:
        self._stream = stream
        self._parts = [rr.escape_entity_path_part(name) for name in setup.names]
        self._sensors = [[site.sensor for site in wearer.placement.sites] for wearer in setup.wearers]
        log_curve_style(stream, UPDATE_MS, {"update": (120, 170, 240)})
        for index, (entity, sensors) in enumerate(zip(self._parts, self._sensors, strict=True)):
            log_curve_style(stream, f"{POSE_SIGMAS}/{entity}", {setup.names[index]: wearer_colour(index)})
            log_curve_style(stream, f"{HEADING_SIGMAS}/{entity}", {sensor: colours[sensor] for sensor in sensors})

    def log(self, estimates: Sequence[LiveEstimate]) -> None:
        """Log the points of the next frames; of headings, which change slowly, the last ones."""
        time = np.array([estimate.time for estimate in estimates])
        milliseconds = 1e3 * np.array([[estimate.seconds] for estimate in estimates])
        log_points(self._stream, UPDATE_MS, time, milliseconds)
        for index, entity in enumerate(self._parts):
            wearers = [estimate.wearers[index] for estimate in estimates]
            covariances = (wearer.newest.joint_covariance for wearer in wearers)
            variances = [
                [np.nan if covariance is None else np.trace(covariance, axis1=-2, axis2=-1).mean() / 3]
                for covariance in covariances
            ]  # the mean of all joints' axes
            log_points(self._stream, f"{POSE_SIGMAS}/{entity}", time, np.rad2deg(np.sqrt(variances)))
            calibrations = [wearers[-1].calibration.get(sensor) for sensor in self._sensors[index]]
            radians = [[np.nan if calibration is None else calibration.heading_sigma for calibration in calibrations]]
            log_points(self._stream, f"{HEADING_SIGMAS}/{entity}", time[-1:], np.rad2deg(radians))


SUMMARY, CENTRE = "/summary", f"{WORLD}/centre"
EYE_TURN = 0.68  # radians to the left of straight ahead: from there a body has depth


def horizontal(direction: Array) -> Array | None:
    """The horizontal unit vector ``(3,)`` along a direction; None for a vertical one."""
    flat: Array = direction * [1, 1, 0]
    norm = float(np.linalg.norm(flat))
    return flat / norm if norm > 1e-6 else None


def centre_path(motions: Sequence[Motion]) -> tuple[Array, Array]:
    """The point between the wearers over time: seconds ``(T,)`` of the first, metres ``(T, 3)``.

    Its height is the pelvises' mean, always: an eye that bobs with the steps is no pleasure.
    """
    time = motions[0].time
    paths = [[np.interp(time, motion.time, motion.p_world_pelvis[:, axis]) for axis in range(3)] for motion in motions]
    centre: Array = np.mean(paths, axis=0).T
    centre[:, 2] = centre[:, 2].mean()
    return time, centre


def log_centre(stream: rr.RecordingStream, time: Array, p_world_centre: Array) -> None:
    """Log the point that the eye follows: seconds ``(T,)``, metres ``(T, 3)``."""
    stream.log(CENTRE, rr.Points3D([[0.0, 0.0, 0.0]], radii=0.001), static=True)  # Rerun follows what is drawn alone
    columns = rr.Transform3D.columns(translation=p_world_centre.astype(np.float32))
    stream.send_columns(CENTRE, indexes=[rr.TimeColumn("time", duration=time)], columns=columns)


@dataclass(frozen=True)
class Stage:
    """The left half of the layout: people in the world, and the images of cameras below.

    Attributes:
        motions: of the bodies, for placing the eye; their first frames count most.
        floor: height of the grid in metres.
        images: title, entity and model of each camera that saw something.
        bodies: entities of the bodies that are seen through those cameras, where no video shows the people themselves.
        follow: whether the eye follows the point between them.
        ahead: ``(3,)`` horizontal direction in which the eye lies; None: where the first body faces.
        apart: whether the wearers are set apart.
    """

    motions: Sequence[Motion]
    floor: float
    images: Sequence[tuple[str, str, CameraModel]] = ()
    bodies: Sequence[str] = ()
    follow: bool = True
    ahead: Array | None = None
    apart: bool = False

    def blueprint(self, panels: rrb.Container, *, live: bool = False) -> rrb.Blueprint:
        """The layout with text and plots on the right; the time line plays in a loop, or follows a ``live`` stream."""
        return rrb.Blueprint(
            rrb.Horizontal(self._views(), panels, column_shares=[1.45, 1]),
            rrb.TimePanel(
                state="collapsed",
                timeline="time",
                play_state="following" if live else "playing",
                loop_mode="off" if live else "all",
            ),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
        )

    def _views(self) -> rrb.View | rrb.Container:
        images = [image_view(title, entity, model, self.bodies) for title, entity, model in self.images]
        if not images:
            return self._world()
        below = images[0] if len(images) == 1 else rrb.Tabs(*images, active_tab=0)
        return rrb.Vertical(self._world(), below, row_shares=[1.15, 1])

    def _world(self) -> rrb.Spatial3DView:
        """The 3D view: bright, so that bodies stand out in every colour they have, with a grid on the floor."""
        plane = rr.components.Plane3D([0, 0, 1], self.floor)
        hidden = [f"- {image}/{what}" for _, image, _ in self.images for what in ("body", "detected")]
        return rrb.Spatial3DView(
            origin=WORLD,
            name="World (wearers set apart)" if self.apart else "World",
            background=(222, 226, 231),
            contents=["$origin/**", *hidden],
            line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, plane=plane, stroke_width=1.0, color=(178, 185, 194)),
            eye_controls=self._eye(),
        )

    def _eye(self) -> rrb.EyeControls3D | None:
        """An eye before the people and to their left, as far away as all of them need."""
        if not self.motions:
            return None
        ahead = self.ahead
        if ahead is None:
            ahead = horizontal(self.motions[0].state.R_world_bone[0, 0, :, 2])
        if ahead is None:
            ahead = np.array([1.0, 0.0, 0.0])
        room_m = 0.55 if len(self.motions[0]) > 1 else 0.75  # beside the outermost pelvis: an arm held out, a step
        height_per_metre = 1.03  # the viewer shows nearly as many metres of height as its eye is away
        nearest_m, farthest_m = 2.5, 14.0  # a whole person fits; farther off nobody is seen
        time, centre = centre_path(self.motions)
        off = [
            np.hypot(*(np.interp(time, m.time, m.p_world_pelvis[:, axis]) - centre[:, axis] for axis in range(2)))
            for m in self.motions
        ]
        spread = float(np.percentile(np.max(off, axis=0), 95))  # to the outermost one, most of the time
        aspect = 2.3 if self.images else 1.1  # above a camera's image, and alone
        distance = np.clip((spread + room_m) / (0.5 * height_per_metre * aspect) + spread, nearest_m, farthest_m)
        # A little from above, so that the floor shows where people stand.
        direction = rotation_z(EYE_TURN) @ ahead + np.array([0.0, 0.0, 0.29])
        target = centre[0]
        return rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=target + distance * direction / np.linalg.norm(direction),
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=CENTRE if self.follow else None,
        )


def image_view(title: str, image: str, model: CameraModel, bodies: Sequence[str]) -> rrb.Spatial2DView:
    """The view of what a camera of this model saw, and of bodies in the world through it."""
    hidden = [f"- {body}/head/name/**" for body in bodies]
    rim = 0.02 * model.width
    glass = rr.Mesh3D.from_fields(albedo_factor=(255, 255, 255, GLASS_ALPHA))  # nothing hides behind a body
    return rrb.Spatial2DView(
        origin=image,
        name=title,
        background=(74, 81, 92),  # mid-tone: fine bright lines and coloured ones stand out
        contents=["$origin/**", *(f"{body}/**" for body in bodies), *hidden],
        overrides={f"{body}/{bone}": glass for body in bodies for bone in JOINT_NAMES},
        visual_bounds=rrb.VisualBounds2D(x_range=(-rim, model.width + rim), y_range=(-rim, model.height + rim)),
    )


def recorded_panels(plots: Mapping[str, str], span: tuple[float, float]) -> rrb.Vertical:
    """The text above plots of a recording.

    Args:
        plots: titles by entity, the main ones first; three stand below each other, the others are tabs.
        span: first and last second of the recording, whatever else was logged.
    """
    instant = rr.TimeRangeBoundary.absolute
    axis = rrb.TimeAxis(view_range=rr.TimeRange(start=instant(seconds=span[0]), end=instant(seconds=span[1])))
    views: list[rrb.View | rrb.Container] = []
    for entity, title in plots.items():
        has_sensors = entity.startswith("/plots/residual")  # their names would cover the curves
        corner = rrb.PlotLegend(visible=not has_sensors, corner=rrb.Corner2D.RightTop)
        views.append(rrb.TimeSeriesView(origin=entity, name=title, plot_legend=corner, axis_x=axis))
    if len(views) > 3:
        views = [*views[:3], rrb.Tabs(*views[3:])]
    return _panels(views)


def live_panels(plots: Sequence[tuple[str, str]]) -> rrb.Vertical:
    """The text above plots of the last seconds of a stream: entities and titles; the last two are tabs."""
    cursor = rrb.TimeRangeBoundary.cursor_relative
    recent = rrb.VisibleTimeRange("time", start=cursor(seconds=-30.0), end=cursor())
    views = [
        rrb.TimeSeriesView(origin=entity, name=title, plot_legend=rrb.PlotLegend(visible=False), time_ranges=[recent])
        for entity, title in plots
    ]
    return _panels([*views[:-2], rrb.Tabs(*views[-2:], active_tab=0)])


def _panels(plots: Sequence[rrb.View | rrb.Container]) -> rrb.Vertical:
    text = rrb.TextDocumentView(origin=SUMMARY, name="Summary")
    return rrb.Vertical(text, *plots, row_shares=[2.5, *[1.0] * len(plots)])


MOST_SHOWN = 40  # findings of a stream: the list is sent again with each
LIMBS = "left limbs are lighter, right ones darker"


def scene_summary(drawn: DrawnScene) -> str:
    """Markdown for the panel: the estimate's verdict and figures, errors, colours, then all facts."""
    estimate = drawn.estimate
    estimates = [wearer.estimate for wearer in drawn.wearers if wearer.estimate is not None]
    if estimate is None and estimates:
        estimate = Estimate.of_one(estimates[0])
    tables = [] if estimate is None else list(estimate_tables(estimate))
    figures = [] if estimate is None else [figure_table(estimate)]
    details = [recording_facts(wearer.recording) for wearer in drawn.wearers if wearer.recording is not None]
    details += [
        facts(f"camera '{camera.name}'", *detection_rows(camera.detections))
        for camera in drawn.cameras
        if camera.detections is not None
    ]
    lines = [f"# {plain(drawn.name)}", ""]
    for table in (*tables[:1], *figures, _error_table(drawn)):
        lines += markdown(table)
    lines += _colour_lines(drawn)
    for table in (*tables[1:], *details):
        lines += markdown(table)
    return "\n".join(lines)


def _reprojection_px(drawn: DrawnScene, wearer: DrawnWearer) -> Iterator[tuple[str, Array, Array]]:
    """Name of each camera, times ``(F,)`` of its video and reprojection errors ``(F,)`` of an estimate in pixels."""
    for camera in () if drawn.estimate is None else drawn.cameras:
        errors = camera.reprojection_px(wearer)
        if errors is not None and camera.detections is not None:
            yield camera.name, camera.detections.time, errors


def _error_table(drawn: DrawnScene) -> Table:
    """Errors of each wearer against the truth and the picture."""
    rows: list[Row] = []
    for wearer in drawn.wearers:
        error = wearer.error_mm
        pixels = np.concatenate([np.zeros(0), *(errors for _, _, errors in _reprojection_px(drawn, wearer))])
        mean, percentile_95 = (np.nan, np.nan) if error is None else (error.mean(), np.percentile(error, 95))
        median = np.nanmedian(pixels) if len(pixels) else np.nan
        if np.isfinite([mean, median]).any():
            rows.append((wearer.name, *(Quantity(float(value), decimals=1) for value in (mean, percentile_95, median))))
    return Table(("wearer", "joint error, mm", "95 % below", "reprojection, px"), rows)


def _colour_lines(drawn: DrawnScene) -> list[str]:
    """Legend of what is drawn."""
    lines = [f"- **{plain(wearer.name)}** is {colour_name(wearer.index)}; {LIMBS}." for wearer in drawn.wearers]
    if drawn.one_alone:
        lines = ["- **Orange** is the wearer's left, **blue** the right."]
    if any(wearer.motion is not None and wearer.truth is not None for wearer in drawn.wearers):
        placed = "- In colour: the estimate, turned about the vertical once, drawn on the true root path."
        lines += [placed] if drawn.one_alone else []
        lines.append("- See-through and grey: the truth.")
    return _legend(lines, len(drawn.cameras), drawn.apart)


def _legend(lines: Iterable[str], cameras: int, has_separate_worlds: bool) -> list[str]:
    further = ", and those of all cameras but the first" if cameras > 1 else ""
    image = f"- In the picture: bodies are broad lines, detections dots and fine lines; grey are nobody's{further}."
    sensors = "- Small boxes are the sensors, each in the colour of its curves."
    return ["## Colours", "", *lines, *[image] * (cameras > 0), sensors, *[f"- **{APART}**"] * has_separate_worlds, ""]


def live_summary(setup: Scene, findings: Sequence[tuple[float, Finding]], has_separate_worlds: bool) -> str:
    """Markdown for the panel of a stream.

    Args:
        setup: what is streamed.
        findings: with the seconds at which they were made, in their order.
        has_separate_worlds: whether the wearers are set apart.
    """
    lines = [f"# {plain(setup.name)}", ""]
    if findings:
        newest = [(f"{time:.1f} s", str(finding)) for time, finding in reversed(findings[-MOST_SHOWN:])]
        lines += markdown(facts("Findings", ("verdict", str(verdict(finding for _, finding in findings))), *newest))
    colours = [
        f"- **{plain(name)}**, newest: {colour_name(index)}, solid; {LIMBS}." for index, name in enumerate(setup.names)
    ]
    colours.append("- Newest, preliminary (the first seconds, from little data): dark grey, solid.")
    colours.append("- Smoothed, a moment earlier: dark grey, see-through.")
    return "\n".join([*lines, *_legend(colours, len(setup.cameras), has_separate_worlds)])
