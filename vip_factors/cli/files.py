"""What a file on the command line is: a recording, an estimate, both in one, or a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vip_factors.body.motion import Motion
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import Estimate
from vip_factors.sensors.recording import Recording


@dataclass(frozen=True)
class Opened:
    """What some files hold together; the truth is a motion file's, else the recording's."""

    recording: Recording | None = None
    estimate: Estimate | None = None
    motion: Motion | None = None

    @property
    def truth(self) -> Motion | None:
        """The reference motion, if there is one."""
        if self.motion is not None:
            return self.motion
        truth = self.recording.truth if self.recording is not None else None
        return truth.motion if truth is not None else None


def open_all(paths: Sequence[Path]) -> Opened:
    """Open files and put together what they hold.

    Raises:
        InputError: if two of them hold a thing of the same kind, or one is missing.
        FileFormatError: if one holds neither a recording, an estimate nor a motion.
    """
    together: dict[str, Recording | Estimate | Motion] = {}
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
    from vip_factors.io.motions.files import MOTION_SUFFIXES, read_motion

    if path.suffix.lower() not in MOTION_SUFFIXES:
        known = ", ".join((".mcap", *MOTION_SUFFIXES))
        raise InputError(
            f"{path}: expected a file that ends in {known}; vip-factors convert brings sensor logs into .mcap"
        )
    return Opened(motion=read_motion(path))


def _open_mcap(path: Path) -> Opened:
    from vip_factors.io.mcap_contents import read_contents
    from vip_factors.io.mcap_estimate import ESTIMATE, read_estimate
    from vip_factors.io.mcap_recording import read_recording

    topics = read_contents(path, lambda channel: False).topics
    has_estimate = any(topic.startswith(ESTIMATE) for topic in topics)
    has_more = any(not topic.startswith(ESTIMATE) for topic in topics)
    if not topics:
        raise FileFormatError(f"{path} is empty: expected a recording or an estimate")
    if not has_estimate:
        return Opened(recording=read_recording(path))
    recording = read_recording(path) if has_more and "/recording/info" in topics else None
    return Opened(recording=recording, estimate=read_estimate(path))
