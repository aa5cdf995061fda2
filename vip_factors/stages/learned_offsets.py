"""Where a detector puts its keypoints, by a file that was learnt of others before the same detector."""

import numpy as np

from vip_factors.body.keypoints import KeypointOffsets
from vip_factors.errors import InputError
from vip_factors.io.keypoint_offsets_file import read_keypoint_offsets
from vip_factors.sensors.scene import Camera
from vip_factors.terms.keypoint_offset import KeypointOffsetSettings


def prior_offsets(camera: Camera, settings: KeypointOffsetSettings) -> KeypointOffsets:
    """What was found of a camera's detector before, or learnt of others where a file is named; else its family's.

    Raises:
        FileFormatError, InputError: for a file that is none, or knows nothing of the camera's keypoints.
    """
    if camera.keypoint_offsets is not None:
        return camera.keypoint_offsets
    if settings.learned is None:
        sigmas = settings.sigmas * camera.detections.keypoints.offset_spread
        return KeypointOffsets(np.zeros_like(sigmas), sigmas)
    known, name = read_keypoint_offsets(settings.learned).sets, camera.detections.keypoints.name
    if name not in known:
        raise InputError(
            f"{settings.learned}: has no offsets of '{name}', the keypoints of camera '{camera.name}': it has "
            f"{', '.join(known) or 'none'}; vip-factors train keypoints learns them"
        )
    return known[name].offsets
