"""Recordings, estimates and live streams of half a second, as the package writes them; some are solved."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from threading import Event

import numpy as np

from tests.studies.fuzz.case import Case, Files, command_case, written
from tests.studies.fuzz.containers import varint
from vip_factors.body.hinges import HINGE_OF, HingeEstimate
from vip_factors.body.lengths import LENGTHS
from vip_factors.cli.info import file_text
from vip_factors.estimate import (
    BodyEstimate,
    CameraEstimate,
    DetectorEstimate,
    Estimate,
    Iteration,
    PoseCovariance,
    SensorPlaceEstimate,
    SolveReport,
    StartChoice,
    WearerEstimate,
)
from vip_factors.findings import Finding, bare
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.scene_settings import SceneSettings

SECONDS, FILMED_SECONDS = 0.5, 2.5
TOKEN = "of the sender"


def simulated_scene(seconds: float) -> Scene:
    """One wearer of six sensors, filmed by a camera with a sensor of its own; with the truth."""
    motion = gestures(seconds)
    performer = Performer("ann", motion, preset("sip6", motion.skeleton), "n-pose")
    return simulate_scene([performer], SceneSettings(camera="hand-held"), seed=1)


@cache
def small_scene() -> Scene:
    """The same with the sensors' first samples only."""
    scene = simulated_scene(SECONDS)
    wearer = scene.wearers[0]
    few = {name: one.cut(0.0, 0.2) for name, one in wearer.imus.items()}
    return replace(scene, wearers=(replace(wearer, imus=few),))


def small_estimate(scene: Scene) -> Estimate:
    """The truth, with something in every part that an estimate can have."""
    wearer = scene.wearers[0]
    assert wearer.truth is not None
    assert wearer.truth.calibration is not None
    assert scene.camera is not None
    assert scene.truth is not None
    motion, sensors, T, B = wearer.truth.motion, tuple(wearer.imus), len(wearer.truth.motion), len(LENGTHS)
    columns = len(HINGE_OF["left_knee"].columns)
    hinge = HingeEstimate("left_knee", np.full(columns, 0.01), 1e-3 * np.eye(columns))
    prior = np.full(B, 0.3)
    body = BodyEstimate(LENGTHS, prior, prior + 0.01, 1e-4 * np.eye(B), 1e-5 * np.eye(B), (hinge,), (hinge,))
    places = tuple(
        SensorPlaceEstimate(site.sensor, site.bone, site.p_bone_sensor, site.p_bone_sensor, *np.full((2, 3), 0.01))
        for site in wearer.placement.sites
    )
    report = SolveReport("fusion", (Iteration(3.0, 1e-3, True, {"solve": 0.1}),), {"a": 3.0}, {"a": 1.0}, True, 0.2)
    one = WearerEstimate(
        wearer.name, "VIP", motion, wearer.truth.calibration,
        PoseCovariance(np.tile(1e-4 * np.eye(3), (T, 24, 1, 1)), np.tile(1e-4 * np.eye(3), (T, 1, 1))),
        {"orientation_deg": np.full((T, len(sensors)), 2.0)}, sensors, (report,), {"frame_rate": "60"}, body, places,
        (bare("a finding"),), StartChoice("as declared", "turned", 3.0, sensors[:1]),
    )  # fmt: skip
    path = scene.truth.camera.at(motion.time)
    camera = CameraEstimate(
        scene.camera.name, scene.camera.model, path, None, np.tile(1e-4 * np.eye(6), (T, 1, 1)), np.full((T, 1), 3.0),
        0.01, 1e-5, (0.003, 2e-5),
    )  # fmt: skip
    names = scene.camera.detections.keypoints.keypoints[:4]
    detector = DetectorEstimate(names, *np.full((4, len(names), 3), 0.01))
    return Estimate(
        scene.name, "VIP", (one,), camera, scene.truth.wearer, (report,), (Finding("never seen", scene.name),),
        {"a": "1"}, detector, ("by motion",),
    )  # fmt: skip


@cache
def scene_files() -> dict[str, bytes]:
    """A scene and one wearer alone, estimates of both, and the scene as live messages, with a token."""
    from vip_factors.io.live.open import write_messages
    from vip_factors.io.mcap_estimate_writer import write_estimate
    from vip_factors.io.mcap_recording import write_recording, write_scene

    scene = small_scene()
    estimate = small_estimate(scene)

    def write(folder: Path) -> None:
        write_scene(scene, folder / "scene.mcap")
        write_recording(scene.wearers[0], folder / "plain.mcap")
        write_estimate(estimate, folder / "scene.estimate.mcap")
        write_estimate(Estimate.of_one(estimate.wearers[0]), folder / "plain.estimate.mcap")
        with open(folder / "a.messages", "wb") as file:
            write_messages(scene, file, token=TOKEN)

    return written(write)


def scene_cases() -> list[Case]:
    """Recordings, estimates and streams."""
    content = scene_files()
    cases = [
        Case(
            f"{name}-mcap", {f"{name}.mcap": content[f"{name}.mcap"]},
            partial(_recording, name=name), f"vip-factors info {{}}/{name}.mcap", seldom=15,
        )
        for name in ("plain", "scene")
    ]  # fmt: skip
    for name in ("plain", "scene"):
        files = {one: content[one] for one in (f"{name}.mcap", f"{name}.estimate.mcap")}
        command = f"vip-factors evaluate {{}}/{name}.estimate.mcap --truth {{}}/{name}.mcap"
        read = partial(_estimate, name=name)
        cases.append(Case(f"{name}-estimate", files, read, command, (f"{name}.mcap",), seldom=25))
    stream, command = {"a.messages": content["a.messages"]}, "vip-factors stream - < {}/a.messages"
    cases.append(Case("live-stream", stream, _stream, command, seldom=2))
    cases.append(Case("live-token", stream, partial(_stream, token=TOKEN), command, seldom=20))  # a wrong one waits
    cases.append(Case("live-websocket", stream, _websocket, "vip-factors stream ws://127.0.0.1:5555", seldom=3))
    growing = {"scene.mcap": content["scene.mcap"]}
    cases.append(Case("live-file", growing, _growing, "vip-factors stream {}/scene.mcap --follow", seldom=3))
    return cases


def _recording(folder: Path, name: str) -> None:
    """As ``info``, and as far as ``smooth`` goes before it solves."""
    from vip_factors.io.mcap_source import open_source
    from vip_factors.sensors.live import live_samples, stream_head

    path = folder / f"{name}.mcap"
    file_text(path)
    for wearer in open_source([path], 0.0).wearers:
        wearer.between(0.0, 0.1)
    from vip_factors.io.mcap_recording import read_scene

    scene = read_scene(path)
    if scene.camera is None or name == "plain":
        stream_head(scene)
        for _ in live_samples(scene):
            pass


def _estimate(folder: Path, name: str) -> None:
    """As ``info``, ``evaluate`` and ``body`` do."""
    from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
    from vip_factors.io.mcap_estimate import read_calibration_history, read_estimate
    from vip_factors.io.mcap_recording import read_scene

    path = folder / f"{name}.estimate.mcap"
    file_text(path)
    estimate, scene = read_estimate(path), read_scene(folder / f"{name}.mcap")
    read_calibration_history(path)
    wearer = scene.wearers[0]
    if name == "plain" and len(estimate.wearers) == 1 and wearer.truth is not None:
        str(evaluate(estimate.wearers[0], wearer.truth, wearer.placement))
    else:
        str(evaluate_scene(estimate, scene))


def _stream(folder: Path, token: str = "") -> None:
    """As a pipe does; what ends the stream is told, and nothing is raised."""
    from vip_factors.io.live.session import Client, Session
    from vip_factors.io.live.settings import LiveSourceSettings
    from vip_factors.io.live.streams import listen

    data = (folder / "a.messages").read_bytes()
    pieces = [data[at : at + 4096] for at in range(0, len(data), 4096)]
    client = Client(Session(lambda setup: None, lambda item: None, token), "fuzz")
    client.leave(listen(client, lambda: pieces.pop(0) if pieces else b"", LiveSourceSettings(), Event()))


def _websocket(folder: Path) -> None:
    """As one connection does after its handshake: binary messages, and after a damaged one a text."""
    from vip_factors.io.live.session import Client, ClientError, Session
    from vip_factors.io.live.websocket import take_message

    client = Client(Session(lambda setup: None, lambda item: None), "fuzz")
    data, at = (folder / "a.messages").read_bytes(), 0
    try:
        while at < len(data):
            size, start = varint(data, at)
            message, at = data[start : start + size], start + max(size, 0)
            take_message(client, message)
            take_message(client, message[:20].decode("latin1"))
    except ClientError as error:
        client.leave(str(error))


def _growing(folder: Path) -> None:
    """As a file that another program writes."""
    from vip_factors.io.live.growing import GrowingFileSource
    from vip_factors.io.live.settings import LiveSourceSettings

    quick = LiveSourceSettings(header_wait=0.001, growth_wait=0.001)
    with GrowingFileSource(folder / "scene.mcap", quick, lambda finding: None) as source:
        for _ in source:
            pass


def solved_cases() -> list[Case]:
    """By the commands that solve; seldom, as each takes a second or so."""
    case, files = command_case, _recordings()
    plain, scene = ({f"{name}.mcap": files[f"{name}.mcap"]} for name in ("plain", "scene"))
    filmed = {"filmed.mcap": files["filmed.mcap"]}
    return [
        case("smooth-plain", plain, "smooth {}/plain.mcap --out {}/out.mcap --overwrite", seldom=400),
        case("smooth-scene", scene, "smooth {}/scene.mcap --out {}/out.mcap --overwrite", seldom=400),
        case("stream-plain", plain, "stream {}/plain.mcap --start-s 0.2 --lag-s 0.2 --out {}/out.mcap --overwrite",
             seldom=300),
        case("graph-scene", scene, "graph {}/scene.mcap --picture {}/out.svg --overwrite", seldom=250),
        case("sync-clocks", filmed, "sync {}/filmed.mcap --dry-run", seldom=40),
    ]  # fmt: skip


def _recordings() -> Files:
    from vip_factors.io.mcap_recording import write_recording, write_scene

    scene, filmed = simulated_scene(SECONDS), simulated_scene(FILMED_SECONDS)
    wearer = filmed.wearers[0]
    few = {name: wearer.imus[name] for name in list(wearer.imus)[:3]}

    def write(folder: Path) -> None:
        write_scene(scene, folder / "scene.mcap")
        write_recording(scene.wearers[0], folder / "plain.mcap")
        write_scene(replace(filmed, wearers=(replace(wearer, imus=few),)), folder / "filmed.mcap")

    return written(write)
