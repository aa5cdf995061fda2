"""What a file on the command line is: a recording, a scene, an estimate of one of them, both in one, or a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vip_factors.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from vip_factors.body.kinematics import Motion
    from vip_factors.estimate import Estimate, WearerEstimate
    from vip_factors.sensors.recording import Recording
    from vip_factors.sensors.scene import Scene


@dataclass(frozen=True)
class Opened:
    """What some files hold together; the truth is a motion file's, else the recording's.

    Attributes:
        recording, estimate: of one wearer without a camera.
        motion: of a motion file.
        scene, scene_estimate: of several wearers, or with a camera.
    """

    recording: "Recording | None" = None
    estimate: "WearerEstimate | None" = None
    motion: "Motion | None" = None
    scene: "Scene | None" = None
    scene_estimate: "Estimate | None" = None

    @property
    def truth(self) -> "Motion | None":
        """The reference motion, if there is one."""
        if self.motion is not None:
            return self.motion
        truth = self.recording.truth if self.recording is not None else None
        return truth.motion if truth is not None else None

    @property
    def is_scene(self) -> bool:
        """Whether several wearers or a camera are among it."""
        return self.scene is not None or self.scene_estimate is not None

    def as_scene(self) -> "tuple[Scene | None, Estimate | None]":
        """All of it as a scene: a plain recording or estimate is one of one wearer without a camera."""
        from vip_factors.estimate import Estimate
        from vip_factors.sensors.scene import Scene

        scene, estimate = self.scene, self.scene_estimate
        if scene is None and self.recording is not None:
            scene = Scene(self.recording.name, (self.recording,))
        if estimate is None and self.estimate is not None:
            one = self.estimate
            estimate = Estimate(one.name, one.method, (one,), settings=one.settings)
        return scene, estimate


def open_all(paths: Sequence[Path]) -> Opened:
    """Open files and put together what they hold.

    Raises:
        InputError: if two of them hold a thing of the same kind, or one is missing.
        FileFormatError: if one holds neither a recording, an estimate nor a motion.
    """
    together: dict[str, Recording | WearerEstimate | Motion | Scene | Estimate] = {}
    source: dict[str, Path] = {}
    for path in paths:
        for kind, content in vars(open_one(path)).items():
            if content is None:
                continue
            if kind in together:
                raise InputError(f"{path} holds a second {kind} beside that of {source[kind]}: give one of each kind")
            together[kind], source[kind] = content, path
    return Opened(**together)  # type: ignore[arg-type]


def open_one(path: Path) -> Opened:
    """Open one file, by its suffix and content.

    Raises:
        InputError, FileFormatError, OSError: if it cannot be read.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected a file")
    if path.suffix.lower() == ".mcap":
        return _open_mcap(path)
    from vip_factors.io.motions import MOTION_SUFFIXES, read_motion

    if path.suffix.lower() not in MOTION_SUFFIXES:
        known = ", ".join((".mcap", *MOTION_SUFFIXES))
        raise InputError(
            f"{path}: expected a file that ends in {known}; vip-factors convert brings sensor logs into .mcap"
        )
    return Opened(motion=read_motion(path))


# What only scenes and their estimates have among their topics.
_SCENE = ("/scene/", "/camera/", "/estimate/scene/")


def _open_mcap(path: Path) -> Opened:
    """A scene of one wearer without a camera is opened as the plain recording that it is."""
    from vip_factors.io import mcap_estimate, mcap_recording
    from vip_factors.io.mcap_reader import read_contents

    contents = read_contents(path, lambda channel: mcap_estimate.is_read(channel) or mcap_recording.is_read(channel))
    topics = contents.topics
    estimated = [topic for topic in topics if topic.startswith(mcap_estimate.ESTIMATE)]
    measured = [topic for topic in topics if not topic.startswith(mcap_estimate.ESTIMATE)]
    if not topics:
        raise FileFormatError(f"{path} is empty: expected a recording or an estimate")
    estimate = mcap_estimate.read_estimate(contents) if estimated else None
    if not any(topic.startswith(_SCENE) for topic in topics):
        own = not estimated or "/recording/info" in measured
        recording = mcap_recording.read_recording(contents) if own else None
        return Opened(recording=recording, estimate=None if estimate is None else estimate.only_wearer)
    scene = mcap_recording.read_scene(contents) if measured else None
    if scene is not None and scene.camera is None and len(scene.wearers) == 1:
        return Opened(recording=scene.wearers[0], scene_estimate=estimate)
    return Opened(scene=scene, scene_estimate=estimate)
