"""A stream in Rerun, as it goes: newest and smoothed bodies, the camera, who was seen, and how sure all of it is.

What has come since the last time is logged at once, as a short recording: the more there is, the less a frame costs.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.detections import Detections, keypoints_in_image
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.viz.colours import body_colours
from vip_factors.viz.compare import floor_height, set_apart
from vip_factors.viz.drawn_scene import NOBODY
from vip_factors.viz.rerun_body import (
    GHOST_COLOURS,
    WORLD,
    cut_skin,
    log_camera,
    log_camera_poses,
    log_detections,
    log_image_style,
    log_pinhole,
    log_poses,
    log_projection,
    log_sensors,
    log_skin,
    people_below,
)
from vip_factors.viz.rerun_layout import (
    HEADING_SIGMAS,
    POSE_SIGMAS,
    SUMMARY,
    UPDATE_MS,
    LiveSeries,
    Stage,
    centre_path,
    live_panels,
    log_centre,
    sensor_colours_of,
)
from vip_factors.viz.summaries import live_summary

CAMERA, IMAGE, FINDINGS = f"{WORLD}/camera", f"{WORLD}/camera/image", "/findings"
PLOTS = (
    (HEADING_SIGMAS, "Standard deviation of the headings (°)"),
    (POSE_SIGMAS, "Standard deviation of the newest joints (°)"),
    (UPDATE_MS, "Update (ms)"),
)
CALIBRATION_S = 1.0  # seconds between the sensors' mountings as drawn: they settle slowly

SeenFrame = tuple[VideoFrame, np.ndarray]
"""One video frame with the wearer of each person in it, :data:`NOBODY` for others."""


class LiveBody:
    """One wearer: the newest pose solid in the wearer's colour, the smoothed one, a lag earlier, a dark ghost.

    Attributes:
        newest: entity of the newest pose.
        shift: ``(3,)`` metres by which the wearer is drawn elsewhere.
    """

    def __init__(self, stream: rr.RecordingStream, index: int, wearer: Recording, rate: float) -> None:
        self.shift: Array = np.zeros(3)
        self._stream, self._wearer, self._rate = stream, wearer, rate
        self._skeleton, self._colours = wearer.subject.body(), body_colours(index)
        below = f"{WORLD}/{rr.escape_entity_path_part(wearer.subject.name)}"
        self.newest, self._smoothed = f"{below}/newest", f"{below}/smoothed"
        self._is_preliminary = False
        self._log_skin()

    def _log_skin(self) -> None:
        skin = cut_skin(self._skeleton)
        log_skin(self._stream, self.newest, skin, GHOST_COLOURS if self._is_preliminary else self._colours)
        log_skin(self._stream, self._smoothed, skin, GHOST_COLOURS, ghost=True)

    def motion(self, poses: Sequence[LivePose]) -> Motion:
        """Poses one frame apart, where they are drawn."""
        R = np.array([pose.R_parent_child for pose in poses])
        p = np.array([pose.p_world_pelvis for pose in poses]) + self.shift
        return Motion(self._skeleton, R, p, self._rate, poses[0].time, self._wearer.subject.name)

    def log(self, estimates: Sequence[LiveWearerEstimate], is_preliminary: bool) -> Motion:
        """Log the poses; returns the newest ones. A body of which little is known yet is grey."""
        body = estimates[-1].skeleton or self._skeleton
        if is_preliminary != self._is_preliminary or not np.array_equal(
            body.p_parent_joint, self._skeleton.p_parent_joint
        ):
            self._skeleton, self._is_preliminary = body, is_preliminary
            self._log_skin()
        newest = self.motion([estimate.newest for estimate in estimates])
        log_poses(self._stream, self.newest, newest)
        smoothed = [estimate.smoothed for estimate in estimates if estimate.smoothed is not None]
        if smoothed:
            log_poses(self._stream, self._smoothed, self.motion(smoothed))
        return newest

    def log_sensors(self, estimate: LiveWearerEstimate, colours: Mapping[str, Colour]) -> None:
        """Log the sensors on the bones, as their mountings are believed to be now."""
        log_sensors(self._stream, self.newest, self._wearer.placement, estimate.calibration, colours)


class LiveView:
    """Drawing of a stream.

    Args:
        stream: where to.
        setup: of what is streamed.
        rate: frames per second of the tracker.
    """

    def __init__(self, stream: rr.RecordingStream, setup: Scene, rate: float) -> None:
        self._stream, self._setup = stream, setup
        self._sensor_colours = sensor_colours_of(setup.wearers)
        self._series = LiveSeries(stream, setup, self._sensor_colours)
        self._bodies = [LiveBody(stream, index, wearer, rate) for index, wearer in enumerate(setup.wearers)]
        self._findings: list[tuple[float, Finding]] = []
        self._apart = setup.camera is None and len(setup.wearers) > 1
        self._pending: VideoFrame | None = None  # waits for the answer that says who is who in it
        self._filmed_until = -np.inf  # a sender's video frame may come twice
        self._mounted = -CALIBRATION_S  # when the sensors were drawn
        self._is_laid_out, self._height = False, 0.0
        stream.send_recording_name(setup.name)
        stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if setup.camera is not None:
            log_pinhole(stream, IMAGE, setup.camera.model)
            log_image_style(stream, IMAGE, setup.camera.model, setup.camera.keypoints, setup.names)
        for camera in setup.further_cameras:
            if camera.known_path is not None:
                entity = f"{WORLD}/cameras/{rr.escape_entity_path_part(camera.name)}"
                log_camera(stream, entity, camera.known_path, camera.model)

    def log(self, items: Sequence[LiveEstimate | VideoFrame]) -> None:
        """Log what has come, in its order."""
        estimates = [item for item in items if isinstance(item, LiveEstimate)]
        if self._setup.camera is not None and (seen := self._seen(items, self._setup.camera)):
            labels = np.concatenate([labels for _, labels in seen])
            detections = _detections([frame for frame, _ in seen], self._setup.camera)
            log_detections(self._stream, IMAGE, detections, labels, self._setup.names)
        if not estimates:
            return
        if not self._is_laid_out:
            self._lay_out(estimates[0])
        for run in _runs(estimates):
            motions = [
                body.log([estimate.wearers[index] for estimate in run], run[-1].preliminary)
                for index, body in enumerate(self._bodies)
            ]
            time, centre = centre_path(motions)
            log_centre(self._stream, time, centre * [1, 1, 0] + [0, 0, self._height])
            self._log_camera(run, motions)
        last = estimates[-1]
        if last.time - self._mounted >= CALIBRATION_S and last.wearers[0].calibration:
            for body, wearer in zip(self._bodies, last.wearers, strict=True):
                body.log_sensors(wearer, self._sensor_colours)
            self._mounted = last.time
        self._series.log(estimates)
        self._log_findings(estimates)

    def _seen(self, items: Sequence[LiveEstimate | VideoFrame], camera: Camera) -> list[SeenFrame]:
        """The first camera's video frames, each with what the first answer after it says of the people in it."""
        seen = []
        for item in items:
            if isinstance(item, VideoFrame):
                if item.camera != camera.name or not item.time > self._filmed_until:
                    continue
                self._filmed_until = item.time
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

    def _log_camera(self, estimates: Sequence[LiveEstimate], motions: Sequence[Motion]) -> None:
        """Log the first camera, and the newest bodies as it should see them."""
        poses = [estimate.camera for estimate in estimates if estimate.camera is not None]
        camera = self._setup.camera
        if camera is None or not poses:
            return
        R, p = np.array([pose.R_world_camera for pose in poses]), np.array([pose.p_world_camera for pose in poses])
        path = CameraPath(np.array([pose.time for pose in poses]), R, p)
        log_camera_poses(self._stream, CAMERA, path)
        for motion, entity in zip(motions, people_below(IMAGE, "body", self._setup.names), strict=False):
            pixels = keypoints_in_image(motion, camera.keypoints, path, camera.model, path.time)
            log_projection(self._stream, entity, path.time, pixels, camera.keypoints)

    def _log_findings(self, estimates: Sequence[LiveEstimate]) -> None:
        """Log every finding, and the text that lists them, anew at the moment of each."""
        for estimate in estimates:
            if not estimate.findings:
                continue
            self._stream.set_time("time", duration=estimate.time)
            for finding in estimate.findings:
                self._stream.log(FINDINGS, rr.TextLog(str(finding), level=rr.TextLogLevel.INFO))
                self._findings.append((estimate.time, finding))
            self._log_text()

    def _log_text(self) -> None:
        text = live_summary(self._setup, self._findings, self._apart)
        self._stream.log(SUMMARY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _lay_out(self, estimate: LiveEstimate) -> None:
        """Before the first drawing: where the wearers stand, whence they are looked at, and the text."""
        newest = [[wearer.newest] for wearer in estimate.wearers]
        if self._apart:
            placed = [body.motion(poses) for body, poses in zip(self._bodies, newest, strict=True)]
            for body, shift in zip(self._bodies, set_apart(placed), strict=True):
                body.shift = shift
        motions = [body.motion(poses) for body, poses in zip(self._bodies, newest, strict=True)]
        self._height = float(np.mean([motion.p_world_pelvis[0, 2] for motion in motions]))
        floor = min(floor_height(motion) for motion in motions)
        camera = self._setup.camera
        images = [("Camera", IMAGE, camera.model)] if camera is not None else []
        stage = Stage(motions, floor, images, [body.newest for body in self._bodies], apart=self._apart)
        self._stream.send_blueprint(stage.blueprint(live_panels(PLOTS), live=True))
        self._stream.set_time("time", duration=estimate.time)
        self._log_text()
        self._is_laid_out = True


def _runs(estimates: Sequence[LiveEstimate]) -> list[list[LiveEstimate]]:
    """Frames that follow each other: between them some were dropped."""
    runs: list[list[LiveEstimate]] = []
    for estimate in estimates:
        if runs and estimate.frame == runs[-1][-1].frame + 1:
            runs[-1].append(estimate)
        else:
            runs.append([estimate])
    return runs


def _detections(frames: Sequence[VideoFrame], camera: Camera) -> Detections:
    """What was detected in some video frames that follow each other."""
    K = len(camera.keypoints)
    return Detections(
        camera.keypoints,
        np.array([frame.time for frame in frames]),
        np.repeat(np.arange(len(frames)), [len(frame.pixels) for frame in frames]),
        np.concatenate([np.reshape(frame.pixels, (-1, K, 2)) for frame in frames]).astype(float),
        np.concatenate([np.reshape(frame.confidence, (-1, K)) for frame in frames]).astype(float),
    )
