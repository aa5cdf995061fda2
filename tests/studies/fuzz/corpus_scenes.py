"""Recordings, estimates and live streams of a moment, simulated and solved by the package; what converts them, shows
them, exports them and solves them; videos and images beside them."""

from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import replace
from functools import cache, partial
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import numpy as np

from tests.films import write_video
from tests.io.pose_files import person, write_mmpose, write_openpose
from tests.live_sender import write_messages
from tests.studies.fuzz.corpus import FLOOR, written, written_motions, xsens_log
from tests.studies.fuzz.mutations import varint
from tests.studies.fuzz.run import Case, Files
from vip_factors.body.keypoints import keypoint_set
from vip_factors.cli.main import run_command
from vip_factors.cli.terminal import terminal_text
from vip_factors.cli.views import file_tables
from vip_factors.errors import FileFormatError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
from vip_factors.geometry.rotations import exp
from vip_factors.io.live_growing import GrowingFileSource
from vip_factors.io.live_messages import Client, ClientError, Session
from vip_factors.io.live_open import follow
from vip_factors.io.mcap_estimate import read_estimate, write_estimate
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.mcap_source import open_source
from vip_factors.io.settings import LiveSourceSettings
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.recording import Subject
from vip_factors.sensors.scene import Scene, Video
from vip_factors.settings import Settings, SolveSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.viz.film import film_file, jpeg_bytes, png_bytes

SECONDS, FILMED_SECONDS = 0.5, 2.5
WIDTH, HEIGHT = 64, 48
BOARD_WIDTH, BOARD_HEIGHT, FOCAL = 200, 150, 180.0
COLUMNS, ROWS = 5, 4  # inner corners
FRAMES = 3  # with people; the film has more
SEEN = "--detections {}/poses.json --camera {}/camera.toml --video-rate 10"
CONVERT = "convert {}/plain.mcap {}/out.mcap --overwrite"
PAIR = "{}/NAME.mcap {}/NAME.estimate.mcap"
FILM = "--video --video-height 64 --moments 0 --overwrite"
BOARD = f"--checkerboard {COLUMNS}x{ROWS} --overwrite"
NEEDS = {"glb": "pygltflib", "c3d": "ezc3d"}
# Whole commands, by format: names of the files (see _content), those that are not damaged, how seldom, and lines.
COMMANDS: tuple[tuple[str, str, str, int, tuple[str, ...]], ...] = (
    *(
        (f"{name}-{kind}", f"{kind}.mcap {kind}.estimate.mcap", sound.replace("NAME", kind), seldom,
         (line.replace("PAIR", PAIR).replace("NAME", kind),))
        for kind in ("plain", "scene")
        for name, sound, seldom, line in (
            ("view", "", 70, "view PAIR --save {}/out.rrd --overwrite"),
            ("picture", "", 250, "view PAIR --picture {}/out.png --overwrite"),
            ("report", "", 120, "report {}/NAME.estimate.mcap --recording {}/NAME.mcap --out {}/out.html --overwrite"),
            ("evaluate", "NAME.estimate.mcap", 18, "evaluate {}/NAME.estimate.mcap --truth {}/NAME.mcap"),
        )
    ),
    ("view-motion", "a.bvh", "", 40, ("view {}/a.bvh --save {}/out.rrd --overwrite",)),
    ("view-images", "images.mcap", "", 50, ("view {}/images.mcap --save {}/out.rrd --overwrite",)),
    ("picture-images", "images.mcap", "", 200, ("view {}/images.mcap --picture {}/out.png --overwrite",)),
    *(
        (f"evaluate-{suffix}", f"a.{suffix} plain.estimate.mcap", "plain.estimate.mcap", 15,
         (f"evaluate {{}}/plain.estimate.mcap --truth {{}}/a.{suffix}",))
        for suffix in ("bvh", "npz")
    ),
    *(
        (f"export-{suffix}", f"{kind}.estimate.mcap", "", 40 if suffix in NEEDS else 12,
         (f"export {{}}/{kind}.estimate.mcap {{}}/out.{suffix} --overwrite",))
        for kind, suffixes in (("plain", "bvh npz csv trc mot sto"), ("scene", "pkl glb c3d"))
        for suffix in suffixes.split()
        if find_spec(NEEDS.get(suffix, "numpy"))
    ),
    ("convert-camera", "plain.mcap poses.json camera.toml", "", 20,
     (f"{CONVERT} {SEEN} --static-camera --known-camera-pose",)),
    ("camera-imu", "plain.mcap poses.json camera.toml log/", "plain.mcap poses.json camera.toml", 20,
     (f"{CONVERT} {SEEN} --camera-imu-log {{}}/log --camera-imu Pelvis --camera-imu-wxyz 1 0 0 0",)),
    ("several-cameras", "plain.mcap Calib.toml left_json/ right_json/", "plain.mcap", 25,
     (f"{CONVERT} --detections {{}}/left_json --camera {{}}/Calib.toml:left --static-camera --video-rate 10 "
      "--further-camera {}/Calib.toml:right {}/right_json 0.1",)),
    ("convert-parts", "plain.mcap more.mcap", "", 20,
     ("convert {}/plain.mcap {}/out.mcap --then {}/more.mcap --overwrite",)),
    ("convert-join", "plain.mcap log/", "", 20,
     ("convert {}/log {}/out.mcap --subject Bea --join {}/plain.mcap --overwrite",)),
    ("pose-from", "log/ held/", "log/", 20,
     ("convert {}/log {}/out.mcap --pose-from {}/held:2 --initial-pose n-pose --overwrite",)),
    ("sync-scene", "scene.mcap", "", 25, ("sync {}/scene.mcap --seconds 0.1 --overwrite",)),
    ("sync-clocks", "filmed.mcap", "", 40, ("sync {}/filmed.mcap --dry-run",)),
    ("board-video", "views.avi", "", 60, (f"calibrate-camera {{}}/views.avi {{}}/out.toml {BOARD}",)),
    ("board-floor", "board.toml floor.png", "", 15,
     (f"calibrate-camera {{}}/board.toml {{}}/out.toml --floor-image {{}}/floor.png --square-m 0.1 {BOARD}",)),
    ("video", "plain.mcap poses.json camera.toml film.mp4", "plain.mcap poses.json camera.toml", 80,
     (f"{CONVERT} {SEEN} --video {{}}/film.mp4 --embed-video", f"{CONVERT} {SEEN} --video {{}}/film.mp4",
      "view {}/out.mcap --save {}/out.rrd --overwrite")),
    ("film", "scene.mcap scene.estimate.mcap", "", 100,
     (f"report {{}}/scene.estimate.mcap --recording {{}}/scene.mcap --out {{}}/out.html {FILM}",)),
    # Those that solve: seldom, as each takes a second or so.
    ("smooth-plain", "whole_plain.mcap", "", 400, ("smooth {}/whole_plain.mcap --out {}/out.mcap --overwrite",)),
    ("smooth-scene", "whole_scene.mcap", "", 400, ("smooth {}/whole_scene.mcap --out {}/out.mcap --overwrite",)),
    ("stream-plain", "whole_plain.mcap", "", 300,
     ("stream {}/whole_plain.mcap --start-s 0.2 --lag-s 0.2 --out {}/out.mcap --overwrite",)),
    ("graph-scene", "whole_scene.mcap", "", 250, ("graph {}/whole_scene.mcap --picture {}/out.svg --overwrite",)),
)  # fmt: skip
APART = frozenset({"video", "board-video", "board-floor"})  # native libraries may crash
LIBRARIES = {"video": "av", "film": "av"}


def scene_cases() -> list[Case]:
    """Read whole, by the commands, and as streams."""
    stream = "vip-factors stream - < {}/a.messages"
    readers: tuple[tuple[str, str, str, Callable[[Path], object], str, int], ...] = (
        ("plain-mcap", "plain.mcap", "", partial(_recording, name="plain"), "vip-factors info {}/plain.mcap", 15),
        ("scene-mcap", "scene.mcap", "", partial(_recording, name="scene"), "vip-factors info {}/scene.mcap", 15),
        *(
            (f"{name}-estimate", f"{name}.mcap {name}.estimate.mcap", f"{name}.mcap", partial(_estimate, name=name),
             f"vip-factors evaluate {{}}/{name}.estimate.mcap --truth {{}}/{name}.mcap", 25)
            for name in ("plain", "scene")
        ),
        ("live-stream", "a.messages", "", _stream, stream, 2),
        ("live-websocket", "a.messages", "", _websocket, "vip-factors stream ws://127.0.0.1:5555", 3),
        ("live-file", "scene.mcap", "", _growing, "vip-factors stream {}/scene.mcap --follow", 3),
    )  # fmt: skip
    cases = [
        Case(name, partial(_content, files), read, command, tuple(sound.split()), seldom)
        for name, files, sound, read, command, seldom in readers
    ]
    for name, files, sound, seldom, lines in COMMANDS:
        if name not in LIBRARIES or find_spec(LIBRARIES[name]):
            command, kept = " && ".join(f"vip-factors {line}" for line in lines), sound.replace("log/", _log_names())
            read, make = partial(_run_commands, lines=lines), partial(_content, files)
            cases.append(Case(name, make, read, command, tuple(kept.split()), seldom, name in APART))
    return cases


def _log_names() -> str:
    return " ".join(xsens_log())


def _run_commands(folder: Path, lines: tuple[str, ...]) -> None:
    """Without the lines that they print; what a user can mend is raised."""
    for line in lines:
        command, *words = line.replace("{}", str(folder)).split(" ")
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            run_command(command, words)


def _content(names: str) -> Files:
    """Files by their names, and all of a folder by its name with a slash."""
    found: dict[str, bytes] = {}
    for name in names.split():
        for files in (_scene_files, _further_files, _filmed_files):
            own = {one: data for one, data in files().items() if one == name or one.startswith(name.rstrip("/") + "/")}
            found |= own
            if own:
                break
    return found


def _simulated(seconds: float) -> Scene:
    """One wearer of six sensors, filmed by a camera with a sensor of its own; with the truth. Of the body
    only the stature is told, so that an estimate has all parts that one can have."""
    motion = gestures(seconds)
    performer = Performer("ann", motion, preset("sip6", motion.skeleton), "n-pose")
    scene = simulate_scene([performer], SceneSettings(camera="hand-held"), seed=1)
    return replace(scene, wearers=tuple(replace(wearer, subject=Subject("ann", 1.75)) for wearer in scene.wearers))


@cache
def _scene_files() -> Files:
    """A scene and one wearer alone, estimates of both, and the scene as live messages."""
    scene = _simulated(SECONDS)
    settings = Settings(frame_rate=15.0, covariance=True, solve=SolveSettings(max_iterations=2))

    estimate, (wearer,) = smooth(scene, settings), scene.wearers
    few = replace(wearer, imus={name: one.cut(0.0, 0.2) for name, one in wearer.imus.items()})  # quick to read

    def write(folder: Path) -> None:
        write_recording(replace(scene, wearers=(few,)), folder / "scene.mcap")
        write_recording(few, folder / "plain.mcap")
        write_estimate(estimate, folder / "scene.estimate.mcap")
        write_estimate(Estimate.of_one(estimate.wearers[0]), folder / "plain.estimate.mcap")
        with open(folder / "a.messages", "wb") as file:
            write_messages(replace(scene, wearers=(few,)), file)

    return written(write)


@cache
def _further_files() -> Files:
    """What is beside recordings: motions, 2D poses, cameras, logs, views of a board."""
    plain, log = _scene_files()["plain.mcap"], xsens_log()
    wearer = _simulated(SECONDS).wearers[0]
    assert wearer.truth is not None
    camera = (
        f"width = {WIDTH}\nheight = {HEIGHT}\nfx = 50\nfy = 50\ncx = {WIDTH / 2}\ncy = {HEIGHT / 2}\ndistortion = []\n"
    )
    board = (
        f"width = {BOARD_WIDTH}\nheight = {BOARD_HEIGHT}\nfx = {FOCAL}\nfy = {FOCAL}\ncx = {BOARD_WIDTH / 2}\n"
        f"cy = {BOARD_HEIGHT / 2}\ndistortion = [0.0, 0.0, 0.0, 0.0]\n"
    )
    # A calibration of two cameras, and OpenPose's folders of both, as Pose2Sim has them.
    lab = "".join(
        f'[{name}]\nname = "{name}"\nsize = [{WIDTH}.0, {HEIGHT}.0]\nmatrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], '
        f"[0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [1.57, {turn}, 0.0]\n"
        "translation = [0.5, 1.5, 4.0]\nfisheye = false\n\n"
        for name, turn in (("left", 0.0), ("right", 0.3))
    )

    def write(folder: Path) -> None:
        people = {number: [_standing("coco17")] for number in range(1, FRAMES + 1)}
        write_mmpose(folder / "poses.json", people, keypoint_set("coco17").keypoints)
        for name in ("left", "right"):
            write_openpose(folder / f"{name}_json", {number: [_standing("body25")] for number in range(3)}, f"{name}_")
        write_video(folder / "views.avi", [_board(view) for view in range(4)])

    return {
        **written(write), **written_motions(wearer.truth.motion), **log,
        **{f"held/{name[4:]}": one for name, one in log.items()},
        "more.mcap": plain, "camera.toml": (camera + FLOOR).encode(), "Calib.toml": lab.encode(),
        "board.toml": board.encode(), "floor.png": png_bytes(_board(1)),
    }  # fmt: skip


@cache
def _filmed_files() -> Files:
    """A film, a scene with images of its video inside, one long enough for clocks, and what can be solved."""
    scene, filmed = _simulated(SECONDS), _simulated(FILMED_SECONDS)
    camera = scene.camera
    assert camera is not None
    images = {0: jpeg_bytes(_moving_square(0)), 3: png_bytes(_moving_square(3))}
    wearer = filmed.wearers[0]
    few = replace(wearer, imus={name: wearer.imus[name] for name in list(wearer.imus)[:3]})

    def write(folder: Path) -> None:
        if find_spec("av"):
            with film_file(folder / "film.mp4", 10.0, overwrite=False) as add:  # H.264
                for frame in range(2 * FRAMES):
                    add(_moving_square(frame))
        shown = replace(camera, video=Video(None, images))
        write_recording(replace(scene, cameras=(shown,)), folder / "images.mcap")
        write_recording(replace(filmed, wearers=(few,)), folder / "filmed.mcap")
        write_recording(scene, folder / "whole_scene.mcap")
        write_recording(scene.wearers[0], folder / "whole_plain.mcap")

    return written(write)


def _standing(keypoints: str) -> np.ndarray:
    """Keypoints ``(K, 3)`` of one who stands in the small picture."""
    return person(keypoints, x=28, y=4, height=40)


def _moving_square(frame: int) -> np.ndarray:
    """``(48, 64, 3)`` bytes."""
    image = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    image[..., 1] += np.arange(WIDTH, dtype=np.uint8)
    image[10:30, 5 + frame : 25 + frame] = (220, 40, 30)
    return image


def _board(view: int) -> np.ndarray:
    """A checkerboard ``(150, 200, 3)`` bytes, tilted otherwise in every view."""
    v, u = np.mgrid[:BOARD_HEIGHT, :BOARD_WIDTH]
    ray = np.stack([(u - BOARD_WIDTH / 2) / FOCAL, (v - BOARD_HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    R = exp(np.array([0.4 * np.cos(2.0 * view), 0.4 * np.sin(2.0 * view), 0.1 * view]))
    centre = np.array([0.15 * np.cos(view), 0.1 * np.sin(view), 7.0 + 0.3 * (view % 3)])
    on_board = ray @ np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], centre])).T
    x, y = on_board[..., 0] / on_board[..., 2] + (COLUMNS + 1) / 2, on_board[..., 1] / on_board[..., 2] + (ROWS + 1) / 2
    inside = (x >= 0) & (x < COLUMNS + 1) & (y >= 0) & (y < ROWS + 1)
    black = inside & ((np.floor(x) + np.floor(y)) % 2 == 0)
    return np.repeat(np.where(black, 20, 235).astype(np.uint8)[..., None], 3, axis=2)


def _recording(folder: Path, name: str) -> None:
    """As ``info``, and as far as ``smooth`` goes before it solves."""
    path = folder / f"{name}.mcap"
    terminal_text(file_tables(path))
    for wearer in open_source([path], 0.0).wearers:
        wearer.between(0.0, 0.1)
    scene = read_scene(path)
    if scene.camera is None or name == "plain":
        stream_head(scene)
        for _ in live_samples(scene):
            pass


def _estimate(folder: Path, name: str) -> None:
    """As ``info``, ``evaluate`` and ``body`` do."""
    path = folder / f"{name}.estimate.mcap"
    terminal_text(file_tables(path))
    estimate, scene = read_estimate(path), read_scene(folder / f"{name}.mcap")
    wearer = scene.wearers[0]
    if name == "plain" and len(estimate.wearers) == 1 and wearer.truth is not None:
        str(evaluate(estimate.wearers[0], wearer.truth))
    else:
        str(evaluate_scene(estimate, scene))


def _stream(folder: Path) -> None:
    """As a pipe does; what ends the stream is told, and nothing is raised."""
    client = Client(Session(lambda item: None), "fuzz")
    with (folder / "a.messages").open("rb") as stream:
        client.leave(follow(client, stream))


def _websocket(folder: Path) -> None:
    """As one connection does after its handshake: binary messages, and after a damaged one a text."""
    client = Client(Session(lambda item: None), "fuzz")
    data, at = (folder / "a.messages").read_bytes(), 0
    try:
        while at < len(data):
            size, start = varint(data, at)
            message, at = data[start : start + size], start + max(size, 0)
            for content in (message, message[:20].decode("latin1")):
                with suppress(FileFormatError):
                    client.take(content)
    except ClientError as error:
        client.leave(str(error))


def _growing(folder: Path) -> None:
    """As a file that another program writes."""
    quick = LiveSourceSettings(growth_wait=0.001)
    with GrowingFileSource(folder / "scene.mcap", quick) as source:
        source.on_finding = lambda finding: None
        for _ in source:
            pass
