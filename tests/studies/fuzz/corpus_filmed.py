"""Videos, images, and what convert puts together: wearers, cameras, 2D poses, logs of a camera's own sensor, bodies."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.io.pose_files import person, write_mmpose, write_openpose
from tests.studies.fuzz.case import Case, Files, command_case, installed, written
from tests.studies.fuzz.corpus_scenes import scene_files
from tests.studies.fuzz.corpus_small import FLOOR
from vip_factors.body.keypoints import keypoint_set
from vip_factors.geometry.rotations import exp

WIDTH, HEIGHT = 64, 48
BOARD_WIDTH, BOARD_HEIGHT, FOCAL = 200, 150, 180.0
COLUMNS, ROWS = 5, 4  # inner corners
CAMERA = f"width = {WIDTH}\nheight = {HEIGHT}\nfx = 50\nfy = 50\ncx = {WIDTH / 2}\ncy = {HEIGHT / 2}\ndistortion = []\n"
BOARD_CAMERA = (
    f"width = {BOARD_WIDTH}\nheight = {BOARD_HEIGHT}\nfx = {FOCAL}\nfy = {FOCAL}\ncx = {BOARD_WIDTH / 2}\n"
    f"cy = {BOARD_HEIGHT / 2}\ndistortion = [0.0, 0.0, 0.0, 0.0]\n"
)
FRAMES = 3  # with people; the film has more
CONVERT = "convert {}/plain.mcap {}/out.mcap --overwrite"


def filmed_cases(log: Files) -> list[Case]:
    """By ``convert`` and ``calibrate-camera``; ``log`` is one of Xsens's, in the folder log."""
    case, log = command_case, dict(log)
    plain = {"plain.mcap": scene_files()["plain.mcap"]}
    people = {number: [_standing("coco17")] for number in range(1, FRAMES + 1)}
    names = keypoint_set("coco17").keypoints
    filmed = {**written(lambda folder: write_mmpose(folder / "poses.json", people, names)),
              "camera.toml": (CAMERA + FLOOR).encode()}  # fmt: skip
    seen = "--detections {}/poses.json --camera {}/camera.toml --video-rate 10"
    cases = [
        case("convert-camera", plain | filmed, f"{CONVERT} {seen} --static-camera --known-camera-pose", seldom=20),
        case("camera-imu", plain | filmed | log,
             f"{CONVERT} {seen} --camera-imu-log {{}}/log --camera-imu Pelvis --camera-imu-wxyz 1 0 0 0",
             sound=("plain.mcap", *filmed), seldom=20),
        case("several-cameras", plain | _lab(),
             f"{CONVERT} --detections {{}}/left_json --camera {{}}/Calib.toml:left --static-camera --video-rate 10 "
              "--further-camera {}/Calib.toml:right {}/right_json 0.1", sound=("plain.mcap",), seldom=25),
        case("convert-parts", {**plain, "more.mcap": plain["plain.mcap"]},
             "convert {}/plain.mcap {}/out.mcap --then {}/more.mcap --overwrite", seldom=20),
        case("convert-join", {**plain, **log},
             "convert {}/log {}/out.mcap --subject Bea --join {}/plain.mcap --overwrite", seldom=20),
        case("pose-from", {f"held/{name[4:]}": one for name, one in log.items()} | log,
             "convert {}/log {}/out.mcap --pose-from {}/held:2 --initial-pose n-pose --overwrite",
             sound=tuple(log), seldom=20),
        case("sync-scene", {"scene.mcap": scene_files()["scene.mcap"]},
             "sync {}/scene.mcap --seconds 0.1 --overwrite", seldom=25),
    ]  # fmt: skip
    if installed("av"):
        lines = [f"{CONVERT} {seen} --video {{}}/film.mp4 --embed-video", f"{CONVERT} {seen} --video {{}}/film.mp4",
                 "view {}/out.mcap --save {}/out.rrd --overwrite"]  # fmt: skip
        film = {"film.mp4": small_film(2 * FRAMES)}
        sound = ("plain.mcap", *filmed)
        cases.append(case("video", plain | filmed | film, *lines, sound=sound, seldom=80, apart=True))
    calibrate = f"--checkerboard {COLUMNS}x{ROWS} --overwrite"
    images = {f"views/{view}.png": _png(view) for view in range(4)}
    over_floor = "--floor-image {}/floor.png --square-m 0.1"
    floor = {"camera.toml": BOARD_CAMERA.encode(), "floor.png": _png(1)}
    cases += [
        case("board-images", images, f"calibrate-camera {{}}/views {{}}/out.toml {calibrate}", seldom=60, apart=True),
        case("board-floor", floor,
             f"calibrate-camera {{}}/camera.toml {{}}/out.toml {over_floor} {calibrate}",
             seldom=15, apart=True),
    ]  # fmt: skip
    return cases


def _png(view: int) -> bytes:
    from vip_factors.viz.images import png_bytes

    return png_bytes(board(view))


def _lab() -> dict[str, bytes]:
    """A calibration of two cameras, and OpenPose's folders of both, as Pose2Sim has them."""
    tables = [
        f'[{name}]\nname = "{name}"\nsize = [{WIDTH}.0, {HEIGHT}.0]\nmatrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], '
        f"[0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [1.57, {turn}, 0.0]\n"
        "translation = [0.5, 1.5, 4.0]\nfisheye = false\n"
        for name, turn in (("left", 0.0), ("right", 0.3))
    ]
    tables.append("[metadata]\nadjusted = false\n")
    poses = {number: [_standing("body25")] for number in range(3)}

    def write(folder: Path) -> None:
        for name in ("left", "right"):
            write_openpose(folder / f"{name}_json", poses, f"{name}_")

    return {"Calib.toml": "\n".join(tables).encode()} | written(write)


def _standing(keypoints: str) -> np.ndarray:
    """Keypoints ``(K, 3)`` of one who stands in the small picture."""
    return person(keypoints, x=28, y=4, height=40)


def moving_square(frame: int) -> np.ndarray:
    """``(48, 64, 3)`` bytes."""
    image = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    image[..., 1] += np.arange(WIDTH, dtype=np.uint8)
    image[10:30, 5 + frame : 25 + frame] = (220, 40, 30)
    return image


def small_film(frames: int = 8) -> bytes:
    """H.264 in MP4, ten pictures a second."""
    from vip_factors.viz.film_file import film_file

    with TemporaryDirectory() as name:
        path = Path(name, "a.mp4")
        with film_file(path, 10.0, overwrite=False) as film:
            for frame in range(frames):
                film.add(moving_square(frame))
        return path.read_bytes()


def board(view: int) -> np.ndarray:
    """A checkerboard ``(150, 200, 3)`` bytes, tilted otherwise in every view."""
    v, u = np.mgrid[:BOARD_HEIGHT, :BOARD_WIDTH]
    ray = np.stack([(u - BOARD_WIDTH / 2) / FOCAL, (v - BOARD_HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    R = exp(np.array([0.4 * np.cos(2.0 * view), 0.4 * np.sin(2.0 * view), 0.1 * view]))
    centre = np.array([0.15 * np.cos(view), 0.1 * np.sin(view), 7.0 + 0.3 * (view % 3)])
    to_board = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], centre]))
    on_board = ray @ to_board.T
    x, y = on_board[..., 0] / on_board[..., 2] + (COLUMNS + 1) / 2, on_board[..., 1] / on_board[..., 2] + (ROWS + 1) / 2
    inside = (x >= 0) & (x < COLUMNS + 1) & (y >= 0) & (y < ROWS + 1)
    black = inside & ((np.floor(x) + np.floor(y)) % 2 == 0)
    return np.repeat(np.where(black, 20, 235).astype(np.uint8)[..., None], 3, axis=2)
