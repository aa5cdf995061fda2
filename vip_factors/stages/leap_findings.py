"""Leaps in the picture: a cut, a change of zoom, a stranger taken for the wearer."""

import numpy as np

from vip_factors.associate.hypothesis import hypotheses, wearer_points
from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.camera import LEAP_WINDOW, Sightings, leaps
from vip_factors.stages.associated_cameras import AssociatedCamera


def confirmed_leaps(each: AssociatedCamera, number: int, solved: Motion) -> Array:
    """Instants ``(n,)`` at which a wearer leaps in a camera's picture, by the solution as by the first association.

    The first association's hypothesis cameras are of a skeleton whose mountings nobody knew yet. A pelvis that is
    tilted on its wearer by 15 degrees turns the world by 30 as the wearer turns about, in any half second. What is left
    of a leap when the solved skeleton takes its place is the picture's: mountings are the same before and after. Nor
    does the first association always take the right person, and the last one makes up for it: only whom the estimate
    was made from may leap.

    Args:
        each: the camera.
        number: of the wearer.
        solved: the wearer's motion.
    """
    times = leaps(each.seen[number])
    if not len(times):
        return times
    again = leaps(_sightings(each, number, solved))
    return np.array([one for one in times if np.any(np.abs(again - one) <= LEAP_WINDOW)])


def _sightings(each: AssociatedCamera, number: int, solved: Motion) -> Sightings:
    """The hypothesis cameras of the detections that the estimate was made from, of the solved skeleton."""
    own = each.detections.select(each.association.wearer == number)
    found = hypotheses(own, each.camera.model.normalise(own.pixels), [wearer_points(solved, own.keypoints, own.time)])
    return Sightings(own.time[found.frame], found.R_camera_world, found.p_camera_pelvis)
