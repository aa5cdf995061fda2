"""A leap is told of whom the estimate was made from, not of somebody who was taken for the wearer for a while."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import camera_of, filmed_gestures

from vip_factors.associate.associate import Association
from vip_factors.associate.hypothesis import hypotheses, wearer_points
from vip_factors.initialise.camera import Sightings, leaps
from vip_factors.sensors.scene import Scene
from vip_factors.stages.associated_cameras import AssociatedCamera
from vip_factors.stages.leap_findings import confirmed_leaps

EXCHANGED_S = 2.0


@cache
def scene() -> Scene:
    return filmed_gestures(people=("anna", "bob"), azimuth_deg=20.0)


def right_and_exchanged() -> tuple[np.ndarray, np.ndarray]:
    """Whose the detections are, and the same with Bob taken for Anna from an instant on."""
    truth, detections = scene().truth, camera_of(scene()).detections
    assert truth is not None
    late = detections.time[detections.frame] > EXCHANGED_S
    return truth.wearer, np.where(late & (truth.wearer >= 0), 1 - truth.wearer, truth.wearer)


def watched(at_first: np.ndarray, at_last: np.ndarray) -> AssociatedCamera:
    """Anna's camera, by whom the first and the last association take for her."""
    camera, detections = camera_of(scene()), camera_of(scene()).detections
    own = detections.select(at_first == 0)
    points = wearer_points(scene().wearers[0].truth.motion, own.keypoints, own.time)
    found = hypotheses(own, camera.model.normalise(own.pixels), [points])
    seen = Sightings(own.time[found.frame], found.R_camera_world, found.p_camera_pelvis)
    N = len(detections)
    given = Association(at_last, np.ones(N), np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3)), np.zeros(N))
    return AssociatedCamera(replace(camera, mount=None), detections, given, (seen,))


@pytest.mark.parametrize("mended", [True, False])
def test_only_who_was_used_may_leap(mended: bool) -> None:
    right, exchanged = right_and_exchanged()
    each = watched(exchanged, right if mended else exchanged)
    assert len(leaps(each.seen[0]))
    found = confirmed_leaps(each, 0, scene().wearers[0].truth.motion)
    if mended:
        assert not len(found)
    else:
        assert found[0] == pytest.approx(EXCHANGED_S, abs=0.2)
