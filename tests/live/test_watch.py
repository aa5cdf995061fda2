"""Sensors that have moved are told from tissue that rings and from calibrations that are still being found."""

import numpy as np

from vip_factors.geometry.rotations import Array, exp
from vip_factors.live.sensor_slips import KnockDetector

RATE = 60.0
SENSORS = 6


def watch() -> KnockDetector:
    return KnockDetector(SENSORS, RATE, 0)


def moved_of(path: Array) -> list[tuple[int, int]]:
    """Frames and sensors that are said to have moved, where the first sensor takes ``path`` ``(T, 3)`` radians."""
    one = watch()
    S, found = SENSORS, list[tuple[int, int]]()
    R = np.broadcast_to(np.eye(3), (S, 3, 3)).copy()
    for frame in range(1, len(path)):
        after = R.copy()
        after[0] = exp(path[frame])
        knocks = one.knocked(frame, R, after, np.ones(S, bool))
        found += [(frame, int(sensor)) for sensor in knocks.moved]
        R = after
    return found


def swing(frames: int) -> Array:
    """A limb that swings: ±40° at 1 Hz."""
    return np.deg2rad(40) * np.sin(2 * np.pi * np.arange(frames) / RATE)[:, None] * np.array([1.0, 0.0, 0.0])


def test_tissue_that_rings_has_not_moved() -> None:
    time = np.arange(180) / RATE
    ring = np.zeros((180, 3))
    for strike in (0.5, 1.3, 2.2):
        since = np.maximum(time - strike, 0.0)
        ring[:, 1] += np.deg2rad(25) * np.exp(-since / 0.05) * np.sin(2 * np.pi * 12 * since)
    assert moved_of(swing(180) + ring) == []


def test_a_sensor_set_anew_has_moved() -> None:
    path = swing(180)
    path[90:] += np.deg2rad([0.0, 0.0, 60.0])
    found = moved_of(path)
    assert [sensor for _, sensor in found] == [0]
    assert 90 <= found[0][0] <= 90 + 0.2 * RATE


def test_a_knocked_sensor_is_not_listened_to_until_it_is_quiet() -> None:
    one = watch()
    S = SENSORS
    still, knocked = np.broadcast_to(np.eye(3), (S, 3, 3)), np.broadcast_to(np.eye(3), (S, 3, 3)).copy()
    knocked[2] = exp(np.deg2rad([0.0, 50.0, 0.0]))
    every = np.ones(S, bool)
    for frame in range(10):
        assert not len(one.knocked(frame, still, still, every).ringing)
    assert one.knocked(10, still, knocked, every).ringing.tolist() == [2]
    assert one.knocked(11, knocked, still, every).ringing.tolist() == [2]
    later = [one.knocked(frame, still, still, every) for frame in range(12, 24)]
    assert not len(later[-1].ringing)
    assert not any(len(each.moved) for each in later)


def test_a_landing_knocks_several_and_moves_none() -> None:
    one = watch()
    S = SENSORS
    before = np.broadcast_to(np.eye(3), (S, 3, 3))
    after = before.copy()
    after[:4] = exp(np.deg2rad([0.0, 0.0, 50.0]))
    every, moved = np.ones(S, bool), list[int]()
    for frame in range(40):
        R = (before, after) if frame == 20 else (after, after) if frame > 20 else (before, before)
        moved += one.knocked(frame, *R, every).moved.tolist()
    assert moved == []
