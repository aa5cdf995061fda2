"""The frames of a scene meet the video's, coarse ones too."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.errors import RecordingError
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.stages.windows import WindowPlan, scene_plan


@pytest.fixture(scope="module")
def scene() -> Scene:
    motion = gestures(2.0)
    return simulate_scene([Performer("anna", motion, preset("sip6", motion.skeleton))], SceneSettings.noise_free())


@pytest.mark.parametrize(("wanted", "given"), [(60.0, 60.0), (50.0, 60.0), (15.0, 15.0), (20.0, 15.0)])
def test_a_whole_number_of_frames_goes_to_each_video_frame(scene: Scene, wanted: float, given: float) -> None:
    plan = scene_plan(SceneInMemory(scene), replace(Settings(), frame_rate=wanted, calibration_rate=wanted))
    assert plan.rate == pytest.approx(given)


@pytest.mark.parametrize("offset", [0.0, 0.0123, -0.4])
def test_coarse_frames_meet_video_frames(scene: Scene, offset: float) -> None:
    assert scene.camera is not None
    shifted = replace(scene, camera=replace(scene.camera, time_offset=offset))
    coarse = scene_plan(SceneInMemory(shifted), Settings()).all_coarse_time
    video = scene.camera.detections.time + offset
    nearest = np.abs(coarse[:, None] - video).min(axis=1)
    inside = (coarse >= video[0]) & (coarse <= video[-1])
    assert nearest[inside].max() < 1e-6


@pytest.mark.parametrize(
    "frames_of",
    [
        lambda scene: scene_plan(SceneInMemory(scene), Settings()),
        lambda scene: WindowPlan.of("walk", scene.wearers[0].interval, Settings()),
    ],
)
def test_a_sample_years_later_is_refused(scene: Scene, frames_of: Callable[[Scene], object]) -> None:
    wearer = scene.wearers[0]
    name, stream = next(iter(wearer.imus.items()))
    late = replace(stream, time=np.append(stream.time[:-1], 1e9))
    wearers = [replace(one, imus={**one.imus, name: late}) for one in (wearer, *scene.wearers[1:])]
    damaged = replace(scene, wearers=tuple(wearers))
    with pytest.raises(RecordingError, match=r"and 1e\+09 s: expected a day at most; .*'vip-factors info' tells"):
        frames_of(damaged)


def test_wearers_without_common_time_are_refused(scene: Scene) -> None:
    wearer = scene.wearers[0]
    late = {name: replace(stream, time=stream.time + 60.0) for name, stream in wearer.imus.items()}
    other = replace(wearer, imus=late, subject=replace(wearer.subject, name="bob"))
    with pytest.raises(RecordingError, match="all wearers together"):
        scene_plan(SceneInMemory(replace(scene, wearers=(wearer, other))), Settings())
