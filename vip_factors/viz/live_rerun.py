"""A stream in Rerun: bodies, camera, who was seen, and how sure all of it is, drawn by a thread beside the tracker.

The tracker never waits: what cannot be drawn is dropped. What has come since the last time is logged at once, as a
short recording: the more there is, the less a frame costs. Rerun itself waits for a viewer that hangs, in the end too;
it does so without Python's lock.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread

import numpy as np
import rerun as rr

from vip_factors.atomic import check_partial, partial_file, partial_path
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.estimate import CameraEstimate, Estimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveEstimate, estimate_of
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.detections import keypoints_in_image
from vip_factors.sensors.live import VideoFrame, detections_of
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.viz.colours import body_colours
from vip_factors.viz.drawn_scene import NOBODY, floor_height, set_apart
from vip_factors.viz.rerun_body import (
    GHOST_COLOURS,
    WORLD,
    BodyLog,
    log_camera,
    log_camera_poses,
    log_detections,
    log_image_style,
    log_pinhole,
    log_projection,
    log_sensors,
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
    live_summary,
    log_centre,
    sensor_colours_of,
)
from vip_factors.viz.viewer import APPLICATION, complete, open_viewer, write_out

CAMERA, IMAGE = f"{WORLD}/camera", f"{WORLD}/camera/image"
PLOTS = (
    (HEADING_SIGMAS, "Standard deviation of the headings (°)"),
    (POSE_SIGMAS, "Standard deviation of the newest joints (°)"),
    (UPDATE_MS, "Update (ms)"),
)
CALIBRATION_S = 1.0  # seconds between the sensors' mountings as drawn: they settle slowly

SeenFrame = tuple[VideoFrame, np.ndarray]
"""One video frame with the wearer of each person in it, :data:`NOBODY` for others."""


class LiveView:
    """Drawing of a stream.

    Args:
        stream: where to.
        setup: of what is streamed.
        rate: frames per second of the tracker.
    """

    def __init__(self, stream: rr.RecordingStream, setup: Scene, rate: float) -> None:
        self._stream, self._setup, self._rate = stream, setup, rate
        self._sensor_colours = sensor_colours_of(setup.wearers)
        self._series = LiveSeries(stream, setup, self._sensor_colours)
        entities = [f"{WORLD}/{rr.escape_entity_path_part(name)}" for name in setup.names]
        self._newest = [BodyLog(stream, f"{entity}/newest") for entity in entities]
        self._smoothed = [BodyLog(stream, f"{entity}/smoothed", ghost=True) for entity in entities]
        self._shifts: list[Array] = [np.zeros(3)] * len(entities)  # metres by which wearers are drawn elsewhere
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
        self._cameras = {
            camera.name: CAMERA if number == 0 else f"{WORLD}/cameras/{rr.escape_entity_path_part(camera.name)}"
            for number, camera in enumerate(setup.cameras)
        }
        self._lenses = dict[str, CameraModel]()  # as drawn
        for camera in setup.cameras[1:]:
            if camera.known_path is not None:
                log_camera(stream, self._cameras[camera.name], camera.known_path, camera.model)

    def log(self, messages: Sequence[LiveEstimate | VideoFrame]) -> None:
        """Log what has come, in its order."""
        estimates = [message for message in messages if isinstance(message, LiveEstimate)]
        if self._setup.camera is not None and (seen_frames := self._seen(messages, self._setup.camera)):
            labels = np.concatenate([labels for _, labels in seen_frames])
            detections = detections_of([frame for frame, _ in seen_frames], self._setup.camera.keypoints)
            log_detections(self._stream, IMAGE, detections, labels, self._setup.names)
        if not estimates:
            return
        if not self._is_laid_out:
            self._lay_out(estimates[0])
        for run in _runs(estimates):
            self._log_run(run)
        newest = estimates[-1]
        if newest.time - self._mounted >= CALIBRATION_S and newest.wearers[0].calibration:
            for body, recording, wearer in zip(self._newest, self._setup.wearers, newest.wearers, strict=True):
                log_sensors(self._stream, body.entity, recording.placement, wearer.calibration, self._sensor_colours)
            self._mounted = newest.time
        self._series.log(estimates)
        self._log_findings(estimates)

    def _seen(self, messages: Sequence[LiveEstimate | VideoFrame], camera: Camera) -> list[SeenFrame]:
        """The first camera's video frames, each with what the first answer after it says of the people in it."""
        seen_frames = []
        for message in messages:
            if isinstance(message, VideoFrame):
                if message.camera != camera.name or not message.time > self._filmed_until:
                    continue
                self._filmed_until = message.time
                if self._pending is not None:
                    seen_frames.append((self._pending, np.full(len(self._pending.pixels), NOBODY)))
                self._pending = message
            elif self._pending is not None:
                labels = np.full(len(self._pending.pixels), NOBODY)
                for index, wearer in enumerate(message.wearers):
                    if wearer.detection is not None and wearer.detection < len(labels):
                        labels[wearer.detection] = index
                seen_frames.append((self._pending, labels))
                self._pending = None
        return seen_frames

    def _log_run(self, estimates: Sequence[LiveEstimate]) -> None:
        """Log bodies and cameras of answers that follow each other."""
        newest = estimate_of(estimates, self._setup, self._rate)
        motions = self._shifted(newest)
        for index, (body, motion) in enumerate(zip(self._newest, motions, strict=True)):
            body.log(motion, GHOST_COLOURS if estimates[-1].preliminary else body_colours(index))
        with_smoothed = [estimate for estimate in estimates if estimate.smoothed_time is not None]
        if with_smoothed:
            smoothed = estimate_of(with_smoothed, self._setup, self._rate, is_smoothed=True)
            for body, motion in zip(self._smoothed, self._shifted(smoothed), strict=True):
                body.log(motion, GHOST_COLOURS)
        time, centre = centre_path(motions)
        log_centre(self._stream, time, centre * [1, 1, 0] + [0, 0, self._height])
        for camera in newest.cameras:
            log_camera_poses(self._stream, self._cameras[camera.name], camera.path)
            if self._lenses.get(camera.name) != camera.model:
                self._lenses[camera.name] = camera.model
                log_pinhole(self._stream, f"{self._cameras[camera.name]}/image", camera.model)
            if self._setup.camera is not None and camera.name == self._setup.camera.name:
                self._log_projections(camera, self._setup.camera.keypoints, motions)

    def _shifted(self, estimate: Estimate) -> list[Motion]:
        """Motions of the wearers where they are drawn."""
        motions = zip((wearer.motion for wearer in estimate.wearers), self._shifts, strict=True)
        return [replace(motion, p_world_pelvis=motion.p_world_pelvis + shift) for motion, shift in motions]

    def _log_projections(self, camera: CameraEstimate, keypoints: KeypointSet, motions: Sequence[Motion]) -> None:
        """Log the newest bodies in the first camera's image."""
        path = camera.path
        for motion, entity in zip(motions, people_below(IMAGE, "body", self._setup.names), strict=False):
            pixels = keypoints_in_image(motion, keypoints, path, camera.model, path.time)
            log_projection(self._stream, entity, path.time, pixels, keypoints)

    def _log_findings(self, estimates: Sequence[LiveEstimate]) -> None:
        """Log the text that lists the findings, anew at the moment of each."""
        for estimate in estimates:
            if not estimate.findings:
                continue
            self._stream.set_time("time", duration=estimate.time)
            self._findings += [(estimate.time, finding) for finding in estimate.findings]
            self._log_text()

    def _log_text(self) -> None:
        text = live_summary(self._setup, self._findings, self._apart)
        self._stream.log(SUMMARY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _lay_out(self, estimate: LiveEstimate) -> None:
        """Before the first drawing: where the wearers stand, whence they are looked at, and the text."""
        newest = estimate_of([estimate], self._setup, self._rate)
        if self._apart:
            self._shifts = set_apart([wearer.motion for wearer in newest.wearers])
        motions = self._shifted(newest)
        self._height = float(np.mean([motion.p_world_pelvis[0, 2] for motion in motions]))
        floor = min(floor_height(motion) for motion in motions)
        camera = self._setup.camera
        images = [("Camera", IMAGE, camera.model)] if camera is not None else []
        stage = Stage(motions, floor, images, [body.entity for body in self._newest], apart=self._apart)
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


QUEUE_ITEMS = 2400  # 20 s of answers and video frames that may wait


class LiveRerunSink:
    """Drawing of a stream; ``write`` returns at once, always.

    Args:
        setup: of the stream.
        rate: frames per second of the tracker.
        save: ``.rrd`` file, called ``NAME.partial.rrd`` until it is complete.
        connect: URL of a viewer that runs already (``rerun+http://host:9876/proxy``); without both a window is opened.
        overwrite: whether the file may be replaced.

    Attributes:
        dropped: answers that were not drawn.
        lost: one sentence if a file was wanted that was not written; empty until :meth:`close`.

    Raises:
        InputError: if the file exists, or what a killed stream left of one, and may not be overwritten; if there is no
            display for a window.
    """

    def __init__(
        self,
        setup: Scene,
        rate: float = 60.0,
        save: Path | None = None,
        connect: str | None = None,
        overwrite: bool = False,
    ) -> None:
        self.dropped, self.lost = 0, ""
        self._setup, self._rate, self._save, self._overwrite = setup, rate, save, overwrite
        self._items: deque[LiveEstimate | VideoFrame] = deque()
        self._is_over, self._is_complete = Event(), False
        self._sentences: list[str] = []
        # At the end of a program Rerun would wait for ever for a viewer that hangs: the thread hands over what it can.
        rr.unregister_shutdown()
        self._stream = rr.RecordingStream(APPLICATION)
        if save is not None:
            check_partial(save, overwrite)
        elif connect is not None:
            self._stream.connect_grpc(connect)
        else:
            open_viewer(self._stream, "save or connect", memory="25%")  # the tracker works beside it
        self._thread = Thread(target=self._draw, name="rerun", daemon=True)
        self._thread.start()

    def write(self, message: LiveEstimate | VideoFrame) -> None:
        """Hand over the answer to one frame, or what was seen in a video frame before the answer to it; or drop it."""
        if len(self._items) < QUEUE_ITEMS:
            self._items.append(message)
        elif isinstance(message, LiveEstimate):
            self.dropped += 1

    def findings(self) -> tuple[str, ...]:
        """Sentences about the drawing since the last time."""
        sentences, self._sentences = self._sentences, []
        return tuple(sentences)

    def close(self) -> tuple[str, ...]:
        """Draw what is left, and end; returns the last sentences. A second call does nothing."""
        if self._is_over.is_set():
            return ()
        self._is_over.set()
        patience_s = 180.0 if self._save is not None else 10.0  # a file that is not finished is lost
        self._thread.join(patience_s)
        if self._thread.is_alive():
            self._sentences.append(f"Rerun took nothing for {patience_s:g} s: it has not shown everything")
        if self._save is not None and not self._is_complete:
            partial = partial_path(self._save)
            remainder = f"; what there is of it is in {partial}" if partial.exists() else ""
            self.lost = f"{self._save}: it was not written whole{remainder}"
        return self.findings()

    def _draw(self) -> None:
        try:
            if self._save is None:
                self._draw_until_over(None, 0.05)
                self._hand_over()
                return
            with partial_file(self._save, self._overwrite) as partial:
                self._stream.save(partial)
                self._draw_until_over(partial, 1.0)  # the file's index, in memory, has a row for each
                complete(self._stream, partial, self._save)
            self._is_complete = True
        except Exception as error:  # the tracker does not care, the user does
            reason = " ".join(str(error).split()) or type(error).__name__
            self._sentences.append(f"Rerun stopped, tracking goes on without it: {reason}")

    def _draw_until_over(self, partial: Path | None, period_s: float) -> None:
        """Draw what has come, again and again; a file is written out each time: a killed stream loses no more."""
        view, is_over = LiveView(self._stream, self._setup, self._rate), False
        while not is_over:
            is_over = self._is_over.wait(period_s)
            messages = [self._items.popleft() for _ in range(len(self._items))]
            if messages:
                view.log(messages)
            if partial is not None and self._save is not None:
                write_out(self._stream, partial, self._save)

    def _hand_over(self) -> None:
        """Give the viewer what Rerun still holds."""
        try:
            self._stream.flush(timeout_sec=2.0)  # a viewer that was closed takes nothing
        except RuntimeError:
            self._sentences.append("Rerun's viewer was closed, or was never reached: it has not shown everything")
        self._stream.disconnect()
