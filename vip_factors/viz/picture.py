"""A picture of a motion for a page: poses in a row, the truth in grey behind, sensors, and the error below."""

from pathlib import Path

import numpy as np

from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import ESTIMATE_COLOURS, TRUTH_COLOUR, Side
from vip_factors.errors import InputError
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z, yaw_of
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.recording import Recording
from vip_factors.viz.canvas import Canvas, Rod, mixed
from vip_factors.viz.chart import draw_chart
from vip_factors.viz.compare import (
    Compare,
    check_frames,
    common_frames,
    floor_height,
    known_bones,
    known_truth,
    onto_truth,
    position_error_mm,
)
from vip_factors.viz.eye import Eye, Lens
from vip_factors.viz.figure import BOX_COLOUR, Figure, as_bytes, blend, lit_from, sensor_boxes
from vip_factors.viz.room import Room, floor_light

INK, SOFT_INK, WHITE = (40, 46, 58), (120, 128, 140), (255, 255, 255)
GHOST = mixed(TRUTH_COLOUR, WHITE, 0.35)
WIDTH, MARGIN = 1600, 60
STRIP_TOP, STRIP_HEIGHT, CHART_HEIGHT = 130, 470, 190
BODY_HEIGHTS = (1.95, 2.5)  # metres that fit into the strip: standing, and arms raised overhead
HEADROOM_M = 0.35  # from the highest joint to the top: a head or a hand, and the perspective of looking down
DISTANCE_M = 9.0  # of the eye: far enough for nearly parallel lines
CELL_SHARE = 1.7  # of a pose's place in the row: arms reach beside it
STEEP = 2.2  # light: shadows end before the next pose
FOOT_ROOM_PX = 42  # below the point under the pelvis: feet before it
GHOST_OPACITY = 0.55
VIEW_YAW, VIEW_PITCH = np.deg2rad(32.0), np.deg2rad(9.0)  # from the wearer's front left, a little from above
# At rest the body's z (forward) is turned onto the world's x: the yaw of a standing body facing x is that of this.
R_WORLD_STANDING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def filmstrip(
    estimate: WearerEstimate | None,
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
    truth = known_truth(truth)
    if estimate is not None:
        shown, ghost = check_frames(estimate.motion), None
        if truth is not None:
            shown, ghost = common_frames(estimate.motion, truth)
            shown = onto_truth(shown, ghost, Compare.ROOT)
    elif truth is not None:
        shown, ghost = truth, None
    else:
        raise InputError("nothing to draw: expected an estimate, or a recording with its truth")
    values, label = _curve(estimate, shown, ghost, known_bones(recording, truth))
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
    floor = floor_height(motion.frames(slice(frame, frame + 1)))
    highest = float(motion.state.p_world_joint[frame, :, 2].max()) - floor
    scale = (size[1] - FOOT_ROOM_PX) / float(np.clip(highest + HEADROOM_M, *BODY_HEIGHTS))
    picture = np.ones((size[1], size[0], 3), np.float32)
    figure = Figure(body_mesh(motion.skeleton), motion, ESTIMATE_COLOURS)
    _draw(picture, _lens(size[0], size[1], scale), motion, frame, floor, figure, None)
    return as_bytes(np.ascontiguousarray(picture[..., ::-1]))


def _curve(
    estimate: WearerEstimate | None, shown: Motion, ghost: Motion | None, bones: frozenset[str] | None
) -> tuple[Array | None, str]:
    if ghost is not None:
        return position_error_mm(shown, ghost, bones), "joint error, mm"
    if estimate is not None and "orientation_deg" in estimate.residuals:
        residual = estimate.residuals["orientation_deg"]
        some = np.isfinite(residual).any(axis=1)
        mean = np.full(len(residual), np.nan)
        mean[some] = np.nanmean(residual[some], axis=1)
        return mean, "mean orientation residual, °"
    return None, ""


def _subtitle(estimate: WearerEstimate | None, shown: Motion, values: Array | None, compared: bool) -> str:
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
        entries.append(("sensor", BOX_COLOUR))
    x = WIDTH - MARGIN - sum(canvas.text_width(name, 20) + 52 for name, _ in entries) + 24
    for name, colour in entries:
        y = np.array([0.0, 55.0])
        if name == "sensor":
            canvas.polygon(np.array([x + 2, 47.0]) + np.array([[0, 0], [15, 0], [15, 15], [0, 15]]), BOX_COLOUR)
        else:
            canvas.limb([Rod(np.array([x, 0]) + y, np.array([x + 14, 0]) + y, (6.0, 6.0))], colour)
        x = canvas.text((x + 28, 62), name, SOFT_INK, 20) + 24


def _strip(
    canvas: Canvas,
    shown: Motion,
    ghost: Motion | None,
    frames: Array,
    estimate: WearerEstimate | None,
    recording: Recording | None,
) -> None:
    cell = (WIDTH - 2 * MARGIN) / len(frames)
    # Without the truth the height of an inertial reconstruction drifts: then every pose stands on its own lower foot.
    floors = [floor_height(ghost if ghost is not None else shown.frames(slice(f, f + 1))) for f in frames]
    highest = float((shown.state.p_world_joint[frames, :, 2].max(axis=1) - floors).max())
    scale = (STRIP_HEIGHT - FOOT_ROOM_PX) / float(np.clip(highest + HEADROOM_M, *BODY_HEIGHTS))
    lens = _lens(round(CELL_SHARE * cell), STRIP_HEIGHT, scale)
    body, behind = _figures(shown, ghost, estimate, recording)
    strip = np.ones((STRIP_HEIGHT, WIDTH, 3), np.float32)
    for index, (frame, floor) in enumerate(zip(frames, floors, strict=True)):
        left = round(MARGIN + cell * (index + 0.5) - lens.model.width / 2)
        part = strip[:, max(left, 0) : left + lens.model.width]
        picture = np.ones((STRIP_HEIGHT, lens.model.width, 3), np.float32)
        picture[:, max(-left, 0) :][:, : part.shape[1]] = part
        _draw(picture, lens, ghost if ghost is not None else shown, int(frame), floor, body, behind)
        part[:] = picture[:, max(-left, 0) :][:, : part.shape[1]]
    canvas.paste(as_bytes(np.ascontiguousarray(strip[..., ::-1])), 0, STRIP_TOP)


def _draw(
    picture: np.ndarray, lens: Lens, seen: Motion, frame: int, floor: float, body: Figure, behind: Figure | None
) -> None:
    """A figure, and one behind it, into a picture ``(height, width, 3)``, at a frame of the motion looked at."""
    eye, time = _eye(seen, frame, floor, lens.model), float(seen.time[frame])
    posed = body.posed(time)
    light, room = lit_from(eye), Room(floor, eye.p_world_camera[:2], lit_from(eye, STEEP))
    picture *= floor_light(room, eye, lens, [posed.p])[..., None]
    if behind is not None:
        blend(picture, eye, [behind.posed(time)], light, GHOST_OPACITY)
    blend(picture, eye, [posed], light)


def _figures(
    shown: Motion, ghost: Motion | None, estimate: WearerEstimate | None, recording: Recording | None
) -> tuple[Figure, Figure | None]:
    """The body with its sensors, and the grey one behind it."""
    mesh, boxes = body_mesh(shown.skeleton), None
    if recording is not None:
        boxes = sensor_boxes(mesh, recording.placement, estimate.calibration if estimate is not None else None)
    behind = None
    if ghost is not None:
        behind = Figure(body_mesh(ghost.skeleton), ghost, dict.fromkeys(Side, TRUTH_COLOUR))
    return Figure(mesh, shown, ESTIMATE_COLOURS, boxes), behind


def _lens(width: int, height: int, scale: float) -> Lens:
    """Of one pose's picture; ``scale`` pixels a metre at the feet, which stand in the middle near its lower edge."""
    focal = scale * DISTANCE_M
    return Lens(CameraModel(width, height, (focal, focal), ((width - 1) / 2, height - FOOT_ROOM_PX)))


def _eye(motion: Motion, frame: int, floor: float, model: CameraModel) -> Eye:
    state = motion.state
    facing = float(yaw_of(state.R_world_bone[frame, 0] @ R_WORLD_STANDING.T))
    # Without pitch the eye looks along −x of the facing frame: right is +y's opposite seen from the front, down is −z.
    R_view_front = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    R_view_world = rotation_x(VIEW_PITCH) @ R_view_front @ rotation_z(-(facing + VIEW_YAW))
    pelvis = state.p_world_joint[frame, 0]
    foot = np.array([pelvis[0], pelvis[1], floor])
    return Eye(model, R_view_world.T, foot - DISTANCE_M * R_view_world[2])
