"""The simulated detector: its statistics are what the settings say, and what hides is hidden."""

import numpy as np
import pytest
from numpy.typing import NDArray

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import calibration_pose
from vip_factors.geometry.rotations import rotation_z
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.simulate.detector import ROOT_AREA_PER_HEIGHT, detect, owners
from vip_factors.simulate.detector_view import Person, View, look
from vip_factors.simulate.scene import looking_at
from vip_factors.simulate.settings import DetectorSettings

KEYPOINTS = keypoint_set("openpose18")
NAMES = KEYPOINTS.keypoints
MODEL = CameraModel(1920, 1080, (1600.0, 1600.0), (960.0, 540.0))
RATE, DISTANCE = 30.0, 5.0


def camera(count: int) -> CameraPath:
    """At the origin of the ground, 1 m high, looking along +x."""
    p = np.tile([0.0, 0.0, 1.0], (count, 1))
    return CameraPath(np.arange(count) / RATE, looking_at(p, p + np.array([1.0, 0.0, 0.0])), p)


def standing(count: int, x: float = DISTANCE, y: NDArray | float = 0.0, yaw: float = np.pi) -> Person:
    """Somebody in the N-pose; yaw π faces the camera, 0 shows the back."""
    skeleton = skeleton_from_stature(1.75)
    R = np.repeat(calibration_pose("n-pose")[None], count, axis=0)
    R[:, 0] = rotation_z(yaw) @ R[:, 0]
    p = np.stack([np.full(count, x), np.broadcast_to(y, (count,)), np.full(count, 0.95)], axis=1)
    return Person(skeleton, forward_kinematics(skeleton, R, p), np.ones(count, bool))


def seen(*people: Person) -> View:
    count = len(people[0].present)
    return look(people, camera(count), MODEL, KEYPOINTS, np.zeros((len(people), len(KEYPOINTS), 3)))


def found(people: list[Person], seed: int = 0, **errors: float) -> tuple[Detections, NDArray, NDArray]:
    settings = DetectorSettings.noise_free(**errors)
    return detect(people, camera(len(people[0].present)), MODEL, KEYPOINTS, settings, seed)


def indices(*words: str) -> list[int]:
    return [k for k, name in enumerate(NAMES) if any(word in name for word in words)]


def test_errors_have_the_size_and_the_memory_that_was_measured() -> None:
    people = [standing(1500, y=0.8 * (k - 2)) for k in range(5)]
    detections, owner, truth = found(people, error=1.0)
    assert len(detections) == 5 * 1500
    height = MODEL.focal[1] * 1.75 / DISTANCE
    unit = KEYPOINTS.sigmas * ROOT_AREA_PER_HEIGHT * height
    error = (detections.pixels - truth) / unit[:, None]
    series = np.stack([error[owner == k] for k in range(5)])
    assert np.std(series) == pytest.approx(np.sqrt(0.26**2 + 0.20**2 + 0.10**2), rel=0.05)
    for lag in (1, 9, 30):
        change = np.mean((series[:, lag:] - series[:, :-lag]) ** 2) / 2
        slow, drift = (1 - np.exp(-lag / RATE / time_s) for time_s in (0.14, 3.0))
        assert change == pytest.approx(0.26**2 * drift + 0.20**2 * slow + 0.10**2, rel=0.1)


def test_bias_is_constant_and_fixed_to_the_body() -> None:
    turning = [standing(2, yaw=yaw) for yaw in (np.pi, np.pi, 0.0)]
    bias = [(d.pixels - t)[:, indices("hip")] for d, _, t in (found([one], bias_m=0.02) for one in turning)]
    assert bias[0] == pytest.approx(bias[1])
    assert bias[0][0] == pytest.approx(bias[0][1])
    assert bias[2][..., 0] == pytest.approx(-bias[0][..., 0], abs=0.5)  # seen from behind, left and right change


def pixels(found: tuple[Detections, NDArray, NDArray]) -> NDArray:
    return found[0].pixels


def test_confidence_falls_where_errors_grow() -> None:
    detections, _, truth = found([standing(3000)], error=1.0, doubt=1.0)
    error = np.linalg.norm(detections.pixels - truth, axis=2) / KEYPOINTS.sigmas
    unsure = detections.confidence < 0.4
    assert 0.01 < unsure.mean() < 0.5
    assert np.nanmedian(error[unsure]) > 2 * np.nanmedian(error[detections.confidence > 0.65])


@pytest.mark.parametrize(("yaw", "hidden"), [(np.pi, ()), (0.0, ("nose",)), (np.pi / 2, ("right_ear", "right_hip"))])
def test_bodies_hide_their_own_far_side(yaw: float, hidden: tuple[str, ...]) -> None:
    hides = seen(standing(1, yaw=yaw)).hidden[0, 0]
    behind_itself = {NAMES[k] for k in np.flatnonzero(hides)}
    assert set(hidden) <= behind_itself
    assert not behind_itself & {"left_shoulder", "left_elbow", "left_wrist"}  # they are near, or at the sides
    assert len(behind_itself) <= (2 if not hidden else 9)


def test_the_nearer_person_hides_the_farther() -> None:
    view = seen(standing(1, 4.0), standing(1, 6.0))
    assert not view.behind[0].any()
    assert view.behind[1, 0, indices("hip", "shoulder", "neck")].sum() >= 4
    apart = seen(standing(1, 4.0, y=1.5), standing(1, 6.0))
    assert not apart.behind.any()


def test_hidden_keypoints_are_missed_as_often_as_asked() -> None:
    people = [standing(4000, 4.0), standing(4000, 6.0)]
    behind = seen(*people).behind[1, 0]
    detections, owner, _ = found(people, missed=1.0)
    rows = [np.sum(detections.confidence[detections.of_frame(f)] == 0) for f in range(4000)]
    assert np.mean(rows) == pytest.approx(0.6 * behind.sum(), rel=0.1)
    assert set(np.unique(owner)) <= {-1, 0, 1}


def test_who_leaves_the_image_is_cut_off_and_then_gone() -> None:
    y = np.linspace(0, 5.0, 200)
    detections, owner, truth = found([standing(200, y=y)])
    count = np.zeros(200, int)
    count[detections.frame] = detections.seen.sum(axis=1)
    assert count[0] == len(NAMES)
    assert np.any((count > 0) & (count < len(NAMES)))
    assert np.all(count[-20:] == 0)
    assert np.all(MODEL.inside(detections.pixels[detections.seen]))
    major = detections.seen[:, [k for k in range(len(NAMES)) if k not in indices("nose", "eye", "ear")]].sum(axis=1)
    assert np.array_equal(owner == 0, major >= 7)
    assert np.all(np.isnan(truth[owner == -1]))


def test_left_and_right_swap_as_often_as_asked_and_only_then() -> None:
    hips = indices("hip")
    for yaw, share in ((np.pi, 0.025), (np.pi / 2, 0.2), (0.0, 0.1)):
        detections, _, _ = found([standing(6000, yaw=yaw)], swapped=5.0)
        right = pixels(found([standing(1, yaw=yaw)]))[0]
        wrong = np.linalg.norm(detections.pixels[:, hips] - right[hips], axis=2).max(axis=1) > 1e-6
        assert wrong.mean() == pytest.approx(share, abs=0.04)
        if wrong.any():
            assert detections.pixels[wrong][:, hips] == pytest.approx(np.tile(right[hips[::-1]], (wrong.sum(), 1, 1)))


def test_merged_people_are_one_detection_with_limbs_of_both() -> None:
    people = [standing(3000, 4.0), standing(3000, 4.8, y=0.15)]
    detections, _, truth = found(people, mixed=2.0)
    count = np.bincount(detections.frame, minlength=3000)
    assert np.mean(count == 1) == pytest.approx(0.3, abs=0.07)
    alone = np.isin(detections.frame, np.flatnonzero(count == 1))
    error = np.linalg.norm(detections.pixels - truth, axis=2)
    assert np.any(error[alone] > 20)
    assert np.mean(error[~alone] < 1e-6) > 0.8  # the others have limbs exchanged
    far = found([standing(300, 4.0), standing(300, 4.8, y=2.0)], mixed=6.0)[0]
    assert len(far) == 600


def test_a_detection_belongs_to_who_has_seven_of_its_keypoints() -> None:
    people = standing(1, y=-0.8), standing(1, y=0.8)
    view = seen(*people)
    mine, theirs = view.pixels[0, 0], view.pixels[1, 0]
    limbs = indices("knee", "ankle", "elbow", "wrist")
    mixed = mine.copy()
    mixed[limbs] = theirs[limbs]  # 8 of the other's, 5 of one's own
    few = np.where(np.isin(np.arange(18), limbs[:6])[:, None], mine, np.nan)
    pixel = np.stack([mine, mixed, few, mine + 300.0])
    sure = np.isfinite(pixel[..., 0]).astype(float)
    detections = Detections(KEYPOINTS, np.zeros(1), np.zeros(4, int), pixel, sure)
    assert owners(detections, view, KEYPOINTS).tolist() == [0, 1, -1, -1]
