"""What is odd about a scene and its solution, as findings."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.associate.hypothesis import hypotheses, wearer_points
from vip_factors.body.kinematics import Motion
from vip_factors.errors import RecordingError
from vip_factors.estimate import WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.camera import LEAP_WINDOW, Sightings, leaps
from vip_factors.initialise.clock import film_finding
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.drift import drift_findings, leap_findings
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.wearer_findings import body_findings, posture_findings

# Scatter of the detections about the skeleton in OKS sigmas: 0.3–0.45 with everything right, OpenPose's own is 0.5; 0.7
# with the clocks 0.3 s apart.
IMPLAUSIBLE_SCATTER = 0.6
CORNER, OUTSIDE, FEW = 0.55, 0.1, 0.02  # of the image's sides; of its sides; of all keypoints
# Of the image's sides: detections of 720 lines in an image of 1080 leave its right and lower third empty, and nobody
# aims a camera so.
LARGER_CORNER, OFF_MIDDLE = 0.68, 0.42

FITS_BADLY = ("not recognised", "never seen", "shortly seen", "scatter", "leap", "body size", "video clock off")


def quality_checks(
    scene: Scene, associated: Sequence[AssociatedCamera], fine: FusionSolution, wearers: Sequence[WearerEstimate]
) -> Iterator[Finding]:
    """About wearers, then about the cameras."""
    used = [each.camera.name for each in associated]
    for left_out in (camera for camera in scene.cameras if camera.name not in used):
        yield Finding("camera left out", subject=left_out.name)
    for number, (recording, estimate) in enumerate(zip(scene.wearers, wearers, strict=True)):
        yield from _wearer_findings(recording, number, associated, fine, estimate)
    for each in associated:
        for one in _image_findings(each.camera):
            yield in_picture_of(each.camera, scene, one)


def film_findings(scene: Scene, told: Sequence[Finding]) -> tuple[Finding, ...]:
    """Whether the first camera's film is another session's, where it fits badly.

    Args:
        scene: or a stretch of it.
        told: what was found; without a kind of :data:`FITS_BADLY` in it the film is not looked at again.
    """
    if scene.camera is None or not any(one.kind in FITS_BADLY for one in told):
        return ()
    camera = replace(scene.camera, detections=scene.camera.timed_detections)
    try:
        finding = film_finding(replace(scene, camera=camera, truth=None))
    except RecordingError:
        return ()
    return () if finding is None else (in_picture_of(camera, scene, finding),)


def who_is_who(scene: Scene, associated: Sequence[AssociatedCamera]) -> tuple[Finding, ...]:
    """What was odd about who is seen, before each camera."""
    return tuple(in_picture_of(each.camera, scene, one) for each in associated for one in each.association.findings)


def in_picture_of(camera: Camera, scene: Scene, finding: Finding) -> Finding:
    """The finding with the camera's name, where there are several."""
    return replace(finding, camera=camera.name) if len(scene.cameras) > 1 else finding


def _wearer_findings(
    recording: Recording,
    number: int,
    associated: Sequence[AssociatedCamera],
    fine: FusionSolution,
    estimate: WearerEstimate,
) -> Iterator[Finding]:
    shortly_seen = 3.0  # s: in less, people do not move enough to be told apart
    unsure_heading = np.deg2rad(15.0)  # a heading no better known than this came from the straps
    wearer, frame_rate = recording.subject.name, 1 / fine.model.wearers[0].frames.step
    views = [one.views[number] for one in fine.model.viewpoints(fine.state.camera)]
    seen = np.any([view.seen.any(axis=1) for view in views], axis=0)
    if not seen.any():
        yield Finding("never seen", wearer)
        return
    seconds = float(seen.sum()) / max(min(max(each.detections.rate for each in associated), frame_rate), 1e-9)
    if seconds < shortly_seen:
        yield Finding("shortly seen", wearer, numbers={"seconds": seconds})
    unsure = {
        name: float(np.rad2deg(one.heading_sigma))
        for name, one in estimate.calibration.items()
        if one.heading_sigma > unsure_heading
    }
    if unsure:
        words = {"limit": f"{np.rad2deg(unsure_heading):.0f}°"}
        yield Finding("headings not determined", wearer, numbers=unsure, words=words)
    if estimate.body is not None:
        yield from body_findings(wearer, estimate.body, recording.subject.stature_m)
    bones, frames = estimate.motion.state.R_world_bone, fine.model.wearers[number].frames
    yield from leap_findings(wearer, recording, frames, bones, estimate.calibration)
    start = fine.model.wearers[number].prior_R_bone_sensor
    yield from posture_findings(wearer, recording, estimate.motion, estimate.calibration, start)
    yield from drift_findings(wearer, estimate.calibration)
    spreads = fine.measured_spreads()
    for index, each in enumerate(associated):
        if views[index].seen.any():
            for one in _view_findings(wearer, each, number, spreads[index][number], estimate.motion):
                yield replace(one, camera=each.camera.name) if len(associated) > 1 else one


def _view_findings(
    wearer: str, each: AssociatedCamera, number: int, spread: float, solved: Motion
) -> Iterator[Finding]:
    camera = each.camera
    known = camera.known_path is not None and not camera.moving  # a cut or another zoom shows as scatter then
    times = confirmed_leaps(each, number, solved) if not known else ()
    if len(times):
        yield Finding("leap", wearer, words={"times": ", ".join(f"{time:.2f}" for time in times[:5])})
    if spread > IMPLAUSIBLE_SCATTER:
        pose = ", its known pose" if camera.known_path is not None else ""
        yield Finding("scatter", wearer, numbers={"scatter": spread}, words={"pose": pose})


def _image_findings(camera: Camera) -> Iterator[Finding]:
    """Detections that do not seem to belong to the calibrated image."""
    many_keypoints = 500  # from which on a picture of which only a corner is used is no chance
    pixels, model = camera.detections.pixels[camera.detections.seen], camera.model
    if len(pixels) < many_keypoints:
        return
    size = np.array([model.width, model.height])
    far = np.any((pixels < -OUTSIDE * size) | (pixels > (1 + OUTSIDE) * size), axis=1)
    low, middle, high = np.quantile(pixels, [0.001, 0.5, 0.999], axis=0)
    in_corner = np.all(high < CORNER * size) or np.all((high < LARGER_CORNER * size) & (middle < OFF_MIDDLE * size))
    if far.mean() > FEW or in_corner:
        sides = {"left": low[0], "right": high[0], "top": low[1], "bottom": high[1]}
        yield Finding("image size", numbers={**sides, "width": model.width, "height": model.height})


def confirmed_leaps(each: AssociatedCamera, number: int, solved: Motion) -> Array:
    """Instants ``(n,)`` at which a wearer leaps in a camera's picture, by the solution as by the first association.

    The first association's hypothesis cameras are of a skeleton whose mountings nobody knew yet. A pelvis that is
    tilted on its wearer by 15 degrees turns the world by 30 as the wearer turns about, in any half second. What is left
    of a leap when the solved skeleton takes its place is the picture's: mountings are the same before and after. Nor
    does the first association always take the right person, and the last one makes up for it: only whom the estimate
    was made from may leap.

    Args:
        each: the camera.
        number: of the wearer.
        solved: the wearer's motion.
    """
    times = leaps(each.seen[number])
    if not len(times):
        return times
    again = leaps(_sightings(each, number, solved))
    return np.array([one for one in times if np.any(np.abs(again - one) <= LEAP_WINDOW)])


def _sightings(each: AssociatedCamera, number: int, solved: Motion) -> Sightings:
    """The hypothesis cameras of the detections that the estimate was made from, of the solved skeleton."""
    own = each.detections.select(each.association.wearer == number)
    found = hypotheses(own, each.camera.model.normalise(own.pixels), [wearer_points(solved, own.keypoints, own.time)])
    return Sightings(own.time[found.frame], found.R_camera_world, found.p_camera_pelvis)
