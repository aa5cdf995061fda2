"""Realistic scenes of the package's gestures, short enough to be solved in seconds, and what may happen to them."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from vip_factors.sensors.calibration import preset
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.settings import AssignmentSettings, CalibrationSettings, FusionSettings, Settings, StartSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings, SimulateSettings
from vip_factors.simulate.staging import from_time, placed

QUICK = Settings(frame_rate=15.0, covariance=False)
# For what cameras show: begun with the straps and the low-passed motion alone.
FROM_STRAPS = replace(
    QUICK,
    assignment=AssignmentSettings(check=False),
    calibration=CalibrationSettings(start=StartSettings(search=False)),
)
# As much as findings need that are made before the last solve: one round of association, a few steps.
HASTY = replace(
    FROM_STRAPS,
    fusion=FusionSettings(rounds=1, refits=0),
    solve=replace(QUICK.solve, max_iterations=2),
)


@cache
def filmed_gestures(
    camera: CameraKind = "fixed", seconds: float = 4.0, people: tuple[str, ...] = ("anna",), in_step: bool = False,
    backwards: bool = False, mounting_error_deg: float | None = None, time_offset_s: float = 0.0,
    azimuth_deg: float | None = None, seed: int = 1,
) -> Scene:  # fmt: skip
    """Wearers of ten sensors, a metre and a half from each other, in front of a realistic detector.

    Args:
        camera: kind of it.
        seconds: that the scene lasts.
        people: names of the wearers.
        in_step: all make the same gestures at the same time; else each begins 3.7 s later in them.
        backwards: whether all but the first make the gestures from the end to the beginning.
        mounting_error_deg: each axis; the simulator's own if None.
        time_offset_s: of the video's clock.
        azimuth_deg: from where the camera looks; drawn if None.
        seed: of all errors.
    """
    performers = []
    for number, name in enumerate(people):
        late = 0.0 if in_step else 3.7 * number
        motion = from_time(gestures(seconds + late), late)
        if backwards and number:
            R, p = motion.R_parent_child[::-1].copy(), motion.p_world_pelvis[::-1].copy()
            motion = replace(motion, R_parent_child=R, p_world_pelvis=p)
        motion = placed(motion, 0.3 + 0.6 * number, (1.5 * number, 0.5 * number))
        performers.append(Performer(name, motion, preset("tnt10", motion.skeleton)))
    imu = SimulateSettings()
    if mounting_error_deg is not None:
        imu = replace(imu, mounting_error_deg=mounting_error_deg)
    settings = SceneSettings(camera=camera, imu=imu, time_offset_s=time_offset_s, azimuth_deg=azimuth_deg)
    return simulate_scene(performers, settings, seed=seed)


def camera_of(scene: Scene) -> Camera:
    assert scene.camera is not None
    return scene.camera


def with_detections(scene: Scene, change: Callable[[Detections], Detections]) -> Scene:
    """The scene with other detections; it no longer knows whose they are."""
    camera = camera_of(scene)
    return replace(scene, cameras=(replace(camera, detections=change(camera.detections), truth=None),))


def without_detections(scene: Scene, start: float, end: float, wearer: int | None = None) -> Scene:
    """Nothing was detected between two instants: of anybody, or of one wearer."""
    camera, truth = camera_of(scene), scene.camera.truth
    assert truth is not None
    time = camera.detections.time[camera.detections.frame]
    gone = (time >= start) & (time <= end)
    if wearer is not None:
        gone &= truth.wearer == wearer
    assert truth.pixels is not None
    kept = replace(truth, wearer=truth.wearer[~gone], pixels=truth.pixels[~gone])
    return replace(scene, cameras=(replace(camera, detections=camera.detections.select(~gone), truth=kept),))


def spliced(first: Detections, second: Detections) -> Detections:
    """The first half of one video and the second half of another."""
    half = len(first.time) // 2
    before, after = first.frame < half, second.frame >= half
    return replace(
        first,
        frame=np.concatenate([first.frame[before], second.frame[after]]),
        pixels=np.concatenate([first.pixels[before], second.pixels[after]]),
        confidence=np.concatenate([first.confidence[before], second.confidence[after]]),
    )


def enlarged(detections: Detections, factor: float, centre: tuple[float, float]) -> Detections:
    """The second half of the video zoomed about the middle of the image."""
    pixels, late = detections.pixels.copy(), detections.frame >= len(detections.time) // 2
    pixels[late] = (pixels[late] - centre) * factor + centre
    return replace(detections, pixels=pixels)
