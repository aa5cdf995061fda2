"""Bad input of a scene yields a sentence that names what was found and what to do; a good scene yields none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import HASTY, QUICK, camera_of, enlarged, filmed_gestures, spliced, with_detections

from vip_factors.associate.associate import Association
from vip_factors.associate.hypothesis import hypotheses, wearer_points
from vip_factors.body.kinematics import Motion
from vip_factors.estimate import CameraEstimate, Estimate
from vip_factors.findings import KINDS, Severity, sentences, verdict
from vip_factors.initialise.camera import Sightings, leaps
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.settings import CameraKind
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.findings import confirmed_leaps
from vip_factors.stages.reporting import precision_findings


@cache
def good(camera: CameraKind = "fixed", azimuth_deg: float = 20.0) -> Scene:
    return filmed_gestures(camera, azimuth_deg=azimuth_deg)


def sentence(estimate: Estimate, *words: str) -> str:
    """The one finding that holds all of some words."""
    found = [sentence for sentence in sentences(estimate.findings) if all(word in sentence for word in words)]
    assert len(found) == 1, estimate.findings
    return found[0]


def camera_found(estimate: Estimate) -> CameraEstimate:
    assert estimate.camera is not None
    return estimate.camera


def assert_imus_alone(estimate: Estimate) -> None:
    assert estimate.method == "SIP"
    assert estimate.camera is None
    sentence(estimate, "IMUs alone")


@pytest.mark.parametrize("camera", ["fixed", "hand-held"])
def test_nothing_is_odd_about_a_good_scene(camera: CameraKind) -> None:
    assert smooth(good(camera), QUICK).findings == ()


@pytest.mark.parametrize(
    ("joints", "filmed", "told"),
    [
        (("hip", "knee", "shoulder", "elbow"), True, ""),
        (("hip", "knee", "shoulder", "elbow"), False, "8 sensors and no camera determine joints only to ± 56 mm"),
        (("hip", "knee"), True, ""),
        (("knee", "elbow"), True, "miss the flexion of knees without a sensor on the thighs"),
    ],
)
def test_a_set_up_that_cannot_tell_as_much_as_is_promised_is_told(
    joints: tuple[str, ...], filmed: bool, told: str
) -> None:
    bones = [f"{side}_{joint}" for joint in joints for side in ("left", "right")]
    found = list(precision_findings("Ada", set(bones), len(bones), filmed))
    assert len(found) == bool(told)
    for one in found:
        assert told in str(one)
        assert verdict(found).severity is Severity.CARE
        assert not KINDS[one.kind].is_fault


def test_another_resolution_than_the_calibrations() -> None:
    scene = with_detections(good(), lambda found: replace(found, pixels=found.pixels * 2 / 3))
    told = sentence(smooth(scene, HASTY), "resolution")
    assert "1920 by 1080 pixels" in told


def test_the_wrong_order_of_keypoints_is_named() -> None:
    scene = with_detections(good(), lambda found: replace(found, pixels=found.pixels[:, found.keypoints.mirrored]))
    told = sentence(smooth(scene, HASTY), "another order")
    assert "openpose18 with left and right exchanged" in told
    assert "name the right keypoint set" in told


def test_an_order_of_no_known_set_is_suspected() -> None:
    scene = with_detections(good(), lambda found: replace(found, pixels=np.roll(found.pixels, 1, axis=1)))
    estimate = smooth(scene, HASTY)
    sentence(estimate, "'anna'", "the order of keypoints")
    assert_imus_alone(estimate)


def test_nobody_is_ever_visible() -> None:
    estimate = smooth(with_detections(good(), lambda found: found.select(np.zeros(len(found), bool))), HASTY)
    sentence(estimate, "nobody is visible", "check the detections")
    assert_imus_alone(estimate)


def test_everybody_visible_wears_no_imus() -> None:
    two = filmed_gestures(people=("anna", "bob"), backwards=True)
    assert two.camera.truth is not None
    strangers = camera_of(two).detections.select(two.camera.truth.wearer == 1)
    scene = Scene("strangers", two.wearers[:1], (replace(camera_of(two), detections=strangers, truth=None),))
    estimate = smooth(scene, HASTY)
    sentence(estimate, "'anna'", "none moves like the wearer", "not in the image")
    assert_imus_alone(estimate)


@pytest.mark.slow
def test_two_wearers_with_the_same_motion() -> None:
    estimate = smooth(filmed_gestures(people=("anna", "bob"), in_step=True), HASTY)
    sentence(estimate, "'anna'", "'bob'", "cannot be distinguished")


@pytest.mark.parametrize("imu", [True, False], ids=["camera with IMU", "camera without"])
def test_a_camera_that_jumps(imu: bool) -> None:
    scene, other = good("hand-held"), good("hand-held", 80.0)
    scene = with_detections(scene, lambda found: spliced(found, camera_of(other).detections))
    if not imu:
        scene = replace(scene, cameras=(replace(camera_of(scene), mount=None),))
    told = sentence(smooth(scene, HASTY), "jumps", "a cut in the video", "cut the recording")
    assert 1.8 < float(told.split(" at ")[1].split()[0]) < 2.2


def test_a_change_of_zoom() -> None:
    scene = with_detections(good(), lambda found: enlarged(found, 1.6, (960, 540)))
    sentence(smooth(scene, HASTY), "jumps", "a change of zoom", "cut the recording")


def test_clocks_that_are_apart() -> None:
    scene = replace(good(), cameras=(replace(camera_of(good()), clock=VideoClock(0.3)),))
    estimate = smooth(scene, QUICK)
    sentence(estimate, "the video's clock is -", "off the clock given in the scene", "vip-factors sync")
    assert camera_found(estimate).clock.offset == pytest.approx(0.0, abs=0.1)


def test_a_scene_that_was_not_filmed_while_the_sensors_ran() -> None:
    scene = replace(good(), cameras=(replace(camera_of(good()), clock=VideoClock(60.0)),))
    estimate = smooth(scene, HASTY)
    sentence(estimate, "does not overlap with the sensors in time", "time offset")
    assert_imus_alone(estimate)


EXCHANGED_S = 2.0


@cache
def scene() -> Scene:
    return filmed_gestures(people=("anna", "bob"), azimuth_deg=20.0)


def true_motion() -> Motion:
    truth = scene().wearers[0].truth
    assert truth is not None
    return truth.motion


def right_and_exchanged() -> tuple[np.ndarray, np.ndarray]:
    """Whose the detections are, and the same with Bob taken for Anna from an instant on."""
    truth, detections = scene().camera.truth, camera_of(scene()).detections
    assert truth is not None
    late = detections.time[detections.frame] > EXCHANGED_S
    return truth.wearer, np.where(late & (truth.wearer >= 0), 1 - truth.wearer, truth.wearer)


def watched(at_first: np.ndarray, at_last: np.ndarray) -> AssociatedCamera:
    """Anna's camera, by whom the first and the last association take for her."""
    camera, detections = camera_of(scene()), camera_of(scene()).detections
    own = detections.select(at_first == 0)
    points = wearer_points(true_motion(), own.keypoints, own.time)
    found = hypotheses(own, camera.model.normalise(own.pixels), [points])
    seen = Sightings(own.time[found.frame], found.R_camera_world, found.p_camera_pelvis)
    N = len(detections)
    given = Association(at_last, np.ones(N), np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3)), np.zeros(N))
    return AssociatedCamera(replace(camera, mount=None), detections, given, (seen,))


@pytest.mark.parametrize("mended", [True, False])
def test_only_who_was_used_may_leap(mended: bool) -> None:
    right, exchanged = right_and_exchanged()
    each = watched(exchanged, right if mended else exchanged)
    assert len(leaps(each.sightings[0]))
    found = confirmed_leaps(each, 0, true_motion())
    if mended:
        assert not len(found)
    else:
        assert found[0] == pytest.approx(EXCHANGED_S, abs=0.2)
