"""Which feet bear the body, as their motion tells."""

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.initialise.root_path import contact_confidence, contact_points, standing_path
from vip_factors.simulate.gestures import gestures


def test_contacts_do_not_hang_on_the_last_digit_of_a_time() -> None:
    """At 15 Hz they are averaged over one and a half frames: of the same motion, a bit later, they are the same."""
    motion = gestures(6.0)
    R = motion.R_parent_child[:: round(motion.rate / 15)]
    points = contact_points(motion.skeleton)
    at_origin = forward_kinematics(motion.skeleton, R, np.zeros((len(R), 3)))
    body = forward_kinematics(motion.skeleton, R, standing_path(at_origin, points))
    steps = {float(one - other) for start in range(300) for other, one in [np.array([0.02 + start, 1.02 + start]) / 15]}
    found = [contact_confidence(body, points, step) for step in sorted(steps)]
    assert {round(0.1 / step) for step in steps} == {1, 2}
    assert found[0].max() > 0.9
    for one in found[1:]:
        np.testing.assert_allclose(one, found[0], atol=1e-6)
