"""A recording with truth, made from any motion; sensors slide on their bones as strapped ones do.

A sprung mass stands for impacts, a slow random part for muscle and skin. The spring is excited by the bone's own
acceleration: with displacement d in the bone's frame, ``d̈ + 2ζω ḋ + ω² d = −a``. A natural frequency of 6 Hz and
10 m/s² give 7 mm, as skin markers on a thigh show.

Random processes, one value per sample of an evenly sampled stream, and events that last for a while.
"""

import zlib
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.special import ndtr

from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array, exp, right_jacobian, rotation_z, transpose
from vip_factors.sensors.calibration import Placement, SensorCalibration, SensorSite
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject, Truth
from vip_factors.simulate.dense import BoneKinematics, DenseMotion, dense_motion
from vip_factors.simulate.settings import SimulateSettings

GRID_HZ = 240.0  # where the response is computed before splining; over ten times the fastest spring
# Share of critical damping. With it a simulated walk departs from rigid bones by 1.3 (pelvis) to 2.5 m/s² (thigh), as
# do real Xsens sensors from the optical segments of a walk (1.4 at the pelvis, 1.9 to 2.5 at the limbs below 8 Hz).
DAMPING = 0.5
# Our spring frequency (Hz) and slow-motion share of a thigh's, by segment: soft thigh, firm shoe; order of magnitude
# from the review of Leardini et al. (2005), Gait & Posture 21(2), and vibration tests of Wakeling & Nigg (2001).
SEGMENTS = {
    "hip": (6.0, 1.0),
    "knee": (8.0, 0.7),
    "shoulder": (8.0, 0.9),
    "elbow": (9.0, 0.7),
    "pelvis": (8.0, 0.7),
    "spine1": (8.0, 0.8),
    "spine2": (9.0, 0.7),
    "spine3": (10.0, 0.6),
    "collar": (8.0, 0.9),
    "neck": (10.0, 0.6),
    "head": (12.0, 0.4),
    "wrist": (10.0, 0.6),
    "hand": (12.0, 0.5),
    "ankle": (14.0, 0.4),
    "foot": (14.0, 0.4),
}


def sensor_slide(
    dense: DenseMotion,
    bone: int,
    p_bone_sensor: Array,
    R_bone_sensor: Array,
    settings: SimulateSettings,
    random: np.random.Generator,
) -> tuple[BSpline, BSpline] | None:
    """How the sensor slides during the motion; None if the settings hold it still.

    Splines over time, in the bone's axes: a shift in metres, added to ``p_bone_sensor``, and a rotation vector:
    ``R_bone_sensor ← Exp(turn) R_bone_sensor``.
    """
    if not (settings.wobble or settings.skin):
        return None
    # Of a thigh, each axis; Leardini et al. 2005 report 5–30 mm. Muscles and skin follow the steps.
    skin_rad, skin_m, skin_time_s = np.deg2rad(2.0), 0.004, 0.5
    frequency, share = SEGMENTS[JOINT_NAMES[bone].removeprefix("left_").removeprefix("right_")]
    count = int(np.ceil((dense.end - dense.start) * GRID_HZ)) + 1
    time, step = np.linspace(dense.start, dense.end, count, retstep=True)
    sprung = settings.wobble * _sprung(dense.bone(bone, time), p_bone_sensor, frequency, float(step))
    # The box rocks about the axis across its outward direction (its z) and the shift: 4 degrees a centimetre, which is
    # 1 cm over its 15 cm strap.
    rocking = np.deg2rad(4.0) * 100 * np.cross(R_bone_sensor[:, 2], sprung)
    slow = settings.skin * smooth_process(random, count, float(step), share, skin_time_s, axes=6)
    shift = sprung + skin_m * slow[:, :3]
    turn = rocking + skin_rad * slow[:, 3:]
    return make_interp_spline(time, shift, 5), make_interp_spline(time, turn, 5)


def _sprung(state: BoneKinematics, p_bone_sensor: Array, frequency: float, step: float) -> Array:
    """Displacement ``(N, 3)`` in metres, bone axes, from rest at the first instant's constant acceleration."""
    _, _, acceleration = state.point(p_bone_sensor)
    drive = -np.einsum("nji,nj->ni", state.R_world_bone, acceleration)
    omega = 2 * np.pi * frequency
    system = (np.array([1.0]), np.array([1.0, 2 * DAMPING * omega, omega**2]))
    numerator, denominator, *_ = scipy.signal.cont2discrete(system, step, method="foh")
    lead = drive[0] / omega**2
    return np.asarray(scipy.signal.lfilter(numerator[0], denominator, drive - drive[0], axis=0)) + lead


GRAVITY = np.array([0.0, 0.0, -9.81])
WHITE_DEG, WHITE_FORCE = 0.3, 0.3  # a sample, degrees and m/s²: rounding and time stamps; noise and unmodelled shaking


def simulate_recording(
    motion: Motion | DenseMotion,
    placement: Placement,
    settings: SimulateSettings | None = None,
    seed: int = 0,
    name: str = "simulated",
    initial_pose: str = "none",
) -> Recording:
    """What the placed sensors would have recorded during a motion.

    Args:
        motion: densely sampled (100 Hz or more), low-passed and splined first; or its splines, which are the truth.
        placement: where the sensors were *meant* to sit; the recording carries this one, the truth the real one.
        settings: rates and errors; realistic ones if absent.
        seed: same seed, same recording. Each sensor draws from its own stream, found by its name, and each kind of
            error from its own: adding a sensor or an error leaves the rest as it was.
        name: of the recording.
        initial_pose: that the wearer declares to hold at the start (``staging.with_initial_pose`` makes one).

    Raises:
        InputError: for a motion of fewer than 8 frames, or of less than two IMU periods.
    """
    truth_rate = 60.0  # Hz of the true motion: the frame rate of TotalCapture and of most video
    settings = settings or SimulateSettings()
    dense = motion if isinstance(motion, DenseMotion) else dense_motion(motion, settings.lowpass_hz)
    imus, calibration = {}, {}
    for site in placement.sites:
        imus[site.sensor], calibration[site.sensor] = simulate_sensor(dense, site, settings, seed)
    subject = Subject(stature_m=stature_of(dense.skeleton), skeleton=dense.skeleton)
    truth = Truth(dense.sample(truth_rate), calibration)
    notes = f"simulated from motion '{dense.name}', seed {seed}"
    return Recording(name, subject, imus, placement, initial_pose, truth, notes)


def simulate_sensor(
    dense: DenseMotion, site: SensorSite, settings: SimulateSettings, seed: int
) -> tuple[ImuStream, SensorCalibration]:
    """The stream of one sensor, and its true calibration (heading at the start of the motion)."""
    names = ("phase", "heading", "drift", "mounting", "slide", "filter", "acceleration", "gyro", "packets")
    children = np.random.SeedSequence([seed, zlib.crc32(site.sensor.encode())]).spawn(len(names))
    random = {name: np.random.default_rng(child) for name, child in zip(names, children, strict=True)}

    offset = random["phase"].uniform() / settings.imu_rate if settings.phases else 0.0
    count = int(np.floor((dense.end - dense.start - offset) * settings.imu_rate + 1e-6)) + 1
    time = dense.start + offset + np.arange(count) / settings.imu_rate
    turn, shift = random["mounting"].standard_normal((2, 3))
    R_bone_sensor = site.R_bone_sensor @ exp(np.deg2rad(settings.mounting_error_deg) * turn)
    p_bone_sensor = site.p_bone_sensor + settings.position_error_m * shift
    slide = sensor_slide(dense, site.bone_index, p_bone_sensor, R_bone_sensor, settings, random["slide"])
    R_world_sensor, force, rate = _ideal(dense.bone(site.bone_index, time), time, p_bone_sensor, R_bone_sensor, slide)

    heading = float(np.deg2rad(random["heading"].uniform(-1, 1) * settings.heading_offset_deg))
    drift = random_walk(random["drift"], count, 1 / settings.imu_rate, np.deg2rad(settings.heading_drift_deg))
    R_inertial_sensor = _attitude(R_world_sensor, heading + drift, settings, random["filter"])
    # 5 mg of bias are usual without a tumble calibration. Of gyroscopes MEMS have 0.01 °/s/√Hz, range and shaking add;
    # their bias is that after a usual still period.
    force = force + _error(random["acceleration"], count, settings, WHITE_FORCE, 0.05)
    rate = rate + _error(random["gyro"], count, settings, np.deg2rad(0.5), np.deg2rad(0.1))

    is_received = received(random["packets"], count, settings.imu_rate, settings.packet_loss, settings.gap_s)
    angular_rate = rate[is_received] if settings.angular_rate else None
    stream = ImuStream(site.sensor, time[is_received], force[is_received], R_inertial_sensor[is_received], angular_rate)
    samples, step_s = np.zeros(0, int), 1.0  # of the heading that the true calibration keeps: it drifts over minutes
    if np.any(drift != drift[0]):
        every = max(1, round(step_s * (count - 1) / (time[-1] - time[0])))
        samples = np.unique([*range(0, count, every), count - 1])
    calibration = SensorCalibration(heading, R_bone_sensor, bone=site.bone)
    return stream, replace(calibration, heading_time=time[samples], heading_path=(heading + drift)[samples])


def _ideal(
    bone: BoneKinematics, time: Array, p_bone_sensor: Array, R_bone_sensor: Array, slide: tuple[BSpline, BSpline] | None
) -> tuple[Array, Array, Array]:
    """Orientation in the world, specific force and angular rate (sensor axes) of a perfect sensor on the bone."""
    rate_bone = _into(bone.R_world_bone, bone.rate)
    if slide is None:
        _, _, acceleration = bone.point(p_bone_sensor)
        R_world_sensor = bone.R_world_bone @ R_bone_sensor
        rate = rate_bone @ R_bone_sensor
    else:
        shift, turns = slide
        turn, turn_rate = turns(time), turns.derivative(1)(time)
        moved = p_bone_sensor + shift(time)
        _, _, acceleration = bone.point(moved, shift.derivative(1)(time), shift.derivative(2)(time))
        R_world_sensor = bone.R_world_bone @ exp(turn) @ R_bone_sensor
        rate = _into(exp(turn), rate_bone) + np.einsum("nij,nj->ni", right_jacobian(turn), turn_rate)
        rate = rate @ R_bone_sensor
    return R_world_sensor, _into(R_world_sensor, acceleration - GRAVITY), rate


def _attitude(R_world_sensor: Array, heading: Array, settings: SimulateSettings, random: np.random.Generator) -> Array:
    """``R_inertial_sensor``: the sensor's own estimate, in its own world turned by a heading that drifts."""
    sigma = np.deg2rad([1.0, 1.0, 2.5])  # data sheets say 0.5–1 of tilt, which gravity holds, and 1.5–2.5 of heading
    average_s = 1.5  # attitude filters average gravity over about a second
    count, step = len(R_world_sensor), 1 / settings.imu_rate
    error = gauss_markov(random, count, step, settings.attitude_error * sigma, average_s)
    error += settings.white_noise * np.deg2rad(WHITE_DEG) * random.standard_normal((count, 3))
    return transpose(rotation_z(heading)) @ exp(error) @ R_world_sensor


def _error(random: np.random.Generator, count: int, settings: SimulateSettings, white: float, bias: float) -> Array:
    warming_s = 100.0  # biases follow the temperature
    slow = gauss_markov(random, count, 1 / settings.imu_rate, settings.bias * bias, warming_s)
    return slow + settings.white_noise * white * random.standard_normal((count, 3))


def _into(R: Array, v: Array) -> Array:
    """``Rᵀ v`` of stacks ``(N, 3, 3)`` and ``(N, 3)``."""
    return np.einsum("nji,nj->ni", R, v)


def gauss_markov(
    random: np.random.Generator, count: int, step: float, sigma: Array | float, time_constant: float, axes: int = 3
) -> Array:
    """First-order Gauss–Markov process ``(count, axes)``: autocorrelation ``sigma² exp(−|Δt|/time_constant)``.

    It starts in its stationary distribution. ``step`` and ``time_constant`` in seconds; ``sigma`` per axis.
    """
    keep = np.exp(-step / time_constant)
    drive = random.standard_normal((count, axes)) * np.sqrt(1 - keep**2)
    drive[:1] /= np.sqrt(1 - keep**2)
    return np.asarray(sigma) * scipy.signal.lfilter([1.0], [1.0, -keep], drive, axis=0)


def smooth_process(
    random: np.random.Generator, count: int, step: float, sigma: Array | float, time_constant: float, axes: int = 3
) -> Array:
    """Matérn-5/2 process ``(count, axes)``: its paths have a velocity and an acceleration of finite variance.

    Autocorrelation ``sigma² (1 + x + x²/3) exp(−x)`` with ``x = √5 |Δt| / time_constant``; a first-order process,
    used as a position, would shake with an acceleration that grows without bound with the sampling rate.
    """
    keep = np.exp(-np.sqrt(5) * step / time_constant)
    pole = [1.0, -3 * keep, 3 * keep**2, -(keep**3)]
    settle = int(np.ceil(6 * time_constant / step))
    response = scipy.signal.lfilter([1.0], pole, np.eye(1, settle)[0])
    drive = random.standard_normal((settle + count, axes))
    path = scipy.signal.lfilter([1.0], pole, drive, axis=0)[settle:]
    return np.asarray(sigma) * path / np.linalg.norm(response)


def random_walk(random: np.random.Generator, count: int, step: float, sigma_per_root_minute: float) -> Array:
    """Random walk ``(count,)`` from zero; after a minute its standard deviation is ``sigma_per_root_minute``."""
    moves = random.standard_normal(count) * sigma_per_root_minute * np.sqrt(step / 60)
    moves[:1] = 0.0
    return np.cumsum(moves)


def received(
    random: np.random.Generator, count: int, rate: float, packet_loss: float, gap_s: float
) -> NDArray[np.bool_]:
    """Which of ``count`` samples arrive, ``(count,)`` bool: single losses and one longer gap, never the ends."""
    arrives = random.random(count) >= packet_loss
    length = round(gap_s * rate)
    start = random.random()  # drawn always, so that one setting does not shift the draws of another
    if 0 < length < count - 2:
        gap_start = 1 + int(start * (count - 2 - length))
        arrives[gap_start : gap_start + length] = False
    arrives[[0, -1]] = True
    return arrives


def lasting_chance(random: np.random.Generator, count: int, step: float, lasts_s: float, axes: int = 1) -> Array:
    """Numbers ``(count, axes)``, each uniform in [0, 1] but changing slowly: what has chance ``p`` happens at ``< p``.

    With a chance of a few per cent, what happens lasts for about ``0.8 lasts_s`` on average: so long does a smooth
    Gaussian process (:func:`smooth_process`) stay beyond two sigmas (Rice's formula).
    """
    return np.asarray(ndtr(smooth_process(random, count, step, 1.0, lasts_s, axes)))
