"""The pipeline on small simulated recordings: what it promises, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.errors import InputError, RecordingError
from vip_factors.estimate import WearerEstimate
from vip_factors.evaluate.metrics import common_frames, mpjpe
from vip_factors.factor_settings import InitialPoseSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Placement, preset
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import CalibrationSettings, Settings, flatten
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose

QUICK = Settings(frame_rate=15.0, covariance=False, calibration=CalibrationSettings(passes=1))


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = with_initial_pose(gestures(4.0), "n-pose", hold_s=1.0)
    sensors = SimulateSettings.noise_free(heading_offset_deg=30.0)
    placement = preset("totalcapture13", motion.skeleton)
    made = simulate_recording(motion, placement, sensors, seed=4, initial_pose="n-pose")
    return replace(made, subject=Subject(skeleton=motion.skeleton))


@pytest.fixture(scope="module")
def estimate(recording: Recording) -> WearerEstimate:
    return smooth(recording, QUICK).wearer()


def error_mm(recording: Recording, settings: Settings) -> float:
    return mpjpe_of(smooth(recording, settings).wearer(), recording)


def mpjpe_of(estimate: WearerEstimate, recording: Recording) -> float:
    assert recording.truth is not None
    ours, truth, _ = common_frames(estimate.motion, recording.truth.motion)
    return mpjpe(ours, truth)


def test_perfect_sensors_are_not_made_worse_by_the_calibration(recording: Recording) -> None:
    as_called = replace(QUICK.factors, initial_pose=InitialPoseSettings(nominal=True))  # as it is held there
    found = replace(QUICK, factors=as_called)
    known = replace(QUICK, calibration=CalibrationSettings(False, False, from_truth=True, passes=1))
    assert error_mm(recording, found) < error_mm(recording, known) + 10.0


def test_turning_all_sensors_turns_nothing_else(recording: Recording, estimate: WearerEstimate) -> None:
    """The wearer faces x at the start whatever the sensors call north."""
    from vip_factors.geometry.rotations import rotation_z

    imus = {
        name: replace(stream, R_inertial_sensor=rotation_z(1.0) @ stream.R_inertial_sensor)
        for name, stream in recording.imus.items()
    }
    other = smooth(replace(recording, imus=imus), QUICK).wearer()
    np.testing.assert_allclose(other.motion.R_parent_child, estimate.motion.R_parent_child, atol=5e-3)


def test_a_strap_put_on_back_to_front_does_not_turn_the_wearer_round(
    recording: Recording, estimate: WearerEstimate
) -> None:
    """Every rough mounting half a turn wrong about the vertical of the N-pose: the motion tells."""
    from vip_factors.body.kinematics import forward_kinematics
    from vip_factors.body.skeleton import calibration_pose
    from vip_factors.geometry.rotations import rotation_z

    bones = forward_kinematics(recording.subject.body(), calibration_pose("n-pose")[None], np.zeros((1, 3)))
    sites = []
    for site in recording.placement.sites:
        R = bones.R_world_bone[0, site.bone_index]
        sites.append(replace(site, R_bone_sensor=R.T @ rotation_z(np.pi) @ R @ site.R_bone_sensor))
    wrong = replace(recording, placement=Placement(tuple(sites)))
    assert error_mm(wrong, QUICK) < mpjpe_of(estimate, recording) + 10.0


def test_covariance_grows_where_no_sensor_is(recording: Recording) -> None:
    estimate = smooth(recording, replace(QUICK, covariance=True)).wearer()
    assert estimate.covariance is not None
    sigma = np.rad2deg(estimate.covariance.joint_sigma).mean(axis=0)
    assert np.all(np.isfinite(sigma))
    hand, hip = 22, 1
    assert sigma[hand] > sigma[hip]


def test_a_sensor_that_stops_halfway_leaves_the_rest(recording: Recording) -> None:
    stream = recording.imus["left_shank"]
    cut = {**recording.imus, "left_shank": stream.cut(0.0, 3.0)}
    estimate = smooth(replace(recording, imus=cut), QUICK).wearer()
    column = estimate.sensors.index("left_shank")
    assert np.isnan(estimate.residuals["orientation_deg"][-1, column])
    assert np.all(np.isfinite(estimate.motion.R_parent_child))


def test_the_method_is_named_after_what_was_used(recording: Recording) -> None:
    tracked = smooth(recording, replace(QUICK, acceleration=False)).wearer()
    assert tracked.method == "IT"
    assert "acceleration_m_s2" not in tracked.residuals
    assert tracked.settings["frame_rate"] == "15.0"


def test_what_cannot_be_used_is_refused(recording: Recording) -> None:
    with pytest.raises(RecordingError, match="placed on"):
        smooth(replace(recording, placement=Placement()), QUICK)
    with pytest.raises(InputError, match="true calibration"):
        smooth(replace(recording, truth=None), replace(QUICK, calibration=CalibrationSettings(from_truth=True)))


def test_every_setting_is_told() -> None:
    told = flatten(Settings())
    assert told["factors.orientation.sigma_deg"] == "4.0"
    assert "solve.max_iterations" in told
