"""Ranges between two wearers' pelvises, as radio tags measure them: in batch and live."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from filmed_gestures import HASTY, QUICK, filmed_gestures

from vip_factors.errors import InputError
from vip_factors.factor_graph.keys import root_key
from vip_factors.geometry.rotations import Array
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.pipeline import smooth
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings

METRES = 3.0  # twice as far as they are apart: nothing but the ranges can say so


def ranges(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Isotropic.Sigma(1, 0.01)
    for frame in range(first, first + len(time)):
        graph.push_back(gtsam.CustomFactor(noise, [root_key(frame), root_key(frame, wearer=1)], range_error))
    return graph


def range_error(this: gtsam.CustomFactor, values: gtsam.Values, H: list[Array] | None) -> Array:
    p, q = (values.atPoint3(key) for key in list(this.keys()))
    length = float(np.linalg.norm(p - q))
    if H is not None:
        H[0] = np.asfortranarray(((p - q) / length)[None])
        H[1] = -H[0]
    return np.array([length - METRES])


@cache
def two() -> Scene:
    return filmed_gestures("fixed", 1.5, ("anna", "bea"))


def test_in_batch() -> None:
    settings = replace(HASTY, solve=replace(HASTY.solve, max_iterations=8))
    estimate = smooth(two(), settings, extra_factors=ranges)
    apart = np.subtract(*(one.motion.p_world_pelvis for one in estimate.wearers))
    assert np.linalg.norm(apart, axis=1) == pytest.approx(METRES, abs=0.1)


def test_live() -> None:
    tracker = FixedLagTracker(stream_head(two()), LiveSettings(frame_rate=15.0), ranges)
    answers = [answer for sample in live_samples(two()) for answer in tracker.push(sample)]
    p, q = (one.newest.p_world_pelvis for one in answers[-1].wearers)
    assert np.linalg.norm(p - q) == pytest.approx(METRES, abs=0.15)


def test_without_a_camera_wearers_have_no_world_in_common() -> None:
    with pytest.raises(InputError, match="need a camera that sees them"):
        smooth(Scene("unfilmed", two().wearers), QUICK, extra_factors=ranges)
