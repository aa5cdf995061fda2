"""Names and links of joints and keypoints in Rerun: its viewer names what the pointer is on, and draws the links.

Every wearer is a class of Rerun's annotation context, so that the links take the wearer's colour.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS
from vip_factors.viz.image_limbs import limb_pairs
from vip_factors.viz.rerun_body import time_column
from vip_factors.viz.wearer_colours import UNCLAIMED, wearer_colour

NOBODY_CLASS = 0
JOINT_RADIUS_M = 0.012  # within the body: seen in see-through bodies, and where a body is switched off


def class_of(index: int) -> int:
    """Rerun's class of a wearer; of −1, nobody, too."""
    return index + 1


def log_joint_names(stream: rr.RecordingStream, entity: str, names: Sequence[str]) -> None:
    """Log names and links of the joints of wearers of these names, for all that is below ``entity``."""
    links = [(parent, joint) for joint, parent in enumerate(PARENTS) if parent >= 0]
    classes = [
        _class(class_of(index), name, wearer_colour(index), JOINT_NAMES, links) for index, name in enumerate(names)
    ]
    stream.log(entity, rr.AnnotationContext(classes), static=True)


def log_keypoint_names(stream: rr.RecordingStream, image: str, keypoints: KeypointSet, names: Sequence[str]) -> None:
    """Log names and links of a detector's keypoints, for all that is below an image.

    Nobody's have no links, for Rerun could not tell strangers in one frame apart.
    """
    links = [(int(a), int(b)) for a, b in limb_pairs(keypoints)]
    classes = [_class(NOBODY_CLASS, "nobody's", UNCLAIMED, keypoints.keypoints, [])]
    for index, name in enumerate(names):
        classes.append(_class(class_of(index), name, pale_colour(index), keypoints.keypoints, links))
    stream.log(image, rr.AnnotationContext(classes), static=True)


def log_joints_style(stream: rr.RecordingStream, entity: str, index: int) -> None:
    """Log how the joints of a wearer look at ``entity``, and that they are joints, for ever."""
    style = rr.Points3D.from_fields(
        radii=[JOINT_RADIUS_M], class_ids=[class_of(index)], keypoint_ids=np.arange(len(JOINT_NAMES)), show_labels=False
    )
    stream.log(entity, style, static=True)


def log_joints(stream: rr.RecordingStream, entity: str, motion: Motion) -> None:
    """Log where the joints of a motion are."""
    points = motion.state.p_world_joint.astype(np.float32)
    columns = rr.Points3D.columns(positions=points.reshape(-1, 3)).partition([points.shape[1]] * len(points))
    stream.send_columns(entity, indexes=[time_column(motion.time)], columns=columns)


def pale_colour(index: int) -> Colour:
    """A wearer's detections: paler than the body, which they lie on."""
    red, green, blue = wearer_colour(index)
    return (red + 255) // 2, (green + 255) // 2, (blue + 255) // 2


def _class(
    number: int, name: str, colour: Colour, points: Sequence[str], links: Sequence[tuple[int, int]]
) -> rr.ClassDescription:
    return rr.ClassDescription(
        info=rr.AnnotationInfo(number, name, colour),
        keypoint_annotations=[rr.AnnotationInfo(one, point.replace("_", " ")) for one, point in enumerate(points)],
        keypoint_connections=links,
    )
