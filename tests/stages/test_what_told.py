"""What told who is who is said of every wearer."""

import numpy as np

from vip_factors.associate.associate import Association
from vip_factors.stages.reporting import what_told


def association(wearer: list[int], by_place: list[bool], by_clothes: bool) -> Association:
    N = len(wearer)
    R, p = np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3))
    return Association(np.array(wearer), np.ones(N), R, p, np.zeros(N), (), np.array(by_place, bool), by_clothes)


def test_motion_place_and_clothes_are_told_apart() -> None:
    told = what_told(["anna", "ben"], association([0, 0, 0, 1, -1], [False, True, True, False, False], True))
    assert told[0] == "anna was told by motion in 1 detections and by place in 2; clothes had a say"
    assert "ben was told by motion in 1 detections and by place in 0" in told[1]


def test_without_a_known_camera_motion_alone_tells() -> None:
    assert what_told(["anna"], association([0, 0], [], False)) == (
        "anna was told by motion in 2 detections and by place in 0; clothes had none",
    )
