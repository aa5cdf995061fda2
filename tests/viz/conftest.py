"""A wearer, the truth and an estimate with errors, to be drawn."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.body.kinematics import Motion
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.recording import Recording


@dataclass(frozen=True)
class Scene:
    recording: Recording
    estimate: WearerEstimate
    truth: Motion


@pytest.fixture(scope="session")
def scene() -> Scene:
    """Of 90 frames; each joint of the estimate is off by some degrees that change slowly."""
    filmed = scene_sample(1.5)
    recording = filmed.wearers[0]
    estimate = estimate_of(filmed, Injected(yaw=0.7, shift=(1.0, 0.0, 0.2), mounting=0.1)).wearers[0]
    phase = np.arange(24)[:, None] * np.array([1.0, 2.0, 3.0])
    wobble = exp(0.09 * np.sin(0.5 * estimate.motion.time[:, None, None] + phase))
    motion = replace(estimate.motion, R_parent_child=estimate.motion.R_parent_child @ wobble)
    return Scene(recording, replace(estimate, motion=motion), recording.truth.motion)
