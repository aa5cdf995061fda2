"""A person walking in a circle, out of sines: enough to draw, and known exactly."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.estimate import Iteration, SolveReport, WearerEstimate
from vip_factors.geometry.rotations import exp, rotation_x, rotation_y, rotation_z, transpose
from vip_factors.sensors.calibration import SensorCalibration, preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject, Truth

R_WORLD_STANDING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # body y up, z along the world's x


@dataclass(frozen=True)
class Scene:
    recording: Recording
    estimate: WearerEstimate
    truth: Motion


def walking(frames: int, rate: float = 60.0) -> Motion:
    skeleton = skeleton_from_stature(1.75)
    t = np.arange(frames) / rate
    stride, turn = 2 * np.pi * 0.9 * t, 0.35 * t
    R = np.tile(np.eye(3), (frames, 24, 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = sign * np.sin(stride)
        R[:, joint_index(f"{side}_hip")] = rotation_x(-0.10 - 0.45 * swing)
        R[:, joint_index(f"{side}_knee")] = rotation_x(0.15 + 0.50 * (1 - sign * np.cos(stride)) / 2)
        R[:, joint_index(f"{side}_shoulder")] = rotation_z(np.full(frames, -sign * 1.25)) @ rotation_y(
            0.45 * np.sin(stride)
        )
        R[:, joint_index(f"{side}_elbow")] = rotation_y(-sign * (0.45 + 0.15 * swing))
    R[:, joint_index("spine2")] = rotation_y(0.12 * np.sin(stride))
    R[:, 0] = rotation_z(turn) @ R_WORLD_STANDING
    root = np.stack([3.2 * np.sin(turn), 3.2 * (1 - np.cos(turn)), 0.90 + 0.02 * np.cos(2 * stride)], axis=1)
    return Motion(skeleton, R, root, rate, name="walk in a circle")


def _noisy(truth: Motion) -> Motion:
    """Slow joint errors of some degrees, another heading of the world, and a root that drifts away."""
    t = truth.time
    phase = np.arange(len(JOINT_NAMES))[None, :, None] * np.array([1.0, 2.0, 3.0])
    wobble = 0.09 * np.sin(0.5 * t[:, None, None] + phase)
    R = truth.R_parent_child @ exp(wobble)
    gauge = rotation_z(0.7)
    R[:, 0] = gauge @ R[:, 0]
    root = truth.p_world_pelvis @ gauge.T + np.stack([1 + 0.05 * t, 0.02 * t, 0.01 * t], axis=1)
    return replace(truth, R_parent_child=R, p_world_pelvis=root)


def build(frames: int) -> Scene:
    truth = walking(frames)
    placement = preset("totalcapture13", truth.skeleton)
    g = np.array([0.0, 0.0, 9.81])
    imus, estimated, known = {}, {}, {}
    for index, site in enumerate(placement.sites):
        R_world_sensor = truth.state.R_world_bone[:, site.bone_index] @ site.R_bone_sensor
        p = truth.state.point(site.bone_index, site.p_bone_sensor)
        acceleration = np.gradient(np.gradient(p, 1 / truth.rate, axis=0), 1 / truth.rate, axis=0)
        force = np.einsum("tji,tj->ti", R_world_sensor, acceleration + g)
        heading = 0.1 * index - 0.5
        R_inertial_sensor = transpose(rotation_z(heading)) @ R_world_sensor
        imus[site.sensor] = ImuStream(site.sensor, truth.time, force, R_inertial_sensor)
        known[site.sensor] = SensorCalibration(heading, site.R_bone_sensor)
        estimated[site.sensor] = SensorCalibration(heading + 0.7 + 0.02, site.R_bone_sensor @ exp([0.1, 0, 0]), 0.03)
    subject = Subject("walker", 1.75)
    recording = Recording("circle", subject, imus, placement, "none", Truth(truth, known))
    sensors = tuple(imus)
    residuals = {
        "orientation_deg": 3 + 2 * np.sin(truth.time[:, None] + np.arange(13)),
        "acceleration_m_s2": 1.5 + np.cos(truth.time[:, None] * 2 + np.arange(13)),
    }
    report = SolveReport("full rate", (Iteration(10.0, 1e-3, True),), {"prior": 100.0}, {"prior": 10.0}, True, 1.2)
    estimate = WearerEstimate("circle", "SIP", _noisy(truth), estimated, None, residuals, sensors, (report,))
    return Scene(recording, estimate, truth)


@pytest.fixture(scope="session")
def scene() -> Scene:
    return build(90)
