"""Bodies with skin on Matplotlib axes: shaded triangles in a parallel projection, the farthest first."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.tri import Triangulation

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.sensors.calibration import SensorSite

R_FRONT_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # a view along −x
LIGHT = np.array([-0.42, -0.76, -0.50])  # unit, from the upper left, before the page
AMBIENT, DIFFUSE, GLOSS = 0.64, 0.44, 0.16  # shares of light, chosen by eye
SENSOR = "#2c3038"
FACING = -0.25  # of a sensor's axis out of the skin along the look: nearer to 0 it is seen from its edge


@dataclass(frozen=True)
class View:
    """Parallel projection of the world onto a page.

    Attributes:
        R_page_world: ``(3, 3)``; the page's x points right, y down, z away from who looks.
        scale: pixels per metre.
        pixel: where on the page ``p_world`` is seen.
        p_world: ``(3,)`` metres.
    """

    R_page_world: Array
    scale: float
    pixel: tuple[float, float]
    p_world: Array

    def project(self, p_world: Array) -> Array:
        """Pixels ``(..., 2)`` of points ``(..., 3)``."""
        return np.asarray(self.pixel) + self.scale * ((p_world - self.p_world) @ self.R_page_world.T)[..., :2]

    def depth(self, p_world: Array) -> Array:
        """Depths ``(...)`` in metres of points ``(..., 3)`` behind ``p_world``."""
        return (p_world - self.p_world) @ self.R_page_world[2]


def view_from(
    yaw: float, pitch: float, pixel: tuple[float, float], scale: float, p_world: Sequence[float] | Array = (0, 0, 0)
) -> View:
    """View of a point at a pixel, ``scale`` pixels a metre.

    ``yaw`` (rad) 0 sees the front of who faces x, positive from their left; ``pitch`` (rad) is from above.
    """
    return View(rotation_x(pitch) @ R_FRONT_WORLD @ rotation_z(-yaw), scale, pixel, np.asarray(p_world, float))


def draw_body(axes: Axes, motion: Motion, frame: int, view: View, colours: Mapping[Side, Colour]) -> None:
    """Draw the body of a motion at a frame, in the colours of its sides, over what is drawn already.

    The axes measure in pixels, y down.
    """
    mesh = body_mesh(motion.skeleton)
    p_world, normal = mesh.posed(motion.state.R_world_bone[frame], motion.state.p_world_joint[frame])
    pixels = view.project(p_world)
    corners = pixels[mesh.faces]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing = np.flatnonzero(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] < 0)  # anticlockwise, with y down
    faces = facing[np.argsort(-view.depth(p_world)[mesh.faces[facing]].mean(axis=1))]
    light = np.clip(normal @ view.R_page_world.T @ LIGHT, 0, 1)[:, None]
    by_bone = np.array([colours[side_of(bone)] for bone in range(JOINT_COUNT)]) / 255
    skin = TriMesh(Triangulation(pixels[:, 0], pixels[:, 1], mesh.faces[faces]), rasterized=True, zorder=1)
    skin.set_facecolor(np.clip((mesh.weights @ by_bone) * (AMBIENT + DIFFUSE * light) + GLOSS * light**6, 0, 1))
    axes.add_collection(skin, autolim=False)


def draw_sensors(axes: Axes, motion: Motion, frame: int, view: View, sites: Iterable[SensorSite]) -> None:
    """Draw the sensors at their sites whose outer side faces the page's reader, as dark squares."""
    R_world_bone, p_world_joint = motion.state.R_world_bone[frame], motion.state.p_world_joint[frame]
    for site in sites:
        R, p = R_world_bone[site.bone_index], p_world_joint[site.bone_index]
        if view.R_page_world[2] @ R @ site.R_bone_sensor[:, 2] < FACING:
            axes.plot(*view.project(p + R @ site.p_bone_sensor), "s", color=SENSOR, markersize=10, mew=0, zorder=1)
