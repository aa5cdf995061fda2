"""Files on the command line: a recording or scene, an estimate, both in one, or a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vip_factors.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from vip_factors.body.kinematics import Motion
    from vip_factors.estimate import Estimate
    from vip_factors.sensors.recording import Recording
    from vip_factors.sensors.scene import Scene


@dataclass(frozen=True)
class Opened:
    """Contents of files that belong together; a recording is a scene of one wearer without a camera."""

    scene: "Scene | None" = None
    estimate: "Estimate | None" = None
    motion: "Motion | None" = None

    @property
    def recording(self) -> "Recording | None":
        """The recording, for a scene of one wearer without a camera."""
        scene = self.scene
        return scene.wearers[0] if scene is not None and scene.camera is None and len(scene.wearers) == 1 else None

    @property
    def is_scene(self) -> bool:
        """Whether several wearers or a camera are among it."""
        filmed = self.scene is not None and self.recording is None
        return filmed or (self.estimate is not None and not self.estimate.is_plain)


def open_all(paths: Sequence[Path]) -> Opened:
    """Open files and put together what they hold.

    Raises:
        InputError: if two of them hold a thing of the same kind, or one is missing.
        FileFormatError: if one holds neither a recording, an estimate nor a motion.
    """
    together: dict[str, Motion | Scene | Estimate] = {}
    source: dict[str, Path] = {}
    for path in paths:
        opened = open_one(path)
        for kind, content in vars(opened).items():
            if content is None:
                continue
            if kind in together:
                what = "recording" if kind == "scene" and opened.recording is not None else kind
                raise InputError(f"{path} holds a second {what} beside that of {source[kind]}: give one of each kind")
            together[kind], source[kind] = content, path
    return Opened(**together)  # type: ignore[arg-type]


def open_one(path: Path) -> Opened:
    """Open one file, by its suffix and content."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected a file")
    if path.suffix.lower() == ".mcap":
        from vip_factors.io import mcap_estimate, mcap_recording
        from vip_factors.io.mcap_reader import read_contents

        contents = read_contents(path, lambda topic: mcap_estimate.is_read(topic) or mcap_recording.is_read(topic))
        if not (topics := contents.topics):
            raise FileFormatError(f"{path} is empty: expected a recording or an estimate")
        is_estimate = any(topic.startswith(mcap_estimate.ESTIMATE) for topic in topics)
        is_recording = any(topic in ("/recording/info", mcap_recording.SCENE_INFO) for topic in topics)
        scene = mcap_recording.read_scene(contents) if is_recording or not is_estimate else None
        return Opened(scene, mcap_estimate.read_estimate(contents) if is_estimate else None)
    from vip_factors.io.motions.files import MOTION_SUFFIXES, read_motion

    if path.suffix.lower() not in MOTION_SUFFIXES:
        suffixes = ", ".join((".mcap", *MOTION_SUFFIXES))
        raise InputError(
            f"{path}: expected a file that ends in {suffixes}; vip-factors convert brings sensor logs into .mcap"
        )
    return Opened(motion=read_motion(path))
