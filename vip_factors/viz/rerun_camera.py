"""The camera in Rerun's world: its frustum, moving, and its path."""

import numpy as np
import rerun as rr

from vip_factors.body.mannequin import Colour
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.viz.rerun_body import TRAIL_RADIUS_M, time_column

TRUE_FRUSTUM_COLOUR: Colour = (150, 156, 166)
FRUSTUM_M = 0.6  # from the camera to its image plane as drawn: seen from afar, but not in front of the wearers
CAMERA_COLOUR: Colour = (240, 210, 90)  # of its curves
FRUSTUM_COLOUR: Colour = (52, 58, 70)  # in the world, which is bright


def log_camera(stream: rr.RecordingStream, entity: str, path: CameraPath, model: CameraModel) -> None:
    """Log a moving (or standing) camera: ``entity`` carries its pose, ``entity/image`` its pinhole and pictures."""
    _log_poses(stream, entity, path)
    log_frustum(stream, entity, model)


def log_frustum(stream: rr.RecordingStream, entity: str, model: CameraModel) -> None:
    """Log the pinhole of a camera whose pose is logged at ``entity``."""
    stream.log(f"{entity}/image", _pinhole(model, FRUSTUM_COLOUR), static=True)


def log_true_camera(stream: rr.RecordingStream, entity: str, path: CameraPath, model: CameraModel) -> None:
    """Log where the camera really was: a grey frustum."""
    _log_poses(stream, entity, path)
    stream.log(f"{entity}/frustum", _pinhole(model, TRUE_FRUSTUM_COLOUR), static=True)


def log_camera_trail(stream: rr.RecordingStream, entity: str, path: CameraPath, colour: Colour) -> None:
    """Log the way of the camera as one static line; nothing for one that stands still."""
    if len(path) > 1:
        strip = rr.LineStrips3D([path.p_world_camera], colors=[colour], radii=TRAIL_RADIUS_M)
        stream.log(entity, strip, static=True)


def _log_poses(stream: rr.RecordingStream, entity: str, path: CameraPath) -> None:
    if len(path) == 1:
        pose = rr.Transform3D(translation=path.p_world_camera[0], mat3x3=path.R_world_camera[0])
        stream.log(entity, pose, static=True)
        return
    log_camera_poses(stream, entity, path)


def log_camera_poses(stream: rr.RecordingStream, entity: str, path: CameraPath) -> None:
    """Log the poses of a moving camera, or a part of them."""
    columns = rr.Transform3D.columns(
        translation=path.p_world_camera.astype(np.float32),
        quaternion=quaternion_from_matrix(path.R_world_camera, Order.XYZW).astype(np.float32),
    )
    stream.send_columns(entity, indexes=[time_column(path.time)], columns=columns)


def _pinhole(model: CameraModel, colour: Colour) -> rr.Pinhole:
    return rr.Pinhole(
        image_from_camera=model.K,
        resolution=[model.width, model.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=FRUSTUM_M,
        color=colour,
        line_width=0.004,
    )
