"""A picture of a motion for a page: poses in a row, the truth in grey behind, sensors, and the error below."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.body.mannequin import ESTIMATE_COLOURS, SENSOR_COLOUR, TRUTH_COLOUR, Colour, Side, mannequin, part_of
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z, yaw_of
from vip_factors.sensors.recording import Recording
from vip_factors.viz.canvas import Canvas, Rod, mixed
from vip_factors.viz.chart import draw_chart
from vip_factors.viz.compare import Compare, common_frames, floor_height, onto_truth, position_error_mm

INK, SOFT_INK, WHITE = (40, 46, 58), (120, 128, 140), (255, 255, 255)
GHOST = mixed(TRUTH_COLOUR, WHITE, 0.35)
SHADOW = (238, 240, 243)
WIDTH, MARGIN = 1600, 60
STRIP_TOP, STRIP_HEIGHT, CHART_HEIGHT = 130, 470, 190
BODY_HEIGHTS = (1.95, 2.5)  # metres that fit into the strip: standing, and arms raised overhead
HEADROOM_M = 0.35  # from the highest joint to the top: a head or a hand, and the perspective of looking down
LEG_BEHIND_M = 0.25  # a thigh is drawn behind the pelvis unless it is raised well in front
PALER_PER_M = 0.30
VIEW_YAW, VIEW_PITCH = np.deg2rad(32.0), np.deg2rad(9.0)  # from the wearer's front left, a little from above
# At rest the body's z (forward) is turned onto the world's x: the yaw of a standing body facing x is that of this.
R_WORLD_STANDING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def filmstrip(
    estimate: Estimate | None,
    recording: Recording | None,
    truth: Motion | None,
    path: Path,
    *,
    poses: int = 6,
    title: str | None = None,
    overwrite: bool = False,
) -> None:
    """Draw a PNG; each pose is seen from the wearer's front left.

    Args:
        estimate: drawn in colour; None draws the truth in colour.
        recording: for the sensors' places; its truth is used if ``truth`` is None.
        truth: drawn in grey behind the estimate, its pelvis under the estimate's.
        path: of the PNG.
        poses: how many, evenly over the time.
        title: above the picture; the estimate's name and method if None.
        overwrite: replace an existing file.

    Raises:
        InputError: if there is no motion to draw, or the file exists.
    """
    if truth is None and recording is not None and recording.truth is not None:
        truth = recording.truth.motion
    if estimate is not None:
        shown, ghost = estimate.motion, None
        if truth is not None:
            shown, ghost = common_frames(estimate.motion, truth)
            shown = onto_truth(shown, ghost, Compare.ROOT)
    elif truth is not None:
        shown, ghost = truth, None
    else:
        raise InputError("nothing to draw: expected an estimate, or a recording with its truth")
    values, label = _curve(estimate, shown, ghost)
    canvas = Canvas(WIDTH, STRIP_TOP + STRIP_HEIGHT + (40 + CHART_HEIGHT if values is not None else 0) + 30)
    frames = np.round(np.linspace(0.04, 0.96, poses) * (len(shown) - 1)).astype(int)
    if title is None:
        title = f"{estimate.name}, {estimate.method}" if estimate is not None else shown.name
    _header(canvas, title, _subtitle(estimate, shown, values, ghost is not None), ghost is not None, recording)
    _strip(canvas, shown, ghost, frames, estimate, recording)
    if values is not None:
        box = (MARGIN + 40, STRIP_TOP + STRIP_HEIGHT + 50, WIDTH - MARGIN, STRIP_TOP + STRIP_HEIGHT + CHART_HEIGHT)
        draw_chart(canvas, box, shown.time, values, label, shown.time[frames])
    canvas.save(path, overwrite)


def pose_picture(motion: Motion, frame: int, size: tuple[int, int]) -> np.ndarray:
    """One pose on white, seen from the wearer's front left.

    Args:
        motion: whose pose.
        frame: which one.
        size: width and height in pixels.

    Returns:
        ``(height, width, 3)``, blue green red.
    """
    canvas = Canvas(*size)
    floor = floor_height(motion.frames(slice(frame, frame + 1)))
    highest = float(motion.state.p_world_joint[frame, :, 2].max()) - floor
    scale = 0.94 * size[1] / float(np.clip(highest + HEADROOM_M, *BODY_HEIGHTS))
    foot = np.array([size[0] / 2, 0.95 * size[1]])
    canvas.ellipse(foot, 0.40 * scale, 0.085 * scale, SHADOW)
    _draw(canvas, motion, frame, _view(motion, frame, floor, foot, scale), ESTIMATE_COLOURS)
    return canvas.pixels()


def _curve(estimate: Estimate | None, shown: Motion, ghost: Motion | None) -> tuple[Array | None, str]:
    if ghost is not None:
        return position_error_mm(shown, ghost), "joint error, mm"
    if estimate is not None and "orientation_deg" in estimate.residuals:
        residual = estimate.residuals["orientation_deg"]
        some = np.isfinite(residual).any(axis=1)
        mean = np.full(len(residual), np.nan)
        mean[some] = np.nanmean(residual[some], axis=1)
        return mean, "mean orientation residual, °"
    return None, ""


def _subtitle(estimate: Estimate | None, shown: Motion, values: Array | None, compared: bool) -> str:
    parts = [f"{len(shown) / shown.rate:.1f} s"]
    if estimate is not None and estimate.sensors:
        parts.append(f"{len(estimate.sensors)} inertial sensors")
    if compared and values is not None:
        parts.append(f"mean joint error {np.mean(values):.0f} mm")
    return "   ·   ".join(parts)


def _header(canvas: Canvas, title: str, subtitle: str, compared: bool, recording: Recording | None) -> None:
    canvas.text((MARGIN, 62), title, INK, 30, 600)
    canvas.text((MARGIN, 98), subtitle, SOFT_INK, 20)
    entries = [("left", ESTIMATE_COLOURS[Side.LEFT]), ("right", ESTIMATE_COLOURS[Side.RIGHT])]
    if compared:
        entries.append(("truth", GHOST))
    if recording is not None:
        entries.append(("sensor", SENSOR_COLOUR))
    x = WIDTH - MARGIN - sum(canvas.text_width(name, 20) + 52 for name, _ in entries) + 24
    for name, colour in entries:
        y = np.array([0.0, 55.0])
        if name == "sensor":
            _box(canvas, np.array([x + 2, 47.0]) + np.array([[0, 0], [15, 0], [15, 15], [0, 15]]))
        else:
            canvas.limb([Rod(np.array([x, 0]) + y, np.array([x + 14, 0]) + y, (6.0, 6.0))], colour)
        x = canvas.text((x + 28, 62), name, SOFT_INK, 20) + 24


def _strip(
    canvas: Canvas,
    shown: Motion,
    ghost: Motion | None,
    frames: Array,
    estimate: Estimate | None,
    recording: Recording | None,
) -> None:
    cell = (WIDTH - 2 * MARGIN) / len(frames)
    # Without the truth the height of an inertial reconstruction drifts: then every pose stands on its own lower foot.
    floors = [floor_height(ghost if ghost is not None else shown.frames(slice(f, f + 1))) for f in frames]
    highest = float((shown.state.p_world_joint[frames, :, 2].max(axis=1) - floors).max())
    scale = STRIP_HEIGHT / float(np.clip(highest + HEADROOM_M, *BODY_HEIGHTS))
    for index, (frame, floor) in enumerate(zip(frames, floors, strict=True)):
        foot = np.array([MARGIN + cell * (index + 0.5), STRIP_TOP + STRIP_HEIGHT - 28.0])
        view = _view(ghost if ghost is not None else shown, int(frame), floor, foot, scale)
        canvas.ellipse(foot, 0.40 * scale, 0.085 * scale, SHADOW)
        if ghost is not None:
            _draw(canvas, ghost, int(frame), view, dict.fromkeys(Side, GHOST))
        sensors = _sensors(shown.state, int(frame), view, recording, estimate)
        _draw(canvas, shown, int(frame), view, ESTIMATE_COLOURS, sensors)


@dataclass(frozen=True)
class _View:
    """An eye at infinity: ``R_view_world`` (x right, y down, z away), and which world point falls on which pixel."""

    R_view_world: Array
    p_world_anchor: Array
    anchor: Array
    scale: float

    def project(self, p_world: Array) -> tuple[Array, Array]:
        """Pixels ``(..., 2)`` and depth ``(...)`` in metres of world points ``(..., 3)``."""
        p_view = (p_world - self.p_world_anchor) @ self.R_view_world.T
        return self.anchor + self.scale * p_view[..., :2], p_view[..., 2]


def _view(motion: Motion, frame: int, floor: float, anchor: Array, scale: float) -> _View:
    state = motion.state
    facing = float(yaw_of(state.R_world_bone[frame, 0] @ R_WORLD_STANDING.T))
    # Without pitch the eye looks along −x of the facing frame: right is +y's opposite seen from the front, down is −z.
    R_view_front = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    R_view_world = rotation_x(VIEW_PITCH) @ R_view_front @ rotation_z(-(facing + VIEW_YAW))
    pelvis = state.p_world_joint[frame, 0]
    return _View(R_view_world, np.array([pelvis[0], pelvis[1], floor]), anchor, scale)


def _draw(
    canvas: Canvas,
    motion: Motion,
    frame: int,
    view: _View,
    colours: Mapping[Side, Colour],
    sensors: Mapping[str, list[Array]] | None = None,
) -> None:
    """Limbs, trunk and head with their sensors, the farthest first and a little paler, as air makes them."""
    state = motion.state
    parts: dict[str, list[tuple[Rod, float, Colour]]] = {}
    for segment in mannequin(motion.skeleton):
        R, p = state.R_world_bone[frame, segment.bone], state.p_world_joint[frame, segment.bone]
        pixels, depth = view.project(np.stack([R @ segment.p_bone_start + p, R @ segment.p_bone_end + p]))
        radii = (segment.radius_start * view.scale, segment.radius_end * view.scale)
        rod = Rod(pixels[0], pixels[1], radii)
        parts.setdefault(segment.part, []).append((rod, float(depth.mean()), colours[segment.side]))
    depths = {
        part: float(np.mean([depth for _, depth, _ in rods])) + LEG_BEHIND_M * part.endswith("leg")
        for part, rods in parts.items()
    }
    nearest = min(depths.values())
    for part in sorted(depths, key=lambda part: -depths[part]):
        pale = min(PALER_PER_M * (depths[part] - nearest), 0.25)
        canvas.limb([rod for rod, _, _ in parts[part]], mixed(parts[part][0][2], WHITE, pale))
        for plate in (sensors or {}).get(part, ()):
            _box(canvas, plate)


def _sensors(
    state: BodyState, frame: int, view: _View, recording: Recording | None, estimate: Estimate | None
) -> dict[str, list[Array]]:
    """Corners ``(4, 2)`` of each sensor's plate, by the part of the body it sits on, if it faces the eye."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([0.030, 0.021])
    plates: dict[str, list[Array]] = {}
    for site in recording.placement.sites if recording is not None else ():
        known = estimate.calibration.get(site.sensor) if estimate is not None else None
        R_bone_sensor = known.R_bone_sensor if known is not None else site.R_bone_sensor
        R = state.R_world_bone[frame, site.bone_index]
        if (view.R_view_world @ R @ site.R_bone_sensor)[2, 2] > 0.15:
            continue  # on the far side of its limb
        plate = np.pad(corners, ((0, 0), (0, 1))) @ (R @ R_bone_sensor).T
        centre = state.p_world_joint[frame, site.bone_index] + R @ site.p_bone_sensor
        plates.setdefault(part_of(site.bone_index), []).append(view.project(centre + plate)[0])
    return plates


def _box(canvas: Canvas, corners: Array) -> None:
    canvas.polygon(corners, SENSOR_COLOUR)
    canvas.curve(np.concatenate([corners, corners[:1]]), INK, 1.3)
