"""The page of a stream: the body as it moves, joint angles and findings; ``io/live_server.py`` serves it."""

import numpy as np

from vip_factors import __version__
from vip_factors.body.joint_angles import is_measured
from vip_factors.body.skeleton import calibration_pose
from vip_factors.io.live_json import VERSION
from vip_factors.report.angles import PAIRED, TRUNK
from vip_factors.report.blocks import capital, joint_words
from vip_factors.report.motion_data import body_data, corners, mesh_data, poses_data
from vip_factors.report.page import as_json, environment, packaged
from vip_factors.sensors.scene import Scene

EXTENT_M = 8.0  # of the ground that is drawn around who walks on it


def live_page(setup: Scene) -> str:
    """The page as HTML; it asks nobody but its server for anything.

    Args:
        setup: of the stream.
    """
    camera, of = setup.camera, len(setup.wearers)
    bodies = [one.subject.body() for one in setup.wearers]
    waiting = poses_data(calibration_pose("n-pose")[None], np.zeros((1, 3)))
    data = {
        "version": VERSION,
        "frames": 1,  # the one that is shown, which the script overwrites
        "floor": 0.0,
        "centre": [0.0, 0.0],
        "extent": EXTENT_M,
        "apart": of > 1 and camera is None,  # where they stand beside each other is not known
        "bodies": [
            body_data(one.subject.name, body, (number, of)) | waiting | {"mesh": number}
            for number, (one, body) in enumerate(zip(setup.wearers, bodies, strict=True))
        ],
        "meshes": [mesh_data(one) for one in bodies],
        "camera": None
        if camera is None
        else {"corners": corners(camera.model)} | poses_data(np.eye(3)[None], np.zeros((1, 3))),
    }
    angles = []
    for one in setup.wearers:
        bones = {site.bone for site in one.placement.sites}
        measured = [name for name in (*TRUNK, *PAIRED) if is_measured(bones, name)]
        angles.append((one.subject.name, [(capital(joint_words(name)), name, name in PAIRED) for name in measured]))
    return environment().get_template("live.html").render(
        data=as_json(data), name=setup.name, angles=angles, version=__version__, style=packaged("templates/live.css"),
        script=packaged("viewer/viewer.min.js"), with_camera=camera is not None, apart=data["apart"],
    )  # fmt: skip
