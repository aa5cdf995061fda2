"""The package in a dozen functions, for scripts and notebooks: ``import vip_factors as vip``.

A recording of one wearer and a filmed scene of several are both a :class:`~vip_factors.sensors.scene.Scene` here, so
that one set of functions does. What they are made of stays within reach: rooms may be imported directly.
"""

from os import PathLike
from pathlib import Path
from typing import Literal

from vip_factors.body.kinematics import Motion
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.evaluate.evaluation import Evaluation
from vip_factors.io.convert import ImportOptions
from vip_factors.io.export.settings import ExportSettings
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.solver import Progress

StrPath = str | PathLike[str]
SECONDS = 8.0  # of a simulated motion


def read(path: StrPath, *then: StrPath) -> Scene:
    """A recording or scene (.mcap) that :func:`write`, :func:`convert` or the command line made.

    Args:
        path: of the file.
        then: parts of the same recording that follow in time, of one without a camera.

    Raises:
        InputError, FileFormatError, OSError: if it cannot be read.
    """
    from vip_factors.io.scene_building import read_scenes

    return read_scenes([Path(path), *map(Path, then)])


def read_estimate(path: StrPath) -> Estimate:
    """An estimate (.mcap).

    Raises:
        InputError, FileFormatError, OSError: if it cannot be read.
    """
    from vip_factors.io import mcap_estimate

    return mcap_estimate.read_estimate(path)


def write(content: Recording | Scene | WearerEstimate | Estimate, path: StrPath, overwrite: bool = False) -> Path:
    """Write a recording, a scene or an estimate into an MCAP file, with its truth if it has one.

    Returns:
        The path.

    Raises:
        InputError: if the file exists and may not be replaced.
    """
    from vip_factors.io.mcap_estimate_writer import write_estimate
    from vip_factors.io.mcap_recording import write_scene

    if isinstance(content, Recording | Scene):
        write_scene(_scene(content), path, overwrite=overwrite)
    else:
        write_estimate(_estimate(content), path, overwrite=overwrite)
    return Path(path)


def convert(log: StrPath, options: ImportOptions | None = None) -> Scene:
    """A sensor log of any known format as a recording: Xsens, MVNX, OpenSense, TotalCapture, ROS 2, tables …

    Args:
        log: file or folder.
        options: who wore what where, and what was held at the start.

    Raises:
        InputError, FileFormatError, RecordingError: if the log cannot be read or used.
    """
    from vip_factors.io.scene_building import read_log_as_scene

    return read_log_as_scene(Path(log), options or ImportOptions())


def simulate(
    motion: Motion | StrPath | None = None,
    placement: str = "totalcapture13",
    camera: Literal["fixed", "hand-held", "walking"] | None = None,
    seconds: float = SECONDS,
    seed: int = 0,
) -> Scene:
    """What sensors on a person would have measured, with the truth in it; and what a 2D pose detector would have found.

    The person holds an N-pose first.

    Args:
        motion: of the person, or a motion file (.bvh …); a motion that the package makes if absent.
        placement: name of a preset: sip6, tnt10, totalcapture13 or mvn17.
        camera: that films the person; nothing films if absent.
        seconds: of the package's own motion.
        seed: of all errors.

    Raises:
        InputError: for an unknown preset or camera, or a motion file that cannot be read.
    """
    from vip_factors.sensors.calibration import preset
    from vip_factors.simulate.gestures import gestures
    from vip_factors.simulate.recording import simulate_recording
    from vip_factors.simulate.scene import Performer, simulate_scene
    from vip_factors.simulate.scene_settings import SceneSettings
    from vip_factors.simulate.staging import with_initial_pose

    if motion is None:
        motion = gestures(seconds)
    elif not isinstance(motion, Motion):
        from vip_factors.io.motions import read_motion

        motion = read_motion(Path(motion))
    motion = with_initial_pose(motion, "n-pose", seed=seed)
    sites = preset(placement, motion.skeleton)
    if camera is None:
        return _scene(simulate_recording(motion, sites, seed=seed, name=motion.name, initial_pose="n-pose"))
    performer = Performer("wearer_1", motion, sites, "n-pose")
    return simulate_scene([performer], SceneSettings(camera=camera), seed, motion.name)


def smooth(
    recording: Recording | Scene, settings: Settings | None = None, progress: Progress | None = None
) -> Estimate:
    """Reconstruct motion, headings and mountings of the sensors, and of a filmed scene the camera and who is who.

    Args:
        recording: of one wearer, or a scene.
        settings: of all rooms; the package's own if absent.
        progress: called with the name of a stage and the fraction of it that is done.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    from vip_factors import pipeline

    return pipeline.smooth(recording, settings or Settings(), progress)


def evaluate(estimate: WearerEstimate | Estimate, truth: Recording | Scene) -> Evaluation:
    """How far an estimate is from the truth that a recording holds; printed, it begins with the most important.

    Args:
        estimate: of :func:`smooth`.
        truth: the recording with its truth.

    Raises:
        InputError: if the recording holds no truth, or the two are not of the same wearers and times.
    """
    from vip_factors.evaluate.evaluation import evaluate_scene

    return evaluate_scene(_estimate(estimate), _scene(truth))


def export(
    estimate: WearerEstimate | Estimate,
    path: StrPath,
    settings: ExportSettings | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write an estimate into a file of another program; the suffix tells the format.

    Args:
        estimate: of one wearer or several.
        path: of the file; several wearers in a format that holds one get a file each.
        settings: what is written.
        overwrite: whether files that exist may be replaced.

    Returns:
        The files that were written.

    Raises:
        InputError: for an unknown suffix, or a file that may not be written.
    """
    from vip_factors.io.export.files import export as export_file

    return export_file(_estimate(estimate), Path(path), settings or ExportSettings(), overwrite)


def _scene(recording: Recording | Scene) -> Scene:
    return recording if isinstance(recording, Scene) else Scene(recording.name, (recording,))


def _estimate(estimate: WearerEstimate | Estimate) -> Estimate:
    return estimate if isinstance(estimate, Estimate) else Estimate.of_one(estimate)
