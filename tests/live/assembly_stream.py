"""Small streams made by hand: sensors that turn smoothly, at even times."""

from collections.abc import Iterable

import numpy as np

from vip_factors.body.keypoints import keypoint_set
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import exp
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.frames import LiveFrame
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame
from vip_factors.sensors.scene import Camera

RATE = 60.0
CAMERA = Camera(
    "phone", CameraModel(1280, 720, (900.0, 900.0), (640.0, 360.0)), Detections.none(keypoint_set("openpose18"))
)
COLUMNS = [("Ada", "hip"), ("Ada", "wrist"), ("Bo", "hip")]


def sample(column: tuple[str, str], time: float, stamp: float | None = None) -> ImuSample:
    """What a sensor measures at ``time``; its clock may say otherwise."""
    phase = float(COLUMNS.index(column)) if column in COLUMNS else 0.0
    R = exp(np.array([np.sin(time + phase), 0.5 * np.cos(2 * time), 0.3 * time]))
    force = np.array([np.sin(7 * time), phase, 9.81])
    return ImuSample(column[0], column[1], time if stamp is None else stamp, R, force)


def stream(
    start: float, end: float, columns: Iterable[tuple[str, str]] = COLUMNS, rate: float = RATE
) -> list[ImuSample]:
    """Samples at whole periods in ``[start, end)``, all sensors in step."""
    periods = range(round(start * rate), round(end * rate))
    return [sample(column, period / rate) for period in periods for column in columns]


def video(time: float, people: int = 1) -> VideoFrame:
    return VideoFrame("phone", time, np.full((people, 18, 2), 300.0), np.ones((people, 18)))


def assemble(samples: Iterable[LiveSample], assembler: FrameAssembler, flush: bool = True) -> list[LiveFrame]:
    frames = [frame for sample in samples for frame in assembler.push(sample)]
    return frames + (assembler.flush() if flush else [])


def findings_of(assembler: FrameAssembler) -> tuple[str, ...]:
    """What it has to say, as text."""
    return sentences(assembler.take_findings())


def in_time(*parts: Iterable[LiveSample]) -> list[LiveSample]:
    """All of them in the order of their times."""
    return sorted((one for part in parts for one in part), key=lambda one: one.time)


def assert_same(first: list[LiveFrame], second: list[LiveFrame], atol: float = 1e-12) -> None:
    assert [frame.number for frame in first] == [frame.number for frame in second]
    for name in (
        "time",
        "R_inertial_sensor",
        "orientation_valid",
        "specific_force_before",
        "acceleration_valid_before",
    ):
        a, b = (np.array([getattr(frame, name) for frame in frames]) for frames in (first, second))
        np.testing.assert_allclose(a, b, atol=atol, err_msg=name)
