"""A silence of all sensors at once: the wearer coasts through it, on a stream as in a recording."""

from dataclasses import replace

import numpy as np
import pytest
from tracked import QUICK, RATE, filmed, poses, track

from vip_factors.evaluate.metrics import common_frames, mpjpe
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import ImuSample, live_samples
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings

START, END = 2.0, 3.0  # s


@pytest.mark.parametrize("silent", [object, ImuSample])
def test_a_stream_is_tracked_through_a_silence(silent: type) -> None:
    samples = live_samples(filmed())
    one = track(filmed(), (s for s in samples if not (isinstance(s, silent) and START <= s.time < END)), QUICK)
    assert "tracking" not in one.findings  # neither lost nor started again
    assert [answer.frame for answer in one.answers] == list(range(len(one.answers)))
    assert len(one.answers) == round(4.0 * RATE) - 1
    coasting = [pose.p_world_pelvis for pose in poses(one.answers, "newest") if START < pose.time < END]
    assert speed(np.stack(coasting)) < 4.0
    assert one.error_mm("smoothed", after=END + 0.3) < 60


def test_a_recording_is_smoothed_through_a_silence() -> None:
    motion = gestures(4.0)
    placement, sensors = preset("sip6", motion.skeleton), SimulateSettings.noise_free(heading_offset_deg=0.0)
    whole = simulate_recording(motion, placement, sensors, seed=2)
    whole = replace(whole, subject=Subject(skeleton=motion.skeleton))
    silent = replace(whole, imus={name: with_silence(stream) for name, stream in whole.imus.items()})
    settings = Settings(
        frame_rate=20.0, calibration_rate=10.0, covariance=False, calibration=CalibrationSettings(passes=1)
    )
    error, root = smoothed(silent, settings)
    known, _ = smoothed(whole, settings)
    assert error < known + 40
    assert speed(root, settings.frame_rate) < 4.0


def with_silence(stream: ImuStream) -> ImuStream:
    kept = (stream.time < START) | (stream.time >= END)
    parts = (stream.specific_force, stream.R_inertial_sensor, stream.angular_rate)
    return ImuStream(stream.name, stream.time[kept], *[None if part is None else part[kept] for part in parts])


def smoothed(recording: Recording, settings: Settings) -> tuple[float, np.ndarray]:
    """Error in millimetres, and the root's path."""
    assert recording.truth is not None
    motion = smooth(recording, settings).wearer().motion
    ours, truth, _ = common_frames(motion, recording.truth.motion)
    return mpjpe(ours, truth), motion.p_world_pelvis


def speed(p_world_pelvis: np.ndarray, rate: float = RATE) -> float:
    """The highest, m/s."""
    return float(np.linalg.norm(np.diff(p_world_pelvis, axis=0), axis=1).max()) * rate
