"""What an estimate tells of its misfit is the misfit that was minimised."""

from dataclasses import replace

import numpy as np
from small_problems import S, T, small_model

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.geometry.rotations import rotation_z, transpose
from vip_factors.stages.decode import residuals
from vip_factors.terms.acceleration import GRAVITY


def test_accelerations_are_those_of_the_places_that_were_found() -> None:
    """Sensors that measured just what they do where they were found to sit leave no misfit."""
    model, state = small_model()
    state = replace(state, body=np.zeros_like(state.body))
    places = model.sensor_points.p_bone_point + state.sensor_positions
    body = forward_kinematics(model.skeleton, state.R_parent_child, state.p_world_pelvis)
    p = body.points(np.array(model.sensor_points.bones), places)
    force = np.zeros((T, S, 3))
    force[1:-1] = np.diff(p, 2, axis=0) / model.frames.step**2 - GRAVITY
    force = (transpose(rotation_z(state.headings)) @ force[..., None])[..., 0]
    frames = replace(model.frames, specific_force_inertial=force)
    found = residuals(replace(model, frames=frames), state)["acceleration_m_s2"]
    np.testing.assert_array_equal(np.isfinite(found[1:-1]), frames.acceleration_valid[1:-1])
    assert np.isnan(found[[0, -1]]).all()
    np.testing.assert_allclose(found[np.isfinite(found)], 0.0, atol=1e-9)
