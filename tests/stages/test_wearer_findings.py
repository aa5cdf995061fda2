"""What is told of wearers by whole scenes in which it is so; the rest of the findings is in test_findings."""

import re
from dataclasses import replace
from functools import cache

import pytest
from filmed_gestures import HASTY, QUICK, filmed_gestures, with_detections

from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings


@cache
def before_two_known_cameras() -> Scene:
    """Where two cameras of known pose see somebody, the pictures tell how large that person is."""
    motion = gestures(3.0)
    settings = SceneSettings.realistic(camera="fixed", cameras=2, azimuth_deg=20.0)
    return simulate_scene([Performer("anna", motion, preset("tnt10", motion.skeleton))], settings, seed=1)


def of_stature(scene: Scene, stature_m: float) -> Scene:
    (wearer,) = scene.wearers
    subject = replace(wearer.subject, stature_m=stature_m, skeleton=None)
    return replace(scene, wearers=(replace(wearer, subject=subject),), truth=None)


@pytest.mark.parametrize(("stature_m", "told"), [(1.60, "larger than one of 1.60 m"), (1.75, None)])
def test_a_wrong_stature(stature_m: float, told: str | None) -> None:
    findings = smooth_scene(of_stature(before_two_known_cameras(), stature_m), QUICK).findings
    of_bodies = [one for one in findings if "stature and pictures disagree" in one]
    assert bool(of_bodies) == (told is not None), findings
    assert told is None or told in of_bodies[0]


def test_somebody_who_is_seen_for_a_moment() -> None:
    scene = with_detections(
        filmed_gestures(azimuth_deg=20.0), lambda found: found.select(found.time[found.frame] < 1.5)
    )
    (told,) = smooth_scene(scene, HASTY).findings
    assert re.search(r"'anna' is seen for 1\.[45] s only", told)


def test_few_keypoints_are_enough_for_the_whole_pipeline() -> None:
    def few(joints: tuple[str, ...]) -> Scene:
        def dropped(found):
            names = found.keypoints.keypoints
            gone = [number for number, name in enumerate(names) if name.split("_")[-1] not in joints]
            confidence = found.confidence.copy()
            confidence[:, gone] = 0.0
            return replace(found, confidence=confidence)

        return with_detections(filmed_gestures(azimuth_deg=20.0), dropped)

    assert smooth_scene(few(("shoulder", "hip", "knee", "ankle")), HASTY).method == "VIP"
    refused = smooth_scene(few(("shoulder", "hip")), HASTY)
    assert refused.method == "SIP"
    assert "add knee and ankle" in refused.findings[0]
    assert not any("clock" in one for one in refused.findings)
