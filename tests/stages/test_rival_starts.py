"""Starts that the search cannot tell apart: solved from each, they are reported only where motions differ."""

from dataclasses import replace
from functools import cache

import numpy as np

import vip_factors as vip
from vip_factors.geometry.rotations import rotation_y
from vip_factors.initialise.start_candidates import SETTLED_NATS
from vip_factors.initialise.start_search import Start, Starts
from vip_factors.problem.state import SceneState
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose
from vip_factors.stages.inertial import InertialSolution, calibrate_inertial, find_start, inertial_tracker
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.solver import Solver
from vip_factors.terms.registry import unfilmed_problem

SETTINGS = Settings()


@cache
def recorded() -> Recording:
    motion = with_initial_pose(gestures(4.0), "n-pose", hold_s=1.0)
    sensors = replace(SimulateSettings.noise_free(), imu_rate=30.0)
    made = simulate_recording(motion, preset("tnt10", motion.skeleton), sensors, seed=4, initial_pose="n-pose")
    return replace(made, subject=Subject(skeleton=motion.skeleton))


def solver() -> Solver:
    return Solver(SETTINGS.solve, lambda stage, fraction: None)


@cache
def solved() -> tuple[InertialSolution, Starts]:
    frames = resample(recorded(), 10.0)
    start, starts = find_start(recorded(), frames, SETTINGS, lambda fraction: None)
    assert starts is not None
    return calibrate_inertial(
        inertial_tracker(recorded(), frames, SETTINGS, solver(), start), SETTINGS, solver()
    ), starts


def decided(sensor: int, heading_deg: float) -> Starts:
    """What is left of a start whose rival has a sensor half a turn round its limb, and its heading another one."""
    solution, starts = solved()
    R_bone_sensor, headings = starts.best.calibration.R_bone_sensor.copy(), starts.best.calibration.headings.copy()
    R_bone_sensor[sensor] = rotation_y(np.pi) @ R_bone_sensor[sensor]
    headings[sensor] += np.deg2rad(heading_deg)
    turned = replace(starts.best.calibration, R_bone_sensor=R_bone_sensor, headings=headings)
    rival = Start("a rival", turned, starts.best.cost + 1.0)
    starts = replace(starts, margin=1.0, doubtful=(sensor,), rivals=(rival,))
    problem = unfilmed_problem([with_contacts(solution.model, solution.state)])
    state = SceneState.unfilmed([solution.state])
    found = with_rivals_solved(starts, problem, state, 0, recorded(), SETTINGS, solver())
    assert found is not None
    return found


def test_a_rival_that_ends_in_the_same_motion_is_not_told() -> None:
    found = decided(solved()[0].model.frames.sensors.index("left_forearm"), heading_deg=0.0)
    assert (found.doubtful, found.rivals) == ((), ())


def test_a_rival_that_ends_with_bones_elsewhere_is_told() -> None:
    sensors = solved()[0].model.frames.sensors
    found = decided(sensors.index("left_upper_arm"), heading_deg=180.0)
    assert [sensors[one] for one in found.doubtful] == ["left_upper_arm", "left_forearm"]
    assert (found.rival, found.margin) == ("a rival", 1.0)


def test_a_rival_within_the_stated_uncertainty_is_the_same_solution() -> None:
    """Six raw sensors, no camera: forearms end 10 to 13.5° from their rivals, with standard deviations of 12 to 22°."""
    made = vip.simulate("walk", "sip6", camera="fixed", seconds=4.0, seed=3).wearers[0]
    imus = made.imus
    worn = vip.Recording.from_arrays(
        {name: imu.time for name, imu in imus.items()},
        acceleration={name: imu.specific_force for name, imu in imus.items() if imu.specific_force is not None},
        gyroscope={name: imu.angular_rate for name, imu in imus.items() if imu.angular_rate is not None},
        placement={site: site for site in imus},
        subject=vip.Subject("Ada", stature_m=1.75),
        initial_pose="n-pose",
    )
    estimate = vip.smooth(worn, vip.Settings(frame_rate=20.0, covariance=False))
    start = estimate.wearer().start
    assert start is not None
    assert start.margin < SETTLED_NATS
    assert start.doubtful == ()
    assert estimate.verdict.severity == "care"
