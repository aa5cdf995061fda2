"""A stream in Rerun, as it goes: newest and smoothed bodies, the camera, who was seen, and how sure all of it is.

Everything that has come since the last time is logged at once: the more there is, the less each frame costs.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour, Side
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import keypoints_in_image
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.viz.colours import GHOST_COLOUR, body_colours
from vip_factors.viz.compare import floor_height, moved, set_apart
from vip_factors.viz.drawn_scene import NOBODY
from vip_factors.viz.rerun_body import log_joint_names, log_joints, log_joints_style, log_poses, log_sensors, log_shape
from vip_factors.viz.rerun_camera import (
    NOBODYS,
    body_in,
    detected_in,
    log_camera,
    log_camera_poses,
    log_frustum,
    log_image_style,
    log_people,
)
from vip_factors.viz.rerun_layout import CENTRE, centre_path, live_blueprint, log_centre
from vip_factors.viz.rerun_series import LiveSeries, colours_of, log_legend
from vip_factors.viz.summaries import live_summary

CAMERA, IMAGE = "world/camera", "world/camera/image"
FINDINGS, SUMMARY = "findings", "summary"
CALIBRATION_S = 1.0  # seconds between the sensors' mountings as drawn: they settle slowly


SeenFrame = tuple[VideoFrame, np.ndarray]
"""One video frame with the wearer of each person in it, :data:`NOBODY` for others."""


class LiveBody:
    """One wearer: the newest pose solid in the wearer's colour, the smoothed one, a lag earlier, a dark ghost.

    Attributes:
        shift: ``(3,)`` metres by which the wearer is drawn elsewhere.
    """

    def __init__(
        self, stream: rr.RecordingStream, index: int, wearer: Recording, rate: float, sensors: dict[str, Colour]
    ) -> None:
        self.shift: Array = np.zeros(3)
        self._sensors = sensors
        self._stream, self._wearer, self._rate = stream, wearer, rate
        self._skeleton, self._colours = wearer.subject.body(), body_colours(index)
        below = f"world/{rr.escape_entity_path_part(wearer.subject.name)}"
        self.newest, self._smoothed = f"{below}/newest", f"{below}/smoothed"
        self._is_preliminary = False
        self._log_shape()
        log_joints_style(stream, f"{self.newest}/joints", index)

    def _log_shape(self) -> None:
        ghost = dict.fromkeys(Side, GHOST_COLOUR)
        colours = ghost if self._is_preliminary else self._colours
        log_shape(self._stream, self.newest, self._skeleton, colours)
        log_shape(self._stream, self._smoothed, self._skeleton, ghost, ghost=True)

    def motion(self, poses: Sequence[LivePose]) -> Motion:
        """Poses one frame apart."""
        R = np.array([one.R_parent_child for one in poses])
        p = np.array([one.p_world_pelvis for one in poses])
        return Motion(self._skeleton, R, p, self._rate, poses[0].time, self._wearer.subject.name)

    def log(self, estimates: list[LiveWearerEstimate], is_preliminary: bool) -> Motion:
        """Log the poses; returns the newest ones. A body of which little is known yet is grey."""
        body = estimates[-1].skeleton or self._skeleton
        if is_preliminary != self._is_preliminary or not np.array_equal(
            body.p_parent_joint, self._skeleton.p_parent_joint
        ):
            self._skeleton, self._is_preliminary = body, is_preliminary
            self._log_shape()
        newest = self.motion([one.newest for one in estimates])
        log_poses(self._stream, self.newest, moved(newest, self.shift))
        log_joints(self._stream, f"{self.newest}/joints", moved(newest, self.shift))
        smoothed = [one.smoothed for one in estimates if one.smoothed is not None]
        if smoothed:
            log_poses(self._stream, self._smoothed, moved(self.motion(smoothed), self.shift))
        return newest

    def log_sensors(self, answer: LiveWearerEstimate) -> None:
        """The sensors on the bones, as their mountings are believed to be now."""
        log_sensors(self._stream, self.newest, self._wearer.placement, answer.calibration, self._sensors)


class LiveView:
    """Draws a stream.

    Args:
        stream: where to.
        setup: of what is streamed.
        rate: frames per second of the tracker.
    """

    def __init__(self, stream: rr.RecordingStream, setup: Scene, rate: float) -> None:
        self._stream, self._setup, self._rate = stream, setup, rate
        self._series = LiveSeries(stream, setup)
        colours = colours_of(setup.wearers)
        self._bodies = [LiveBody(stream, index, one, rate, colours) for index, one in enumerate(setup.wearers)]
        self._findings: list[tuple[float, Finding]] = []
        self._apart = setup.camera is None and len(setup.wearers) > 1
        self._pending: VideoFrame | None = None  # waits for the answer that says who is who in it
        self._mounted = -CALIBRATION_S  # when the sensors were drawn
        self._laid_out, self._height = False, 0.0
        stream.send_recording_name(setup.name)
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_joint_names(stream, "world", setup.names)
        log_legend(stream, colours)
        for camera in setup.cameras:
            self._log_camera_shape(camera)

    def log(self, items: Sequence[LiveEstimate | VideoFrame]) -> None:
        """Log what has come, in its order."""
        estimates = [item for item in items if isinstance(item, LiveEstimate)]
        self._log_seen(self._seen(items))
        if not estimates:
            return
        last = estimates[-1]
        if not self._laid_out:
            self._lay_out(estimates[0])
        for run in _runs(estimates):
            motions = [
                body.log([one.wearers[index] for one in run], run[-1].preliminary)
                for index, body in enumerate(self._bodies)
            ]
            for index, motion in enumerate(motions):
                self._log_projected(index, motion, run)
            self._log_centre(motions)
        if last.time - self._mounted >= CALIBRATION_S and last.wearers[0].calibration:
            for body, wearer in zip(self._bodies, last.wearers, strict=True):
                body.log_sensors(wearer)
            self._mounted = last.time
        path = _path(estimates)
        if path is not None:
            log_camera_poses(self._stream, CAMERA, path)
        self._series.log(estimates)
        self._log_findings(estimates)

    def _log_camera_shape(self, camera: Camera) -> None:
        first = camera is self._setup.camera
        entity = CAMERA if first else f"world/{rr.escape_entity_path_part(camera.name)}"
        if first:
            log_frustum(self._stream, entity, camera.model)
            log_image_style(self._stream, IMAGE, camera.model, camera.keypoints, self._setup.names)
        elif camera.known_path is not None:
            log_camera(self._stream, entity, camera.known_path, camera.model)

    def _seen(self, items: Sequence[LiveEstimate | VideoFrame]) -> list[SeenFrame]:
        """The first camera's video frames, each with what the first answer after it says of the people in it."""
        seen = []
        for item in items:
            if isinstance(item, VideoFrame):
                if self._setup.camera is None or item.camera != self._setup.camera.name:
                    continue
                if self._pending is not None:
                    seen.append((self._pending, np.full(len(self._pending.pixels), NOBODY)))
                self._pending = item
            elif self._pending is not None:
                labels = np.full(len(self._pending.pixels), NOBODY)
                for index, wearer in enumerate(item.wearers):
                    if wearer.detection is not None and wearer.detection < len(labels):
                        labels[wearer.detection] = index
                seen.append((self._pending, labels))
                self._pending = None
        return seen

    def _log_seen(self, seen: list[SeenFrame]) -> None:
        camera = self._setup.camera
        if not seen or camera is None:
            return
        time = np.array([frame.time for frame, _ in seen])
        for index, name in enumerate([*self._setup.names, NOBODYS]):
            mine = index < len(self._setup.wearers)
            people, frames = _people(seen, index if mine else NOBODY, camera.keypoints)
            log_people(
                self._stream, detected_in(IMAGE, name), time, frames, people, camera.keypoints, lines=not mine
            )  # fmt: skip

    def _log_projected(self, index: int, motion: Motion, estimates: list[LiveEstimate]) -> None:
        """The newest bodies as the camera should see them."""
        camera, path = self._setup.camera, _path(estimates)
        if camera is None or path is None:
            return
        pixels = keypoints_in_image(motion, camera.keypoints, path, camera.model, path.time)
        entity = body_in(IMAGE, self._setup.names[index])
        frames = np.arange(len(path))
        log_people(self._stream, entity, path.time, frames, pixels, camera.keypoints, dots=False)

    def _log_centre(self, motions: Sequence[Motion]) -> None:
        """The point between the wearers, which the eye follows; its height is that at the start."""
        time, centre = centre_path([moved(one, body.shift) for one, body in zip(motions, self._bodies, strict=True)])
        log_centre(self._stream, time, centre * [1, 1, 0] + [0, 0, self._height])

    def _log_findings(self, estimates: list[LiveEstimate]) -> None:
        """Every finding in the log, and in the text, which is logged anew at the moment of each."""
        for one in estimates:
            if not one.findings:
                continue
            self._stream.set_time("time", duration=one.time)
            for finding in one.findings:
                self._stream.log(FINDINGS, rr.TextLog(str(finding), level=rr.TextLogLevel.INFO))
                self._findings.append((one.time, finding))
            self._log_text()

    def _log_text(self) -> None:
        text = live_summary(self._setup, self._findings, self._apart)
        self._stream.log(SUMMARY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _lay_out(self, estimate: LiveEstimate) -> None:
        """Before the first drawing: where the wearers stand, whence they are looked at, and the text."""
        first = [body.motion([one.newest]) for body, one in zip(self._bodies, estimate.wearers, strict=True)]
        if self._apart:
            for body, shift in zip(self._bodies, set_apart(first), strict=True):
                body.shift = shift
            first = [moved(one, body.shift) for one, body in zip(first, self._bodies, strict=True)]
        floor = min(floor_height(one) for one in first)
        self._height = float(np.mean([one.p_world_pelvis[0, 2] for one in first]))
        blueprint = live_blueprint(
            self._setup, first, CENTRE, [one.newest for one in self._bodies], IMAGE, SUMMARY, floor, self._apart
        )
        self._stream.send_blueprint(blueprint)
        self._stream.set_time("time", duration=estimate.time)
        self._log_text()
        self._laid_out = True


def _runs(estimates: list[LiveEstimate]) -> list[list[LiveEstimate]]:
    """Frames that follow each other: between them some were dropped."""
    runs: list[list[LiveEstimate]] = []
    for one in estimates:
        if runs and one.frame == runs[-1][-1].frame + 1:
            runs[-1].append(one)
        else:
            runs.append([one])
    return runs


def _path(estimates: Sequence[LiveEstimate]) -> CameraPath | None:
    poses = [one.camera for one in estimates if one.camera is not None]
    if not poses:
        return None
    R, p = np.array([one.R_world_camera for one in poses]), np.array([one.p_world_camera for one in poses])
    return CameraPath(np.array([one.time for one in poses]), R, p)


def _people(seen: list[SeenFrame], index: int, keypoints: KeypointSet) -> tuple[Array, np.ndarray]:
    """Pixels ``(n, K, 2)`` of a wearer's detections, NaN where a keypoint was not found, and their frames ``(n,)``."""
    chosen = [np.flatnonzero(labels == index) for _, labels in seen]
    frames = np.repeat(np.arange(len(seen)), [len(one) for one in chosen])
    found = [
        np.where((frame.confidence[rows] > 0)[..., None], frame.pixels[rows], np.nan)
        for (frame, _), rows in zip(seen, chosen, strict=True)
    ]
    shape = (-1, len(keypoints), 2)
    return np.concatenate([np.asarray(one, float).reshape(shape) for one in found]), frames
