"""Findings about a scene and its solution.

About a wearer: bodies and motions that people hardly ever have, as wrong mountings often make them; sensors that slip
or drift. About a camera: whom it sees, and whether the picture fits.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.associate.hypothesis import hypotheses, wearer_points
from vip_factors.body.joint_priors import joint_vector, load_joint_limits
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import RecordingError
from vip_factors.estimate import BodyEstimate, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.initialise.camera import LEAP_WINDOW, Sightings, leaps
from vip_factors.initialise.clock import film_finding
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.drift import drift_findings, slip_findings
from vip_factors.stages.fusion import TURNED, FusionSolution

# Scatter of the detections about the skeleton in OKS sigmas: 0.3–0.45 with everything right, OpenPose's own is 0.5; 0.7
# with the clocks 0.3 s apart.
IMPLAUSIBLE_SCATTER = 0.6
# Of the image's sides: detections of 720 lines in an image of 1080 leave its right and lower third empty, and nobody
# aims a camera so.
LARGER_CORNER, OFF_MIDDLE = 0.68, 0.42

FITS_BADLY = ("video mismatch", "hardly seen", "scatter", "leap", "body size", "video clock")


def quality_checks(
    scene: Scene, associated: Sequence[AssociatedCamera], fine: FusionSolution, wearers: Sequence[WearerEstimate]
) -> Iterator[Finding]:
    """About wearers, then about the cameras."""
    used = [video.camera.name for video in associated]
    for left_out in (camera for camera in scene.cameras if camera.name not in used):
        yield Finding("camera left out", subject=left_out.name)
    for number, (recording, estimate) in enumerate(zip(scene.wearers, wearers, strict=True)):
        yield from _wearer_findings(recording, number, associated, fine, estimate)
    for video in associated:
        for finding in _image_findings(video.camera):
            yield in_picture_of(video.camera, scene, finding)


def film_findings(scene: Scene, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Whether the first camera's film is another session's, where it fits badly.

    Args:
        scene: or a stretch of it.
        findings: without a kind of :data:`FITS_BADLY` among them the film is not looked at again.
    """
    if scene.camera is None or not any(finding.kind in FITS_BADLY for finding in findings):
        return ()
    camera = replace(scene.camera, detections=scene.camera.timed_detections)
    try:
        finding = film_finding(replace(scene, cameras=(camera,)))
    except RecordingError:
        return ()
    return () if finding is None else (in_picture_of(camera, scene, finding),)


def who_is_who(scene: Scene, associated: Sequence[AssociatedCamera]) -> tuple[Finding, ...]:
    """Return the association's findings for each camera."""
    return tuple(
        in_picture_of(video.camera, scene, finding) for video in associated for finding in video.association.findings
    )


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
    shortly_seen = 3.0  # s: in less, people do not move enough to be distinguished
    unsure_heading_deg = 15.0  # a heading no better known than this came from the straps
    wearer, frame_rate = recording.subject.name, 1 / fine.model.wearers[0].frames.step
    views = [viewpoint.views[number] for viewpoint in fine.model.viewpoints(fine.state)]
    is_seen = np.any([view.seen.any(axis=1) for view in views], axis=0)
    if not is_seen.any():
        consequence = "the pose rests on the sensors alone, and the position among the others is unknown"
        yield Finding("hardly seen", wearer, words={"seen": "never seen", "so": consequence})
        return
    seconds = float(is_seen.sum()) / max(min(max(video.detections.rate for video in associated), frame_rate), 1e-9)
    if seconds < shortly_seen:
        consequence = "anybody in the same posture would fit as well, so check that it is the wearer"
        words = {"seen": f"seen for {seconds:.1f} s only", "so": consequence}
        yield Finding("hardly seen", wearer, numbers={"seconds": seconds}, words=words)
    sigmas = {name: float(np.rad2deg(sensor.heading_sigma)) for name, sensor in estimate.calibration.items()}
    unsure = {name: sigma for name, sigma in sigmas.items() if sigma > unsure_heading_deg}
    if unsure:
        words = {
            "limit": f"are not determined by the data (standard deviation above {unsure_heading_deg:.0f}°)",
            "better": "keypoints beyond them (toes, hands) or longer motion",
        }
        yield Finding(
            "limited set-up", wearer, subject=f"the headings of {', '.join(unsure)}", numbers=unsure, words=words
        )
    if estimate.body is not None:
        yield from body_findings(wearer, estimate.body, recording.subject.stature_m)
    bones, frames = estimate.motion.state.R_world_bone, fine.model.wearers[number].frames
    yield from slip_findings(wearer, recording, frames, bones, estimate.calibration)
    start = fine.model.wearers[number].prior_R_bone_sensor
    yield from posture_findings(wearer, recording, estimate.motion, estimate.calibration, start)
    yield from drift_findings(wearer, estimate.calibration)
    spreads = fine.measured_spreads()
    for index, video in enumerate(associated):
        if views[index].seen.any():
            for finding in _view_findings(wearer, video, number, spreads[index][number], estimate.motion):
                yield replace(finding, camera=video.camera.name) if len(associated) > 1 else finding


def _view_findings(
    wearer: str, video: AssociatedCamera, number: int, spread: float, solved: Motion
) -> Iterator[Finding]:
    camera = video.camera
    has_known_pose = camera.known_path is not None and not camera.moving  # a cut or another zoom shows as scatter then
    times = confirmed_leaps(video, number, solved) if not has_known_pose else ()
    if len(times):
        yield Finding("leap", wearer, words={"times": ", ".join(f"{time:.2f}" for time in times[:5])})
    if spread > IMPLAUSIBLE_SCATTER:
        pose = ", its known pose" if camera.known_path is not None else ""
        yield Finding("scatter", wearer, numbers={"scatter": spread}, words={"pose": pose})


def _image_findings(camera: Camera) -> Iterator[Finding]:
    """Detections that do not seem to belong to the calibrated image."""
    corner, outside, least_share = 0.55, 0.1, 0.02  # of the image's sides; of its sides; of all keypoints
    many_keypoints = 500  # from which on a picture of which only a corner is used is no chance
    pixels, model = camera.detections.pixels[camera.detections.seen], camera.model
    if len(pixels) < many_keypoints:
        return
    size = np.array([model.width, model.height])
    far = np.any((pixels < -outside * size) | (pixels > (1 + outside) * size), axis=1)
    low, middle, high = np.quantile(pixels, [0.001, 0.5, 0.999], axis=0)
    in_corner = np.all(high < corner * size) or np.all((high < LARGER_CORNER * size) & (middle < OFF_MIDDLE * size))
    if far.mean() > least_share or in_corner:
        sides = {"left": low[0], "right": high[0], "top": low[1], "bottom": high[1]}
        yield Finding("image size", numbers={**sides, "width": model.width, "height": model.height})


def confirmed_leaps(video: AssociatedCamera, number: int, solved: Motion) -> Array:
    """Instants ``(n,)`` at which a wearer leaps in a camera's picture, by the solution as by the first association.

    The first association's hypothesis cameras are of a skeleton whose mountings nobody knew yet. A pelvis that is
    tilted on its wearer by 15 degrees turns the world by 30 as the wearer turns about, in any half second. What is left
    of a leap when the solved skeleton takes its place is the picture's: mountings are the same before and after. Nor
    does the first association always take the right person, and the last one makes up for it: only whom the estimate
    was made from may leap.

    Args:
        video: the camera's detections.
        number: of the wearer.
        solved: the wearer's motion.
    """
    times = leaps(video.sightings[number])
    if not len(times):
        return times
    leap_times = leaps(_sightings(video, number, solved))
    return np.array([time for time in times if np.any(np.abs(leap_times - time) <= LEAP_WINDOW)])


def _sightings(video: AssociatedCamera, number: int, solved: Motion) -> Sightings:
    """The hypothesis cameras of the detections that the estimate was made from, of the solved skeleton."""
    detections = video.detections.select(video.association.wearer == number)
    fitted = hypotheses(
        detections,
        video.camera.model.normalise(detections.pixels),
        [wearer_points(solved, detections.keypoints, detections.time)],
    )
    return Sightings(detections.time[fitted.frame], fitted.R_camera_world, fitted.p_camera_pelvis)


MOST, MUCH = 0.5, 0.3  # of the frames, or of the sensors


def posture_findings(
    wearer: str, recording: Recording, motion: Motion, calibration: Calibration, start: Array
) -> Iterator[Finding]:
    """All that is odd about how a wearer holds himself, one finding each; ``start`` ``(S, 3, 3)`` mountings of it."""
    on = {recording.placement.site(name).bone: name for name in calibration}
    bones = set(on)
    yield from turned_findings(wearer, recording, start, calibration)
    yield from knee_findings(wearer, motion, on)
    yield from lying_findings(wearer, motion)
    if bones & {"left_knee", "left_ankle"} and bones & {"right_knee", "right_ankle"}:
        yield from crossed_findings(wearer, motion)
    yield from limit_findings(wearer, motion, bones)


def turned_findings(wearer: str, recording: Recording, start: Array, calibration: Calibration) -> Iterator[Finding]:
    """Sensors that the motion turns far from the mountings ``(S, 3, 3)`` of the start.

    Where no pose was declared, also half of all sensors or more that are far from where they were placed: the motion
    settles how they sit, so that is a note.
    """
    least_sensors = 3  # of which half are odd: of two sensors one is no majority
    mountings = np.stack([sensor.R_bone_sensor for sensor in calibration.values()])
    turned, kind = angle_between(start, mountings), "placement contradicted"
    declared = "the placement" if recording.initial_pose == "none" else "the declared pose"
    if recording.initial_pose == "none" and not np.any(turned > TURNED) and len(mountings) >= least_sensors:
        placed = angle_between(
            np.stack([recording.placement.site(name).R_bone_sensor for name in calibration]), mountings
        )
        turned, kind = np.where(np.mean(placed > TURNED) >= MOST, placed, 0.0), "mountings estimated"
    far = {name: float(np.rad2deg(by)) for name, by in zip(calibration, turned, strict=True) if by > TURNED}
    if far:
        turns = ", ".join(f"{name} by {degrees:.0f}°" for name, degrees in far.items())
        words = {"declared": declared, "reason": f"the motion turns {turns} on their bones"}
        yield Finding(kind, wearer, numbers=far, words=words)


def lying_findings(wearer: str, motion: Motion) -> Iterator[Finding]:
    """A chest that is far from upright most of the time."""
    lying = np.deg2rad(60.0)  # from the vertical, of the chest
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    up = body.R_world_bone[:, joint_index("spine3"), 2, 1]
    share = float(np.mean(up < np.cos(lying)))
    if share > MOST:
        check = f"if not, {CHECK_SITES}"
        yield _posture("unusual posture", wearer, "the body", "lies, or bends far over,", share, check)


def crossed_findings(wearer: str, motion: Motion) -> Iterator[Finding]:
    """Thighs that are crossed through much of a motion: ankles are by people who stand at ease, dance or sit."""
    crossed = 0.05  # m, of knees past one another: hips whose zeros are 7° off make as much of thighs side by side
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    left_knee, right_knee = (body.p_world_joint[:, joint_index(f"{side}_knee")] for side in ("left", "right"))
    across = np.einsum("ti,ti->t", left_knee - right_knee, body.R_world_bone[:, 0, :, 0])
    share = float(np.mean(across < -crossed))
    if share > MUCH:
        posture, check = "are crossed above the knees", f"if they were not, {CHECK_SITES}"
        yield _posture("impossible posture", wearer, "the legs", posture, share, check)


def limit_findings(wearer: str, motion: Motion, bones: set[str]) -> Iterator[Finding]:
    """Ankles and elbows that are bent further than they go most of the time, under sensors of the limb below."""
    at_limit = np.deg2rad(3.0)  # beyond what joints do: those of people who stand and walk stay well within
    vectors = joint_vector(motion.R_parent_child).reshape(len(motion.R_parent_child), -1, 3)
    excess = np.abs(load_joint_limits().violation(joint_vector(motion.R_parent_child))).reshape(vectors.shape)
    for joint in (f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "elbow")):
        share = float(np.mean(excess[:, joint_index(joint) - 1].max(axis=1) > at_limit))
        if joint in bones and share > MUCH:
            side, name = joint.split("_")
            check = "does the sensor below it sit as the placement has it, and was the declared pose held, if any?"
            posture = f"is bent further than {name}s go"
            yield _posture("unusual posture", wearer, f"the {side} {name}", posture, share, check)


CHECK_SITES = "check which sensor sits where and, if one was declared, that the pose was held"


def _posture(kind: str, wearer: str, subject: str, posture: str, share: float, check: str) -> Finding:
    """Return the finding about a posture held in a share of the frames, and what to check."""
    words = {"posture": f"{posture} in {100 * share:.0f} % of the frames", "check": check}
    return Finding(kind, wearer, subject=subject, numbers={"percent": 100 * share}, words=words)


UNLIKELY = 3.0  # sigmas of the prior
# A shank turns on a bent thigh by 25° at most, and back again: on the median by 6° in 38 sound recordings, by 11 to 14°
# where the heading of thigh or shank jumped or drifted by 50 to 60°.
KNEE_TURNED_DEG = 9.0


def body_findings(wearer: str, body: BodyEstimate, stature_m: float | None) -> Iterator[Finding]:
    """Return the finding about the body of a wearer with a declared stature."""
    least_scale = 0.02  # of a body: less is within the error of a stature that its wearer states
    if not body.names:
        return
    phrases, numbers = list[str](), dict[str, float]()
    scale, sigma = common_scale(body)
    if abs(scale) > max(UNLIKELY * sigma, least_scale):  # a wrong stature or zoom changes all lengths alike
        usual = "an adult's" if stature_m is None else f"one of {stature_m:.2f} m"
        percent, larger = abs(100 * scale), "larger" if scale > 0 else "smaller"
        phrases.append(
            f"all lengths: together they suggest a body {percent:.0f} % {larger} than {usual}: check the stature, and "
            "the camera's calibration (another zoom?)"
        )
        numbers["percent"] = percent
    else:
        scale = 0.0
    expected, sigmas = (1 + scale) * body.prior, np.sqrt(np.diag(body.prior_covariance))
    unlikely = [
        f"{name} {1e3 * length:.0f} mm (expected {1e3 * prior:.0f} ± {1e3 * sigma:.0f})"
        for name, length, prior, sigma in zip(body.names, body.posterior, expected, sigmas, strict=True)
        if abs(length - prior) > UNLIKELY * sigma
    ]
    if unlikely:
        phrases.append(
            f"{', '.join(unlikely)}: either the wearer is built so, or the sensors there sit elsewhere than the "
            "placement has them"
        )
    if phrases:
        yield Finding("body size", wearer, numbers=numbers, words={"lengths": "; and about ".join(phrases)})


def knee_findings(wearer: str, motion: Motion, on: Mapping[str, str]) -> Iterator[Finding]:
    """Knees that bend backwards through much of a motion, or are twisted between sensors; ``on`` names them by bone."""
    # Knees stretch over by 5° at most; how straight a straight one is leaves as much again, and nobody walks like that.
    backwards_deg, backwards_share = -10.0, 0.25
    vectors = np.rad2deg(joint_vector(motion.R_parent_child)).reshape(len(motion.R_parent_child), -1, 3)
    for side in ("left", "right"):
        bend, turn, _ = vectors[:, joint_index(f"{side}_knee") - 1].T
        share = float(np.mean(bend < backwards_deg))
        if share > backwards_share:
            check = "are the sensors of thigh and shank where the placement has them, and was the declared pose held?"
            yield _posture("impossible posture", wearer, f"the {side} knee", "bends backwards", share, check)
        sensors = [on[bone] for bone in (f"{side}_hip", f"{side}_knee") if bone in on]
        degrees = float(np.median(np.abs(turn)))
        if len(sensors) == 2 and degrees > KNEE_TURNED_DEG:
            wrong = "' or '".join(sensors)
            words = {
                "posture": f"is turned about itself against the thigh, by {degrees:.0f}° or more half of the time",
                "check": f"the heading or mounting of '{wrong}' is wrong: was there metal close by, did one slip, or "
                "was the pose not held?",
            }
            subject = f"the {side} shank"
            yield Finding("impossible posture", wearer, subject=subject, numbers={"degrees": degrees}, words=words)


def common_scale(body: BodyEstimate) -> tuple[float, float]:
    """By which share all lengths are larger than the prior's mean (least squares under the prior), and its sigma."""
    weighed = np.linalg.solve(body.prior_covariance, body.prior)
    variance = 1 / float(weighed @ body.prior)
    return variance * float(weighed @ (body.posterior - body.prior)), float(np.sqrt(variance))
