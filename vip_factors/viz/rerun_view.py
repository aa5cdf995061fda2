"""Recording, estimate and truth in Rerun: everything as columns, so that minutes of motion are logged in seconds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import rerun as rr

from vip_factors.atomic import atomic_path
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Colour, Side
from vip_factors.errors import InputError
from vip_factors.estimate import WearerEstimate
from vip_factors.sensors.recording import Recording
from vip_factors.viz.colours import GHOST_COLOUR, sensor_colours
from vip_factors.viz.compare import (
    Compare,
    check_frames,
    common_frames,
    floor_height,
    known_bones,
    known_truth,
    onto_truth,
    position_error_mm,
)
from vip_factors.viz.rerun_body import (
    log_body,
    log_joint_names,
    log_joints,
    log_joints_style,
    log_rest_body,
    log_sensors,
    log_trail,
)
from vip_factors.viz.rerun_file import complete
from vip_factors.viz.rerun_layout import blueprint
from vip_factors.viz.rerun_series import log_curve, log_legend, log_measurements, log_residuals
from vip_factors.viz.summary import summary
from vip_factors.viz.viewer import check_display, quiet, rerun_command

APPLICATION = "vip_factors"
ERROR_COLOUR = (196, 60, 70)


@dataclass(frozen=True)
class SaveTo:
    """Write a ``.rrd`` file, complete or not at all."""

    path: Path
    overwrite: bool = False


@dataclass(frozen=True)
class LiveViewer:
    """Open Rerun's viewer, in its own process, and send it everything."""


Sink = SaveTo | LiveViewer


def show(
    recording: Recording | None = None,
    estimate: WearerEstimate | None = None,
    truth: Motion | None = None,
    sink: Sink | None = None,
    *,
    compare: Compare = Compare.ROOT,
    metrics: str = "",
) -> None:
    """Show what is given, in Rerun.

    Args:
        recording: for the sensors' places and measurements; its truth is used if ``truth`` is None.
        estimate: drawn in colour.
        truth: drawn as a grey ghost beside an estimate, in colour if there is none.
        sink: a file or a live viewer (the default).
        compare: where to draw an estimate beside the truth.
        metrics: more text for the panel.

    Raises:
        InputError: if there is nothing to show, estimate and truth have no time in common, or the file exists.
        OSError: if the file cannot be written.
    """
    if truth is None and recording is not None and recording.truth is not None:
        truth = recording.truth.motion
    truth = known_truth(truth)
    if estimate is not None:
        check_frames(estimate.motion)
    send(_Scene(recording, estimate, truth, compare, metrics), sink or LiveViewer())


class View(Protocol):
    """Something that can be sent to Rerun."""

    def log(self, stream: rr.RecordingStream) -> None:
        """Log everything and the layout."""


def send(view: View, sink: Sink) -> None:
    """Write a view to a file, complete or not at all, or open the viewer and send it there.

    Raises:
        InputError: if the file exists, or there is no display for the viewer.
        OSError: if the file cannot be written.
    """
    if isinstance(sink, SaveTo):
        with atomic_path(sink.path, sink.overwrite) as partial:
            stream = rr.RecordingStream(APPLICATION)
            stream.save(partial)
            view.log(stream)
            complete(stream, partial, sink.path)
        return
    check_display("a file (SaveTo) instead of the live viewer")
    stream = rr.RecordingStream(APPLICATION)
    with quiet():
        rr.spawn(executable_path=rerun_command(), recording=stream)
    view.log(stream)
    stream.flush()


@dataclass(frozen=True)
class _Scene:
    recording: Recording | None
    estimate: WearerEstimate | None
    truth: Motion | None
    compare: Compare
    metrics: str

    def log(self, stream: rr.RecordingStream) -> None:
        """Log everything and the layout."""
        recording, estimate = self.recording, self.estimate
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        shown, ghost, error = self._bodies()
        floor = floor_height(ghost if ghost is not None else shown)
        body = "world/estimate" if estimate is not None else "world/truth" if self.truth is not None else "world/body"
        moving = body != "world/body"
        log_joint_names(stream, "world", [shown.name])
        if moving:
            log_joints_style(stream, f"{body}/joints", 0)
            log_joints(stream, f"{body}/joints", shown)
            log_body(stream, body, shown, ESTIMATE_COLOURS)
            log_trail(stream, "world/path", shown, floor, ESTIMATE_COLOURS[Side.MIDDLE])
        else:
            log_rest_body(stream, body, shown, ESTIMATE_COLOURS)
        aside = ghost is not None and self.compare is Compare.SIDE
        if ghost is not None:
            log_body(stream, "world/truth", ghost, dict.fromkeys(Side, GHOST_COLOUR), ghost=not aside)
            log_trail(stream, "world/true_path", ghost, floor, GHOST_COLOUR)
        if error is not None:
            log_curve(stream, "plots/error/joint_error_mm", shown.time, error, ERROR_COLOUR, "joint error")
        colours = self._sensor_colours()
        residuals, measured = self._plots(stream, body, colours)
        text = summary(recording, estimate, error, self.compare, self.metrics)
        stream.log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_recording_name(estimate.name if estimate is not None else shown.name)
        follow = f"{body}/pelvis" if moving else None
        apart = 2 if aside else 1
        legend = log_legend(stream, colours)
        span = self._span(shown)
        stream.send_blueprint(
            blueprint(shown, follow, floor, apart, error is not None, residuals, measured, span, legend)
        )

    def _bodies(self) -> tuple[Motion, Motion | None, np.ndarray | None]:
        """The body in colour, the ghost, and the error between them."""
        if self.estimate is not None and self.truth is not None:
            estimated, true = common_frames(self.estimate.motion, self.truth)
            error = position_error_mm(estimated, true, known_bones(self.recording, self.truth))
            return onto_truth(estimated, true, self.compare), true, error
        if self.estimate is not None:
            return self.estimate.motion, None, None
        if self.truth is not None:
            return self.truth, None, None
        if self.recording is None:
            raise InputError("nothing to show: expected a recording, an estimate or a motion")
        return _resting(self.recording), None, None

    def _sensor_colours(self) -> dict[str, Colour]:
        recording, estimate = self.recording, self.estimate
        names = [
            *(recording.imus if recording is not None else ()),
            *(estimate.sensors if estimate is not None else ()),
        ]
        return sensor_colours(list(dict.fromkeys(names)))

    def _span(self, shown: Motion) -> tuple[float, float]:
        """Seconds from the first to the last that is drawn."""
        drawn = [float(shown.time[0]), float(shown.time[-1])] if len(shown) > 1 or self.recording is None else []
        measured = self.recording.interval if self.recording is not None else ()
        return min(*drawn, *measured), max(*drawn, *measured)

    def _plots(self, stream: rr.RecordingStream, body: str, colours: dict[str, Colour]) -> tuple[list[str], list[str]]:
        recording, estimate = self.recording, self.estimate
        residuals = log_residuals(stream, estimate, colours) if estimate is not None else []
        if recording is None:
            return residuals, []
        known = recording.truth.calibration if recording.truth is not None else None
        calibration = estimate.calibration if estimate is not None else known
        log_sensors(stream, body, recording.placement, calibration, colours)
        return residuals, log_measurements(stream, recording, colours)


def _resting(recording: Recording) -> Motion:
    """The wearer standing in the T-pose on the floor, facing x: all that a bare recording says about the body."""
    skeleton = recording.subject.body()
    R_world_pelvis = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # body y up, z forward
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    R[0, 0] = R_world_pelvis
    height = -float(skeleton.p_pelvis_joint[:, 1].min()) + 0.02
    return Motion(skeleton, R, np.array([[0.0, 0.0, height]]), 1.0, name=recording.name)
