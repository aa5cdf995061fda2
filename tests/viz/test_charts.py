"""Bodies on a page: where they lie, what hides what, and which sensors are seen."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Side
from vip_factors.body.skeleton import calibration_pose, joint_index
from vip_factors.sensors.calibration import sensor_site
from vip_factors.viz.charts import canvas, draw_body, draw_sensors, pixels, view_from

SIZE = (200, 240)
FRONT = view_from(0.0, 0.0, (100.0, 230.0), 110.0)
RED = dict.fromkeys(Side, (255, 0, 0))


def standing_body(pose: str) -> Motion:
    """A person of 1.75 m in a calibration pose, facing x, heels at z = 0."""
    skeleton = skeleton_from_stature(1.75)
    heel = skeleton.landmarks["left_heel"]
    height = -(skeleton.p_pelvis_joint[heel.bone] + heel.p_bone_point)[1]
    return Motion(skeleton, calibration_pose(pose)[None], np.array([[0.0, 0.0, height]]), 1.0)


def shown(axes: Axes) -> np.ndarray:
    return pixels(axes.figure).astype(int)


def test_a_body_covers_its_joints_and_nothing_else() -> None:
    body = standing_body("n-pose")
    axes = canvas(*SIZE)
    draw_body(axes, body, 0, FRONT, RED)
    covered = shown(axes)[..., 1] < 240
    joints = FRONT.project(body.state.p_world_joint[0])
    for x, y in np.round(joints[[joint_index(name) for name in ("pelvis", "spine3", "left_knee", "right_elbow")]]):
        assert covered[int(y), int(x)]
    rows, columns = np.nonzero(covered)
    assert rows.max() == pytest.approx(230, abs=2)  # heels at the floor
    assert rows.min() == pytest.approx(230 - 110 * 1.75, abs=4)  # the crown
    assert columns.min() > joints[:, 0].min() - 12
    assert columns.max() < joints[:, 0].max() + 12


def test_what_is_nearer_hides_what_is_farther() -> None:
    """Of a body seen from its left the left arm, before the trunk, is seen; the right is hidden."""
    body, side = standing_body("n-pose"), view_from(np.pi / 2, 0.0, (100.0, 230.0), 110.0)
    axes = canvas(*SIZE)
    sides = {Side.LEFT: (255, 0, 0), Side.MIDDLE: (0, 255, 0), Side.RIGHT: (0, 0, 255)}
    draw_body(axes, body, 0, side, sides)
    x, y = np.round(side.project(body.state.p_world_joint[0, joint_index("left_elbow")])).astype(int)
    red, green, blue = shown(axes)[y, x]
    assert red > 150 > max(green, blue)


@pytest.mark.parametrize(("yaw", "seen"), [(0.0, ["sternum"]), (np.pi, ["lower_back"])])
def test_sensors_on_the_far_side_are_not_drawn(yaw: float, seen: list[str]) -> None:
    body = standing_body("t-pose")
    view = view_from(yaw, 0.0, (100.0, 230.0), 110.0)
    sites = {name: sensor_site(name, body.skeleton) for name in ("sternum", "lower_back")}
    axes = canvas(*SIZE)
    draw_sensors(axes, body, 0, view, sites.values())
    places = [site.p_bone_sensor @ body.state.R_world_bone[0, site.bone_index].T + body.state.p_world_joint[
        0, site.bone_index] for name, site in sites.items() if name in seen]  # fmt: skip
    np.testing.assert_allclose([line.get_xydata()[0] for line in axes.lines], view.project(np.array(places)))
