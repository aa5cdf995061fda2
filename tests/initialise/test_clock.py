"""The clocks' offset comes back from simulated scenes; where it cannot be known, that is said."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import InputError, RecordingError
from vip_factors.initialise.clock import find_clock_offset, find_drift
from vip_factors.initialise.clock_correlation import CorrelationCurve, LimbCurve, Pair
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.detections import Detections, simple_tracks
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import placed

OFFSET = 1.2345


def filmed(
    settings: SceneSettings, seed: int = 0, first: float = 6.0, last: float = 18.0, seconds: float = 24.0
) -> Scene:
    """A wearer and a bystander; the video is shorter than the recording."""
    motion = gestures(seconds)
    wearer = Performer("a", placed(motion, 0.3, (0, 0)), preset("tnt10", motion.skeleton))
    bystander = Performer("b", replace(placed(gestures(seconds + 2.0), 2.0, (1.5, 1.0)), rate=110.0))
    scene = simulate_scene([wearer, bystander], settings, seed)
    return seen_between(scene, first, last)


def seen_between(scene: Scene, first: float, last: float) -> Scene:
    seen = scene.camera.detections
    frames = (seen.time + OFFSET >= first) & (seen.time + OFFSET <= last)
    keep = frames[seen.frame]
    cut = Detections(
        seen.keypoints, seen.time[frames], (np.cumsum(frames) - 1)[seen.frame[keep]], seen.pixels[keep],
        seen.confidence[keep],
    )  # fmt: skip
    return replace(scene, cameras=(replace(scene.camera, detections=cut, truth=None),))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return filmed(SceneSettings(camera="hand-held", time_offset_s=OFFSET))


def test_motion_tells_the_offset(scene: Scene) -> None:
    found = find_clock_offset(scene, 4.0)
    assert found.seconds == pytest.approx(OFFSET, abs=0.02)
    assert found.curve.offset[np.argmax(found.curve.gain)] == pytest.approx(OFFSET, abs=0.025)
    if found.determined:
        assert abs(found.seconds - OFFSET) < 3 * found.sigma
        assert "ms" in found.sentence


def test_eight_keypoints_tell_the_offset() -> None:
    """Within a step: the steps of these gestures are all alike, and the arms that tell them apart are not seen."""
    scene = filmed(SceneSettings(camera="fixed", time_offset_s=OFFSET))
    detections = scene.camera.detections
    joints = ("shoulder", "hip", "knee", "ankle")
    given = np.array([name.split("_")[-1] in joints for name in detections.keypoints.keypoints])
    few = replace(detections, confidence=given * detections.confidence).shifted(OFFSET - 0.1)
    found = find_clock_offset(replace(scene, cameras=(replace(scene.camera, detections=few),)), 0.5)
    assert found.determined
    assert found.seconds == pytest.approx(0.1, abs=0.04)


def test_the_result_follows_the_video_clock(scene: Scene) -> None:
    moved = replace(scene, cameras=(replace(scene.camera, detections=scene.camera.detections.shifted(0.777)),))
    difference = find_clock_offset(scene, 3.0).seconds - find_clock_offset(moved, 3.0).seconds
    assert difference == pytest.approx(0.777, abs=0.002)


def test_without_errors_it_is_exact() -> None:
    scene = filmed(SceneSettings.noise_free(camera="fixed", time_offset_s=OFFSET), first=0.0, last=14.0, seconds=14.0)
    found = find_clock_offset(scene, 3.0)
    assert found.determined
    assert found.seconds == pytest.approx(OFFSET, abs=0.003)
    assert found.sigma < 0.02


def test_other_peoples_sensors_are_no_clock(scene: Scene) -> None:
    """The sensors lie on a table."""
    wearer = scene.wearers[0]
    still = {
        name: replace(stream, R_inertial_sensor=np.broadcast_to(np.eye(3), (len(stream), 3, 3)).copy())
        for name, stream in wearer.imus.items()
    }
    found = find_clock_offset(replace(scene, wearers=(replace(wearer, imus=still),)))
    assert not found.determined
    assert np.isinf(found.sigma)
    assert "undetermined" in found.sentence


COCO = keypoint_set("coco17")
BODY_PX = {"shoulder": (40, 100), "elbow": (60, 150), "wrist": (70, 200), "hip": (30, 220), "knee": (30, 310),
           "ankle": (30, 400), "ear": (10, 60), "eye": (6, 55)}  # fmt: skip


def standing(time: np.ndarray, rate: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """Video times and the pixels ``(F, 17, 2)`` of somebody who stands still."""
    video = np.arange(time[0], time[-1], 1 / rate)
    body = [(300.0, 60.0)]
    body += [(300 + (1 if n.startswith("left") else -1) * BODY_PX[n.split("_")[1]][0], BODY_PX[n.split("_")[1]][1])
             for n in COCO.keypoints[1:]]  # fmt: skip
    return video, np.repeat(np.array(body, float)[None], len(video), axis=0)


def test_nothing_to_compare(scene: Scene) -> None:
    with pytest.raises(RecordingError, match="no camera"):
        find_clock_offset(replace(scene, cameras=()))
    empty = scene.camera.detections.select(np.zeros(0, int))
    with pytest.raises(RecordingError, match="nobody is visible"):
        find_clock_offset(replace(scene, cameras=(replace(scene.camera, detections=empty, truth=None),)))
    with pytest.raises(InputError, match="max_offset"):
        find_clock_offset(scene, 0.0)


def test_tracks_follow_bodies_and_never_mix_them() -> None:
    video, body = standing(np.array([0.0, 6.0]))
    walk = np.stack([200 * (video - 3), 0 * video], axis=1)[:, None]
    pixels = np.stack([body, body + walk], axis=1).reshape(-1, 17, 2)
    frame = np.repeat(np.arange(len(video)), 2)
    lost = np.ones(len(frame), bool)
    lost[20:24] = False  # both, for two frames
    seen = Detections(COCO, video, frame[lost], pixels[lost], np.full((lost.sum(), 17), 0.8))
    tracks = simple_tracks(seen)
    assert len(tracks) >= 3
    for track in tracks:
        speed = np.diff(track.pixels[:, 0, 0]) / np.diff(track.time)
        assert np.allclose(speed, 0, atol=1e-6) or np.allclose(speed, 200, atol=1e-6)


@pytest.mark.parametrize("drift", [0.0, 4e-3])
def test_a_drift_is_found_in_stretches(drift: float) -> None:
    motion = gestures(28.0)
    settings = SceneSettings.noise_free(camera="fixed")
    scene = simulate_scene([Performer("a", motion, preset("sip6", motion.skeleton))], settings)
    seen = scene.camera.detections
    drifted = replace(seen, time=(seen.time - 0.5) / (1 + drift))
    found = find_drift(scene, scene.camera, simple_tracks(drifted), 0.5 + 14 * drift, stretch=4.0, max_drift=8e-3)
    assert found is not None
    assert found.matters == (drift > 0)
    assert found.per_second == pytest.approx(drift, abs=5e-4)
    assert found.seconds == pytest.approx(0.5 + drift * found.middle, abs=0.01)


@pytest.mark.slow
def test_a_drift_is_told_and_becomes_the_clocks() -> None:
    motion = gestures(64.0)
    settings = SceneSettings.noise_free(camera="fixed")
    scene = simulate_scene([Performer("a", motion, preset("sip6", motion.skeleton))], settings)
    seen = scene.camera.detections
    drifted = replace(scene.camera, detections=replace(seen, time=(seen.time - 0.5) / 1.001))
    found = find_clock_offset(replace(scene, cameras=(drifted,)), 1.5)
    assert found.determined
    assert "drifts by +6" in found.sentence  # 64 ms
    video = np.array([0.0, 32.0, 64.0])
    np.testing.assert_allclose(found.clock.at(video), 0.5 + 1.001 * video, atol=0.01)


def test_the_best_track_tells_how_much_sensors_explain() -> None:
    limbs = [[LimbCurve(0, "a", np.array([gain]), np.array([100.0]))] for gain in (50.0, 2.0)]
    pairs = tuple(Pair(track, 0, np.array([True])) for track in (0, 1))
    curve = CorrelationCurve(np.zeros(1), np.array([52.0]), limbs, pairs)
    assert curve.explained(0) == pytest.approx(1 - np.exp(-0.5))
