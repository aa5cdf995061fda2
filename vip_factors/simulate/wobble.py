"""How a strapped sensor moves on its bone: a sprung mass for impacts, a slow random part for muscle and skin.

The spring is excited by the bone's own acceleration: with displacement d in the bone's frame,
``d̈ + 2ζω ḋ + ω² d = −a``. A natural frequency of 6 Hz and 10 m/s² give 7 mm, as skin markers on a thigh show.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import cont2discrete, lfilter

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array
from vip_factors.simulate.dense import BoneKinematics, DenseMotion
from vip_factors.simulate.noise import smooth_process
from vip_factors.simulate.settings import SimulateSettings

GRID_HZ = 240.0  # where the response is computed before splining; over ten times the fastest spring
# Share of critical damping. With it a simulated walk departs from rigid bones by 1.3 (pelvis) to 2.5 m/s² (thigh), as
# do real Xsens sensors from the optical segments of a walk (1.4 at the pelvis, 1.9 to 2.5 at the limbs below 8 Hz).
DAMPING = 0.5
# Our spring frequency (Hz) and slow-motion share of a thigh's, by segment: soft thigh, firm shoe; order of magnitude
# from the review of Leardini et al. (2005), Gait & Posture 21(2), and vibration tests of Wakeling & Nigg (2001).
SEGMENTS = {
    "hip": (6.0, 1.0), "knee": (8.0, 0.7), "shoulder": (8.0, 0.9), "elbow": (9.0, 0.7), "pelvis": (8.0, 0.7),
    "spine1": (8.0, 0.8), "spine2": (9.0, 0.7), "spine3": (10.0, 0.6), "collar": (8.0, 0.9), "neck": (10.0, 0.6),
    "head": (12.0, 0.4), "wrist": (10.0, 0.6), "hand": (12.0, 0.5), "ankle": (14.0, 0.4), "foot": (14.0, 0.4),
}  # fmt: skip


@dataclass(frozen=True)
class SensorSlide:
    """Motion of a sensor on its bone, as splines over time.

    Attributes:
        shift: metres in the bone's axes, added to ``p_bone_sensor``.
        turn: rotation vector in the bone's axes: ``R_bone_sensor ← Exp(turn) R_bone_sensor``.
    """

    shift: BSpline
    turn: BSpline


def sensor_slide(
    dense: DenseMotion, bone: int, p_bone_sensor: Array, R_bone_sensor: Array, settings: SimulateSettings,
    random: np.random.Generator,
) -> SensorSlide | None:  # fmt: skip
    """How the sensor slides during the motion; None if the settings hold it still."""
    if not (settings.wobble or settings.skin_deg or settings.skin_m):
        return None
    frequency, share = SEGMENTS[JOINT_NAMES[bone].removeprefix("left_").removeprefix("right_")]
    count = int(np.ceil((dense.end - dense.start) * GRID_HZ)) + 1
    time, step = np.linspace(dense.start, dense.end, count, retstep=True)
    sprung = settings.wobble * _sprung(dense.bone(bone, time), p_bone_sensor, frequency, float(step))
    # The box rocks about the axis across its outward direction (its z) and the shift.
    rocking = np.deg2rad(settings.wobble_tilt_deg_per_cm) * 100 * np.cross(R_bone_sensor[:, 2], sprung)
    slow = smooth_process(random, count, float(step), share, settings.skin_time_s, axes=6)
    shift = sprung + settings.skin_m * slow[:, :3]
    turn = rocking + np.deg2rad(settings.skin_deg) * slow[:, 3:]
    return SensorSlide(make_interp_spline(time, shift, 5), make_interp_spline(time, turn, 5))


def _sprung(state: BoneKinematics, p_bone_sensor: Array, frequency: float, step: float) -> Array:
    """Displacement ``(N, 3)`` in metres, bone axes, from rest at the first instant's constant acceleration."""
    _, _, acceleration = state.point(p_bone_sensor)
    drive = -np.einsum("nji,nj->ni", state.R_world_bone, acceleration)
    omega = 2 * np.pi * frequency
    system = (np.array([1.0]), np.array([1.0, 2 * DAMPING * omega, omega**2]))
    numerator, denominator, *_ = cont2discrete(system, step, method="foh")
    lead = drive[0] / omega**2
    return np.asarray(lfilter(numerator[0], denominator, drive - drive[0], axis=0)) + lead
