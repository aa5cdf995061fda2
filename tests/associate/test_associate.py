from dataclasses import replace

import numpy as np
import pytest
from association_samples import MODEL, Sample, in_another_world, scene

from vip_factors.associate.associate import Association, associate, make_context
from vip_factors.associate.features import vote_turn
from vip_factors.associate.tracklets import tracklets
from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import InputError
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.sensors.detections import Detections
from vip_factors.settings import AssociationSettings


@pytest.fixture(scope="module")
def sample() -> Sample:
    return scene()


@pytest.fixture(scope="module")
def found(sample: Sample) -> Association:
    return associate(sample.detections, MODEL, sample.motions)


def test_wearers_are_found_among_bystanders(sample: Sample, found: Association) -> None:
    given = found.wearer >= 0
    assert np.mean(found.wearer[given] == sample.wearer[given]) > 0.99
    assert np.mean(found.wearer[sample.wearer >= 0] >= 0) > 0.9
    assert found.findings == ()


def test_nobody_is_in_two_places(sample: Sample, found: Association) -> None:
    given = np.flatnonzero(found.wearer >= 0)
    assert len(np.unique(sample.detections.frame[given] * 10 + found.wearer[given])) == len(given)


def test_what_is_told_of_the_chosen_hypotheses(sample: Sample, found: Association) -> None:
    given = found.wearer >= 0
    assert np.all(found.confidence[given] > 0.5)
    assert np.all(found.confidence[~given] == 0)
    assert np.isnan(found.p_camera_world[~given]).all()
    up = found.R_camera_world[given][:, :, 2]
    assert np.mean(up[:, 1] < -0.9) > 0.95  # the camera is held level, whatever the heading of the wearer's world


def test_a_known_camera_path_is_used(sample: Sample) -> None:
    common = scene(common_world=True)
    second = associate(common.detections, MODEL, common.motions, camera=common.camera)
    given = second.wearer >= 0
    assert np.mean(second.wearer[given] == common.wearer[given]) > 0.99
    assert np.mean(second.wearer[common.wearer >= 0] >= 0) > 0.95
    R = common.camera.R_world_camera[common.detections.frame[given]].swapaxes(-1, -2)
    assert np.rad2deg(np.median(angle_between(second.R_camera_world[given], R))) < 3


def test_the_turn_between_two_wearers_worlds_is_voted_for(sample: Sample) -> None:
    common = scene(common_world=True)
    motions = [in_another_world(common.motions[0], 1.0), in_another_world(common.motions[1], -0.7)]
    context = make_context(common.detections, MODEL, motions, None, None)
    turn = vote_turn(context, np.exp(-3 * context.hypotheses.cost), 0, 1)
    assert abs(wrap_angle(turn.angle - 1.7)) < np.deg2rad(10)


def test_tracklets_hold_one_person_each(sample: Sample) -> None:
    d = sample.detections
    track = tracklets(d.frame, MODEL.normalise(d.pixels), d.confidence, d.rate)
    pure = [len(np.unique(sample.wearer[track == one])) == 1 for one in np.unique(track)]
    assert np.mean(pure) > 0.95
    assert len(pure) < 0.2 * len(d)


def test_another_length_of_window_finds_the_same(sample: Sample, found: Association) -> None:
    again = associate(sample.detections, MODEL, sample.motions, AssociationSettings(window_s=2.0))
    assert np.mean(again.wearer == found.wearer) > 0.98


def test_no_detections(sample: Sample) -> None:
    d = sample.detections
    empty = associate(d.select(np.zeros(len(d), bool)), MODEL, sample.motions)
    assert len(empty.wearer) == 0
    assert "nobody is visible" in str(empty.findings[0])


def test_video_outside_the_motions(sample: Sample) -> None:
    later = associate(sample.detections.shifted(1000.0), MODEL, sample.motions)
    assert np.all(later.wearer == -1)
    assert "overlap with the sensors in time" in str(later.findings[0])


def test_a_wearer_who_is_not_in_the_picture(sample: Sample) -> None:
    bystanders = sample.detections.select(sample.wearer != 0)
    result = associate(bystanders, MODEL, sample.motions[:1])
    assert np.mean(result.wearer == 0) < 0.1
    if not np.any(result.wearer == 0):
        assert "people are visible, but none moves" in " ".join(sentences(result.findings))


def test_two_wearers_who_move_alike(sample: Sample) -> None:
    twin = replace(in_another_world(sample.motions[0], 0.8), name="twin")
    result = associate(sample.detections, MODEL, (sample.motions[0], twin))
    assert any("moves like" in sentence and "twin" in sentence for sentence in sentences(result.findings))


def test_exchanged_sides_are_told(sample: Sample) -> None:
    d = sample.detections
    order = d.keypoints.mirrored
    wearers = sample.wearer >= 0
    swapped = replace(d, pixels=d.pixels[:, order], confidence=d.confidence[:, order]).select(wearers)
    result = associate(swapped, MODEL, sample.motions)
    assert any("left and right exchanged" in sentence for sentence in sentences(result.findings))
    silent = associate(swapped, MODEL, sample.motions, AssociationSettings(check=False))
    assert silent.findings == ()
    assert np.array_equal(silent.wearer, result.wearer)


def test_a_mirrored_picture_is_told(sample: Sample) -> None:
    d = sample.detections
    order = d.keypoints.mirrored
    pixels = d.pixels[:, order] * [-1.0, 1.0] + [2 * MODEL.centre[0], 0.0]
    mirrored = replace(d, pixels=pixels, confidence=d.confidence[:, order]).select(sample.wearer >= 0)
    result = associate(mirrored, MODEL, sample.motions)
    assert any("in a mirrored picture" in sentence for sentence in sentences(result.findings))


def test_another_order_of_keypoints_is_named() -> None:
    sample = scene(keypoints="body25b")
    d = sample.detections.select(sample.wearer >= 0)
    mislabelled = Detections(keypoint_set("body25"), d.time, d.frame, d.pixels, d.confidence)
    result = associate(mislabelled, MODEL, sample.motions)
    assert any("'body25b'" in sentence for sentence in sentences(result.findings))


def only(detections: Detections, *joints: str) -> Detections:
    """The detections of a detector that gives some joints only, on both sides."""
    given = np.array([name.split("_")[-1] in joints for name in detections.keypoints.keypoints])
    pixels = np.where(given[:, None], detections.pixels, np.nan)
    return replace(detections, pixels=pixels, confidence=np.where(given, detections.confidence, 0.0))


@pytest.mark.parametrize("joints", [("shoulder", "hip", "knee", "ankle"), ("shoulder", "hip", "knee")], ids=len)
def test_few_keypoints_are_enough(sample: Sample, joints: tuple[str, ...]) -> None:
    found = associate(only(sample.detections, *joints), MODEL, sample.motions)
    given = found.wearer >= 0
    assert np.mean(found.wearer[given] == sample.wearer[given]) > 0.99
    assert np.mean(found.wearer[sample.wearer >= 0] >= 0) > (0.8 if len(joints) == 4 else 0.5)


def test_too_few_keypoints_are_named_and_the_missing_ones_asked_for(sample: Sample) -> None:
    found = associate(only(sample.detections, "shoulder", "hip"), MODEL, sample.motions)
    assert np.all(found.wearer == -1)
    (told,) = sentences(found.findings)
    assert "4 keypoints each" in told
    assert "left_shoulder, right_shoulder, left_hip, right_hip" in told
    assert "at least 6" in told
    assert told.endswith("add knee and ankle")
    assert "clock" not in told


def test_nobody_found_by_few_keypoints_is_not_put_down_to_clocks(sample: Sample) -> None:
    strangers = only(sample.detections, "shoulder", "hip", "knee").select(sample.wearer < 0)
    found = associate(strangers, MODEL, sample.motions[:1])
    assert np.mean(found.wearer >= 0) < 0.05
    assert all("by the 6 keypoints" in sentence and "clock" not in sentence for sentence in sentences(found.findings))


def test_gravity_of_another_length_is_refused(sample: Sample) -> None:
    with pytest.raises(InputError, match="gravity"):
        associate(sample.detections, MODEL, sample.motions, gravity_camera=np.ones((3, 3)))


def test_no_wearer_is_refused(sample: Sample) -> None:
    with pytest.raises(InputError, match="without a wearer"):
        associate(sample.detections, MODEL, ())
