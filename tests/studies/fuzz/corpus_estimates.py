"""What is made of estimates, and of recordings beside them: drawings, films, pages, other programs' files, figures."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.studies.fuzz.case import Case, Files, command_case, installed, written, written_motions
from tests.studies.fuzz.corpus_scenes import scene_files, small_scene
from vip_factors.body.kinematics import Motion

NEEDS = {"glb": "pygltflib", "c3d": "ezc3d"}
SUFFIXES = ("bvh", "glb", "npz", "csv", "trc", "mot", "sto", "c3d", "pkl")


def estimate_cases() -> list[Case]:
    """By the commands that take an estimate."""
    case = command_case
    scene, plain = _files("scene"), _files("plain")
    of_scene, of_plain = ("{}/scene.mcap {}/scene.estimate.mcap", "{}/plain.mcap {}/plain.estimate.mcap")
    film = "--video-height 64 --video-rate 5 --overwrite"
    cases = [
        case("view-scene", scene, f"view {of_scene} --save {{}}/out.rrd --overwrite", seldom=80),
        case("view-plain", plain, f"view {of_plain} --save {{}}/out.rrd --overwrite", seldom=60),
        case("view-motion", written_motions(true_motion()), "view {}/a.bvh --save {}/out.rrd --overwrite", seldom=40),
        case("view-images", _images(), "view {}/scene.mcap --save {}/out.rrd --overwrite", seldom=50),
        case("picture-scene", scene, f"view {of_scene} --picture {{}}/out.png --overwrite", seldom=250),
        case("picture-plain", plain, f"view {of_plain} --picture {{}}/out.png --overwrite", seldom=250),
        case("picture-images", _images(), "view {}/scene.mcap --picture {}/out.png --overwrite", seldom=200),
        case("chart-scene", scene, f"view {of_scene} --chart {{}}/out.png --overwrite", seldom=50),
        case("chart-plain", plain, f"view {of_plain} --chart {{}}/out.png --overwrite", seldom=50),
        case("report-scene", scene, f"report {_truthful('scene')} --out {{}}/out.html --overwrite", seldom=150),
        case("report-plain", plain, f"report {_truthful('plain')} --out {{}}/out.html --overwrite", seldom=100),
        case("body-picture", plain,
             "body {}/plain.estimate.mcap --truth {}/plain.mcap --picture {}/out.svg --overwrite", seldom=10),
        case("evaluate-scene", scene, "evaluate {}/scene.estimate.mcap --truth {}/scene.mcap",
             sound=("scene.estimate.mcap",), seldom=20),
        case("evaluate-plain", plain, "evaluate {}/plain.estimate.mcap --truth {}/plain.mcap",
             sound=("plain.estimate.mcap",), seldom=15),
    ]  # fmt: skip
    for suffix in ("bvh", "npz"):
        files = {name: content for name, content in written_motions(true_motion()).items() if name.endswith(suffix)}
        estimate = {"plain.estimate.mcap": plain["plain.estimate.mcap"]}
        line = f"evaluate {{}}/plain.estimate.mcap --truth {{}}/a.{suffix}"
        cases.append(case(f"evaluate-{suffix}", files | estimate, line, sound=tuple(estimate), seldom=15))
    for suffix in SUFFIXES:
        name = "scene" if suffix in ("pkl", "glb", "c3d") else "plain"
        one = {f"{name}.estimate.mcap": scene_files()[f"{name}.estimate.mcap"]}
        line = f"export {{}}/{name}.estimate.mcap {{}}/out.{suffix} --overwrite"
        if installed(NEEDS.get(suffix, "numpy")):
            cases.append(case(f"export-{suffix}", one, line, seldom=40 if suffix in NEEDS else 12))
    if installed("PIL"):
        line = f"view {of_scene} --video {{}}/out.gif --headings {{}}/live.mcap {film}"
        cases.append(case("film", {**scene, "live.mcap": _live_estimate()}, line, seldom=100))
    return cases


def _files(name: str) -> Files:
    return {one: scene_files()[one] for one in (f"{name}.mcap", f"{name}.estimate.mcap")}


def _truthful(name: str) -> str:
    return f"{{}}/{name}.estimate.mcap --recording {{}}/{name}.mcap"


def true_motion() -> Motion:
    """Of the wearer."""
    truth = small_scene().wearers[0].truth
    assert truth is not None
    return truth.motion


def _live_estimate() -> bytes:
    """Of the wearer, over four frames."""
    from vip_factors.io.live_mcap import LiveMcapSink
    from vip_factors.live_estimate import LiveEstimate, LivePose, LiveWearerEstimate
    from vip_factors.sensors.live import stream_head
    from vip_factors.sensors.scene import Scene

    wearer = small_scene().wearers[0]
    truth = wearer.truth
    assert truth is not None
    assert truth.calibration is not None
    setup, motion, name = stream_head(Scene("a", (wearer,))), truth.motion, wearer.subject.name
    with TemporaryDirectory() as folder:
        path = Path(folder, "live.mcap")
        with LiveMcapSink(path, setup, rate=2.0) as sink:  # so few frames that each has its calibration
            for frame in range(4):
                time = frame / 2
                pose = LivePose(time, motion.R_parent_child[frame], motion.p_world_pelvis[frame], None, None)
                one = LiveWearerEstimate(name, pose, pose, truth.calibration, 0)
                sink.write(LiveEstimate(frame, time, (one,), None, None, (), 0.005))
        return path.read_bytes()


def _images() -> Files:
    """The scene with images of its video inside."""
    from tests.studies.fuzz.corpus_filmed import moving_square
    from vip_factors.io.mcap_recording import write_scene
    from vip_factors.sensors.scene import Video
    from vip_factors.viz.images import jpeg_bytes, png_bytes

    scene = small_scene()
    assert scene.camera is not None
    images = {frame: png_bytes(moving_square(frame)) if frame else jpeg_bytes(moving_square(0)) for frame in (0, 3)}
    filmed = replace(scene, camera=replace(scene.camera, video=Video(None, images)))
    return written(lambda folder: write_scene(filmed, folder / "scene.mcap"))
