"""TotalCapture (Trumble et al. 2017) as scenes: its sensors, one of its cameras, and 2D poses.

Each folder that holds one sequence (see :mod:`vip_factors.io.importers.totalcapture`) is one; ``calibration.cal`` lies
beside it or in a folder above. 2D poses are OpenPose's JSON files in a folder beside the sensors; the dataset has none,
so without them they are made by the simulator's detector from the optical motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.studies.scenes import Clip
from tests.studies.study import Fixed, Tell
from tests.studies.vip import Trial, VipTables, run_scene
from tests.studies.vip_variants import chosen_variants
from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, nearest_rotation, transpose, yaw_of
from vip_factors.io.detections.read import read_detections
from vip_factors.io.importers import totalcapture
from vip_factors.io.importers.shared import ImportedLog
from vip_factors.io.importers.totalcapture import R_WORLD_VICON
from vip_factors.io.importers.totalcapture_files import sensors_file
from vip_factors.sensors.calibration import CARELESS_MOUNTING_SIGMA, SensorCalibration
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.recording import Recording, Subject, Truth
from vip_factors.sensors.scene import Camera, Scene, SceneTruth
from vip_factors.simulate.dense import dense_motion
from vip_factors.simulate.detector import detect, owners
from vip_factors.simulate.detector_view import Person, look
from vip_factors.simulate.settings import DetectorSettings

TEST_SPLIT = ("walking2", "freestyle3", "acting3")  # of all subjects, as everybody reports it
CALIBRATION = "calibration.cal"
VIDEO_HZ = 60.0
SKIPPED_S = 1.0  # of the T-pose at the start: not compared


@dataclass(frozen=True)
class Capture:
    """One sequence: its folder, ``s1_walking2``, and the kind of motion, ``walking``."""

    folder: Path
    name: str
    kind: str


@dataclass(frozen=True, kw_only=True)
class TotalCapture(VipTables):
    """The thesis's video-inertial trackers on TotalCapture's test sequences.

    2D poses are OpenPose's JSON in a folder beside each .sensors file, or else made by the simulator's detector from
    the optical motion.
    """

    folder: Path
    """Of the dataset, or of one sequence."""
    clips: tuple[str, ...] = ()
    """Names of sequences, with or without the subject; the test split if absent."""
    kinds: tuple[str, ...] = ()
    """Kinds of motion, such as walking; all if absent."""
    seconds: float = 30.0
    """Of each sequence, from the start, where the T-pose is; 0 for all."""
    camera: int = 1
    """Which of the cameras, counted from one, in the order of the calibration."""
    every: Fixed[int] = 2  # video frame: 30 Hz, as phones film and detectors are mostly run
    keypoints: Fixed[str] = "openpose18"  # of detections made here

    def rows(self, tell: Tell) -> Iterator[Trial]:
        wanted, chosen = chosen_variants(self.variants), _chosen(sequences(self.folder), self.clips, self.kinds)
        for done, one in enumerate(chosen):
            scene, origin = totalcapture_scene(one, self)
            clip = Clip(f"{one.kind}", one.name, one.folder, done)
            tell(f"{one.name}, 2D poses {origin}", done / len(chosen))
            yield from run_scene(scene, clip, wanted, self.settings, skip_s=SKIPPED_S)

    def title(self, rows: Sequence[Trial]) -> str:
        length = f"{self.seconds:g} s of each sequence" if self.seconds > 0 else "whole sequences"
        folders = {one.name: one.folder for one in sequences(self.folder)}
        known = {trial.clip for trial in rows if _openpose(folders[trial.clip])}
        origin = f"OpenPose's for {len(known)} sequences, of the others made by the simulator's detector"
        return f"MPJPE mm / MPJAE deg on TotalCapture, camera {self.camera}, {length}. 2D poses: {origin}"


def sequences(folder: Path) -> list[Capture]:
    """All folders with one sequence each, at or below a folder."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected TotalCapture's folder")
    inside = [folder, *sorted(path for path in folder.rglob("*") if path.is_dir())]
    found = [_sequence(one) for one in inside if totalcapture.matches(one)]
    if not found:
        raise InputError(f"{folder}: no .sensors file of TotalCapture there or below")
    return found


def _sequence(folder: Path) -> Capture:
    words = [word for word in sensors_file(folder).stem.split("_") if word not in ("Xsens", "AuxFields")]
    motion = words[-1].lower() if words else folder.name.lower()
    return Capture(folder, "_".join(words).lower() or folder.name, motion.rstrip("0123456789"))


def _chosen(found: list[Capture], names: Sequence[str], kinds: Sequence[str]) -> list[Capture]:
    wanted = [name.lower() for name in names] or list(TEST_SPLIT)
    chosen = [one for one in found if one.name in wanted or one.name.split("_")[-1] in wanted]
    if not names and not chosen:  # somebody's own choice of sequences
        chosen = found
    chosen = [one for one in chosen if not kinds or one.kind in kinds]
    if not chosen:
        raise InputError(f"none of these sequences is there: {', '.join(one.name for one in found)} are")
    return chosen


def totalcapture_scene(sequence: Capture, trials: TotalCapture) -> tuple[Scene, str]:
    """One sequence as a scene, and where its 2D poses came from."""
    recording = _recording(sequence, trials)
    assert recording.truth is not None
    cameras = read_cameras(_calibration(sequence.folder, trials.folder))
    if not 1 <= trials.camera <= len(cameras):
        raise InputError(f"camera {trials.camera}: {sequence.folder} has {len(cameras)}, counted from one")
    model, path = cameras[trials.camera - 1]
    keypoints, start, end = keypoint_set(trials.keypoints), *_common(recording)
    if openpose := _openpose(sequence.folder):
        detections = read_detections(openpose[0], VIDEO_HZ)
        detections = _thinned(detections, trials.every, start, end)
        keypoints, origin = detections.keypoints, f"OpenPose's of {openpose[0].name}"
    else:
        detections, origin = None, "made by the simulator's detector from the optical motion"
    rate = VIDEO_HZ / trials.every
    time = start + np.arange(int((end - start) * rate + 1e-6) + 1) / rate if detections is None else detections.time
    dense = dense_motion(recording.truth.motion, None)
    person = Person(dense.skeleton, dense.state(np.clip(time, dense.start, dense.end)), np.ones(len(time), bool))
    film = path.at(time)
    if detections is None:
        detections, owner, pixels = detect([person], film, model, keypoints, DetectorSettings.realistic(), 0)
    else:
        view = look([person], film, model, keypoints, np.zeros((1, len(keypoints), 3)))
        owner = owners(detections, view, keypoints)
        pixels = np.where((owner >= 0)[:, None, None], view.pixels[0, detections.frame], np.nan)
    camera = Camera(f"camera{trials.camera}", model, detections, moving=False)
    return Scene(sequence.name, (recording,), camera, SceneTruth(path, owner, pixels)), origin


def _openpose(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.is_dir() and any(one.glob("*.json")))


def _common(recording: Recording) -> tuple[float, float]:
    """The time that sensors and optical motion share."""
    assert recording.truth is not None
    start, end = recording.interval
    return max(start, float(recording.truth.motion.time[0])), min(end, float(recording.truth.motion.time[-1]))


def _thinned(detections: Detections, every: int, start: float, end: float) -> Detections:
    """Every n-th video frame, of those within an interval."""
    kept = np.flatnonzero((detections.time >= start - 1e-6) & (detections.time <= end + 1e-6))[::every]
    place = np.full(len(detections.time), -1)
    place[kept] = np.arange(len(kept))
    rows = np.flatnonzero(place[detections.frame] >= 0)
    return replace(
        detections, time=detections.time[kept], frame=place[detections.frame[rows]], pixels=detections.pixels[rows],
        confidence=detections.confidence[rows],
    )  # fmt: skip


def _recording(sequence: Capture, trials: TotalCapture) -> Recording:
    log = totalcapture.read(sequence.folder)
    if log.truth_motion is None or log.placement is None:
        raise FileFormatError(f"{sequence.folder}: lacks its truth or mountings: {'; '.join(log.notes)}")
    imus, motion = dict(log.imus), log.truth_motion
    if trials.seconds > 0:
        imus = {name: stream.cut(stream.time[0], trials.seconds) for name, stream in imus.items()}
        motion = motion.frames(slice(0, int(np.count_nonzero(motion.time <= trials.seconds))))
    # Their mountings stand for straps put on by eye: only the headings are guessed from them, the rest by the T-pose.
    sites = tuple(replace(site, mounting_sigma=CARELESS_MOUNTING_SIGMA) for site in log.placement.sites)
    subject = Subject(stature_m=log.stature_m or 1.72, skeleton=motion.skeleton)
    truth = Truth(motion, _calibration_of(log))
    placement = replace(log.placement, sites=sites)
    return Recording(sequence.name, subject, imus, placement, "t-pose", truth, "\n".join(log.notes))


def _calibration_of(log: ImportedLog) -> dict[str, SensorCalibration]:
    """The published mountings, and the headings that fit the optical motion with them best, all frames alike."""
    assert log.truth_motion is not None
    assert log.placement is not None
    motion, calibration = log.truth_motion, {}
    for site in log.placement.sites:
        frames = resample_streams([log.imus[site.sensor]], motion.time)
        valid = frames.orientation_valid[:, 0]
        R_world_sensor = motion.state.R_world_bone[valid, site.bone_index] @ site.R_bone_sensor
        turn = nearest_rotation((R_world_sensor @ transpose(frames.R_inertial_sensor[valid, 0])).mean(axis=0))
        calibration[site.sensor] = SensorCalibration(float(yaw_of(turn)), site.R_bone_sensor)
    return calibration


def _calibration(folder: Path, top: Path) -> Path:
    for one in (folder, *folder.parents):
        if (one / CALIBRATION).is_file():
            return one / CALIBRATION
        if one == top:
            break
    raise InputError(f"{folder}: no {CALIBRATION} there or above, up to {top}: the study needs the cameras")


def read_cameras(path: Path) -> list[tuple[CameraModel, CameraPath]]:
    """The cameras of a ``calibration.cal``, in our world (z up): intrinsics, and where each stands.

    ``ncam distortion_order``; per camera ``rmin rmax cmin cmax``, ``fx fy cx cy``, ``k1``, three rows of R, t, with
    ``X_cam = R X + t`` in metres and one radial term on normalised coordinates.
    """
    try:
        numbers = np.array(path.read_text(encoding="ascii", errors="replace").split(), dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}; expected numbers alone") from error
    count, each = (int(numbers[0]) if len(numbers) else 0), 4 + 4 + 1 + 9 + 3
    if count < 1 or len(numbers) != 2 + count * each or not np.all(np.isfinite(numbers)):
        raise FileFormatError(f"{path}: {len(numbers)} numbers: expected 2 and {each} for each of {count} cameras")
    if int(numbers[1]) != 1:
        raise FileFormatError(f"{path}: distortion of order {numbers[1]:g}: expected 1, one radial term")
    return [_camera(path, row) for row in numbers[2:].reshape(count, each)]


def _camera(path: Path, row: Array) -> tuple[CameraModel, CameraPath]:
    rows, columns = row[1] - row[0] + 1, row[3] - row[2] + 1
    R, t = row[9:18].reshape(3, 3), row[18:21]
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-2) or np.linalg.det(R) < 0:
        raise FileFormatError(f"{path}: a camera's three rows of R are no rotation")
    R = nearest_rotation(R)
    model = CameraModel(int(columns), int(rows), (row[4], row[5]), (row[6], row[7]), (row[8], 0.0, 0.0, 0.0))
    R_world_camera = R_WORLD_VICON @ R.T
    return model, CameraPath(np.zeros(1), R_world_camera[None], -(R_world_camera @ t)[None])
