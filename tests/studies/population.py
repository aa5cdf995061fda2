"""Many people, clips, suits and cameras: the study that weights are chosen on, and judged on by clips left out.

Scenes come from a simulator that shares nothing with the package (a program beside it) and from public motion capture.
Each is made once, into a folder; each row is kept as it is made, so that a study that was interrupted goes on. Clips of
some performers are for choosing weights, those of the others for judging them; bodies, straps, detectors and cameras
differ from scene to scene.
"""

import json
import subprocess
import sys
import time as clock
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from tests.studies.study import Study, Tell, group, table
from vip_factors.cli.options import read_settings
from vip_factors.errors import VipFactorsError
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import mean_rotation, rotation_z, transpose
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.scene_building import add_cameras
from vip_factors.io.settings import CameraOptions
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

# Performers whose clips weights are chosen on; walks, runs, dances and games are in both halves.
CHOOSING = frozenset({"03", "05", "07", "09", "10", "12"})
SHORT_S = 5.0  # a clip shorter than this is followed by another of its performer
FRAME_RATE = 60.0  # of the simulator
PRESET = "totalcapture13"  # whose names the simulator uses, of ten and six sensors too
ERRORS = ("constant", "posture")  # that constants take up, or that go with the joints' angles
COLUMNS = {
    "mpjpe": "MPJPE mm", "mpjae": "MPJAE °", "worst_bone_deg": "worst bone °", "knee_flexion_rmse": "knee °",
    "length_error": "lengths mm", "nees_lengths": "NEES: lengths", "nees_mounting": "mountings",
    "nees_heading": "headings",
}  # fmt: skip


@dataclass(frozen=True)
class PopulationScene:
    """One scene of the study.

    Attributes:
        clips: of the motion capture, played one after the other.
        seed: of body, straps, tissue, detector and camera.
        camera: a tripod at an unknown place, a hand with an IMU on the camera, or none.
        sensors: 13, 10 or 6.
        pose: declared at the start.
        errors: ``posture`` where sensors and keypoints move with the joints' angles.
    """

    clips: tuple[str, ...]
    seed: int
    camera: Literal["tripod", "carried", "none"] = "tripod"
    sensors: int = 13
    pose: Literal["t", "n", "none"] = "t"
    errors: str = "posture"

    @property
    def name(self) -> str:
        """Of its row and its folder."""
        return f"{self.seed}_{'+'.join(self.clips)}_{self.camera}_{self.sensors}_{self.pose}_{self.errors}"

    @property
    def is_for_choosing(self) -> bool:
        """Whether weights may be chosen on it."""
        return self.clips[0][:2] in CHOOSING

    def arguments(self) -> list[str]:
        """Of the simulator, after the folders."""
        straps = "usual" if self.pose == "none" else "any"  # with neither a pose nor a strap nothing is known
        said = [f"clips={','.join(self.clips)}", f"sensors={self.sensors}", f"pose={self.pose}", f"straps={straps}"]
        scene = "carried" if self.camera == "carried" else "standing"
        return [scene, str(self.seed), *said, *(["errors=posture"] if self.errors == "posture" else [])]


def population(motions: Path, seed: int = 24) -> tuple[PopulationScene, ...]:
    """A scene for every clip of a folder of BVH files, drawn by lot: two thirds with errors that go with posture."""
    seconds = {path.stem: _seconds(path) for path in sorted(motions.glob("*/*.bvh"))}
    random, found = np.random.default_rng(seed), list[PopulationScene]()
    for number, (clip, length) in enumerate(seconds.items()):
        others = [
            second for second in seconds if second[:2] == clip[:2] and second != clip and seconds[second] < 2 * SHORT_S
        ]
        clips = (clip, str(random.choice(others))) if length < SHORT_S and others else (clip,)
        pose = random.choice(["t", "n", "none"], p=[0.7, 0.2, 0.1])
        camera = random.choice(["tripod", "carried", "none"], p=[0.6, 0.2, 0.2])
        sensors = int(random.choice([13, 10, 6], p=[0.6, 0.2, 0.2]))
        errors = "constant" if number % 3 == 0 else "posture"
        found.append(PopulationScene(clips, 1000 + number, str(camera), sensors, str(pose), errors))  # type: ignore[arg-type]
    return tuple(found)


def _seconds(path: Path) -> float:
    with path.open(encoding="utf-8", errors="replace") as file:
        lines = [line for line in file if line.startswith(("Frames:", "Frame Time:"))]
    return int(lines[0].split()[-1]) * float(lines[1].split()[-1])


def made(scene: PopulationScene, simulator: Path, motions: Path, folder: Path) -> Path:
    """The scene's recording, simulated if it does not lie in the folder yet; its truth knows the best-fit mountings."""
    out = folder / f"{scene.name}.mcap"
    if out.exists():
        return out
    raw = folder / "raw" / scene.name
    subprocess.run([sys.executable, simulator, raw, motions, *scene.arguments()], check=True, stdout=subprocess.DEVNULL)
    wearer = raw / "wearer1"
    about = json.loads((wearer / "subject.json").read_text(encoding="utf-8"))
    options = ImportOptions(
        placement=PRESET, stature_m=about["stature_m"], initial_pose=about["initial_pose"], subject="wearer1"
    )
    recording = _with_known_calibration(import_recording(wearer / "imu.sensors", options), wearer / "truth.npz")
    whole = Scene(scene.name, (recording,))
    if scene.camera != "none":
        carried = scene.camera == "carried"
        log = raw / "camera_imu.sensors" if carried else None
        filmed = CameraOptions(
            raw / "openpose", raw / "camera.toml", video_rate=FRAME_RATE, static_camera=not carried, camera_imu_log=log
        )
        whole = add_cameras(whole, [filmed])
    write_recording(whole, out)
    return out


def _with_known_calibration(recording: Recording, truth: Path) -> Recording:
    """The recording with true headings, and the mountings that fit best over its time: tissue moves about them."""
    assert recording.truth is not None
    known, motion = np.load(truth), recording.truth.motion
    bones = motion.state.R_world_bone
    calibration: dict[str, SensorCalibration] = {}
    for sensor, heading in zip(known["sensors"].tolist(), np.radians(known["heading_deg"]).T, strict=True):
        site, stream = recording.placement.site(sensor), recording.imus[sensor]
        assert stream.R_inertial_sensor is not None
        count = min(len(bones), len(stream.time))
        R_world_sensor = rotation_z(heading[:count]) @ stream.R_inertial_sensor[:count]
        R_bone_sensor = mean_rotation(transpose(bones[:count, site.bone_index]) @ R_world_sensor)
        calibration[sensor] = SensorCalibration(float(heading[0]), R_bone_sensor, bone=site.bone)
    return replace(recording, truth=replace(recording.truth, calibration=calibration))


@dataclass(frozen=True)
class PopulationRow:
    """What became of one scene.

    Attributes:
        scene: its name.
        metrics: by name, of :data:`COLUMNS`; NaN where they are not defined.
        findings: what was told.
        cpu_s: of the solution, this process alone.
        failure: why there is none, or nothing.
    """

    scene: str
    metrics: Mapping[str, float]
    findings: tuple[str, ...] = ()
    cpu_s: float = 0.0
    failure: str = ""


def measured(name: str, scene: Scene, settings: Settings) -> PopulationRow:
    """A scene with one wearer solved and measured."""
    begin = clock.process_time()
    try:
        estimate = smooth(scene, settings)
        cpu_s, found = clock.process_time() - begin, evaluate_scene(estimate, scene)
    except VipFactorsError as error:
        return PopulationRow(name, dict.fromkeys(COLUMNS, float("nan")), failure=str(error))
    (wearer,) = found.wearers.values()
    values = {key: one.value for key, one in (*wearer.metrics.items(), *found.metrics.items())}
    values["worst_bone_deg"] = max(row["orientation_deg"] for row in wearer.joints.values())
    told = dict.fromkeys((*estimate.findings, *estimate.wearers[0].findings))
    return PopulationRow(name, {key: values.get(key, float("nan")) for key in COLUMNS}, sentences(told), cpu_s)


@dataclass(frozen=True, kw_only=True)
class Simulated(Study):
    """What studies of simulated people have in common."""

    simulator: Path
    """The program that makes scenes: SIMULATOR OUT MOTIONS SCENE SEED [clips=…] [sensors=…] [pose=…] [errors=…]."""
    motions: Path
    """Folder of motion capture (BVH)."""
    folder: Path
    """Where scenes and rows are kept: what is there is not made again."""
    frame_rate: float = 60.0
    """Hz of the estimates."""
    jobs: int = 2
    """Processes."""

    def solved(self, scenes: Sequence[PopulationScene], settings: Settings, tell: Tell) -> Iterator[PopulationRow]:
        """A row for each scene, those that were kept first."""
        effective = replace(settings, frame_rate=self.frame_rate)
        kept = self.folder / f"rows_{zlib.crc32(repr(effective).encode()):08x}.jsonl"
        known = {row["scene"]: row for row in map(json.loads, kept.read_text().splitlines())} if kept.exists() else {}
        yield from (PopulationRow(**known[scene.name]) for scene in scenes if scene.name in known)
        left = [scene for scene in scenes if scene.name not in known]
        with ProcessPoolExecutor(self.jobs) as pool:
            work = [pool.submit(_row, one, self.simulator, self.motions, self.folder, effective) for one in left]
            for done, finished in enumerate(as_completed(work), start=len(scenes) - len(left)):
                row = finished.result()
                tell(row.scene, done / len(scenes))
                with kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
                yield row


def _row(scene: PopulationScene, simulator: Path, motions: Path, folder: Path, settings: Settings) -> PopulationRow:
    with threadpool_limits(limits=1):
        return measured(scene.name, read_scene(made(scene, simulator, motions, folder)), settings)


@dataclass(frozen=True, kw_only=True)
class Population(Simulated):
    """People, clips, suits and cameras drawn by lot, of a simulator that shares nothing with the package."""

    half: Literal["choosing", "judging", "both", "neither"] = "judging"
    """Scenes of the performers for choosing weights, or of the others."""
    standing: int = 0
    """So many more scenes of the judging half each with constant errors and with those of posture: 13 sensors, T-pose,
    tripod, one clip each, drawn by lot."""
    settings: Path | None = None
    """TOML file; the package's own settings if absent."""

    def rows(self, tell: Tell) -> Iterator[PopulationRow]:
        own = Settings()
        own = own if self.settings is None else read_settings(self.settings, own)
        yield from self.solved(self.scenes(), own, tell)

    def scenes(self) -> tuple[PopulationScene, ...]:
        """All that are wanted."""
        drawn = population(self.motions)
        halves = {"choosing": (True,), "judging": (False,), "both": (True, False), "neither": ()}[self.half]
        clips = sorted({one.clips[0] for one in drawn if not one.is_for_choosing})
        random = np.random.default_rng(5)
        more = [
            PopulationScene((str(clip),), 100 + 30 * number + n, errors=errors)
            for number, errors in enumerate(ERRORS)
            for n, clip in enumerate(random.choice(clips, min(self.standing, len(clips)), replace=False))
        ]
        return (*(one for one in drawn if one.is_for_choosing in halves), *more)

    def tables(self, rows: Sequence[PopulationRow]) -> Iterator[str]:
        """Median, 90 % and worst of each metric, by what films and how errors behave."""
        groups = {("all",): list(rows), **group(rows, lambda row: tuple(row.scene.split("_")[-4:]))}
        lines = [
            [" ".join(key), len(those), *(_spread([one.metrics[name] for one in those]) for name in COLUMNS),
             f"{sum(bool(one.findings) for one in those)}, {sum(bool(one.failure) for one in those)}"]
            for key, those in groups.items()
        ]  # fmt: skip
        yield table(["scenes", "number", *COLUMNS.values(), "with findings, failed"], lines)


def _spread(values: Sequence[float]) -> str:
    known = [value for value in values if np.isfinite(value)]
    return " / ".join(f"{one:.1f}" for one in np.quantile(known, [0.5, 0.9, 1.0])) if known else "n/a"
