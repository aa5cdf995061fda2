"""Sensors looked over before anything is estimated: accelerometers by themselves, clocks against one another."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.joint_limits import load_joint_limits
from vip_factors.body.pose_prior import load_pose_prior
from vip_factors.initialise.accelerometers import AccelerometerSettings, accelerometer_scale, clipped_samples
from vip_factors.initialise.sensor_delays import SensorClockSettings, SensorDelay, sensor_delays
from vip_factors.initialise.sensor_tree import sensor_tree
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings


def checked_scene(scene: Scene, settings: Settings) -> tuple[Scene, tuple[str, ...]]:
    """The scene with all wearers' sensors put right, and what was found."""
    found = [checked(wearer, settings) for wearer in scene.wearers]
    wearers = tuple(recording for recording, _ in found)
    return replace(scene, wearers=wearers), tuple(sentence for _, sentences in found for sentence in sentences)


def checked(recording: Recording, settings: Settings) -> tuple[Recording, tuple[str, ...]]:
    """The recording with its placed sensors put right where that can be done, and sentences on what was found."""
    who = f"wearer '{recording.subject.name}'"
    imus, findings = dict(recording.imus), []
    if settings.accelerometers.check:
        for name in recording.placed:
            imus[name], sentences = _accelerometer(who, imus[name], settings.accelerometers)
            findings += sentences
    if settings.sensor_clocks.check:
        delays = _delays(replace(recording, imus=imus), settings)
        for one in delays:
            name = recording.placed[one.sensor]
            if settings.sensor_clocks.correct and one.rival is None:
                imus[name] = replace(imus[name], time=imus[name].time - one.seconds)
        findings += _about_clocks(who, recording.placed, delays, settings.sensor_clocks)
    return replace(recording, imus=imus), tuple(findings)


def _accelerometer(who: str, stream: ImuStream, settings: AccelerometerSettings) -> tuple[ImuStream, list[str]]:
    findings = []
    clipped = clipped_samples(stream, settings)
    if np.any(clipped) and stream.specific_force is not None:
        end = float(np.max(np.abs(stream.specific_force[clipped])))
        stream = replace(stream, force_measured=stream.force_measured_mask & ~clipped)
        findings.append(
            f"{who}: the accelerometer of '{stream.name}' stands at the end of its range ({end:.0f} m/s²) in "
            f"{np.count_nonzero(clipped)} samples: those are left out; a wider range would help"
        )
    found = accelerometer_scale(stream, settings)
    if found is None or abs(found.scale - 1) <= max(settings.scale_error, settings.deviations * found.sigma):
        return stream, findings
    findings.append(
        f"{who}: the accelerometer of '{stream.name}' measures gravity as {9.81 * found.scale:.2f} m/s², "
        f"{100 * (found.scale - 1):+.0f} %: scaled to 9.81; calibrate it"
    )
    assert stream.specific_force is not None
    return replace(stream, specific_force=stream.specific_force / found.scale), findings


def _delays(recording: Recording, settings: Settings) -> tuple[SensorDelay, ...]:
    names = recording.placed
    if len(names) < 2:
        return ()
    sites = [recording.placement.site(name) for name in names]
    bones = [site.bone_index for site in sites]
    links = sensor_tree(
        bones, np.stack([site.p_bone_sensor for site in sites]), recording.subject.body(), load_pose_prior(),
        load_joint_limits(), np.deg2rad(settings.calibration.start.bone_sigma_deg),
    )  # fmt: skip
    return sensor_delays([recording.imus[name] for name in names], bones, links, settings.sensor_clocks)


def _about_clocks(
    who: str, names: Sequence[str], delays: Sequence[SensorDelay], settings: SensorClockSettings
) -> Iterator[str]:
    for one in delays:
        off = f"{1e3 * abs(one.seconds):.0f} ± {1e3 * one.sigma:.0f} ms"
        late = "behind" if one.seconds > 0 else "ahead of"
        if one.rival is not None:
            yield (
                f"{who}: sensor '{names[one.sensor]}' seems {off} {late} '{names[one.rival]}', and nothing tells which "
                "of the two is off: check their clocks"
            )
            continue
        done = "its times are shifted by as much" if settings.correct else "it is left so"
        yield f"{who}: sensor '{names[one.sensor]}' is {off} {late} its fellows: {done}; check its clock"
