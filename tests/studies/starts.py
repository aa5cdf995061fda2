"""First headings and mountings of recordings with a truth: sensors that start in the wrong valley, told of or not."""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from vip_factors.errors import InputError
from vip_factors.evaluate.table import json_text
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.io.mcap_scene_recording import read_scene
from vip_factors.sensors.frames import ImuFrames, resample
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings
from vip_factors.stages.calibration_start import search_start
from vip_factors.stages.inertial import first_calibration
from vip_factors.stages.sensor_checks import checked

WRONG = np.deg2rad(60.0)  # a bone turned by more starts in another valley than the truth's


@dataclass(frozen=True)
class StartTrial:
    """The start of one wearer.

    Attributes:
        recording, wearer: their names.
        initial_pose: declared, or "none".
        off_deg: by sensor, the median over frames of how far the start turns its bone against the truth; all of them
            may face another way together.
        flagged: names of the sensors that the start itself calls in question.
        cpu_s: of the search.
    """

    recording: str
    wearer: str
    initial_pose: str
    off_deg: dict[str, float]
    flagged: tuple[str, ...]
    cpu_s: float

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names of the sensors whose bones start more than 60° wrong."""
        return tuple(name for name, off in self.off_deg.items() if off > np.rad2deg(WRONG))


def run_starts(paths: Sequence[Path], tell: Callable[[str, float], None]) -> tuple[StartTrial, ...]:
    """The start of every wearer with a truth.

    Raises:
        InputError: if there is none, or a file cannot be used.
    """
    trials: list[StartTrial] = []
    for done, path in enumerate(paths):
        tell(path.name, done / len(paths))
        known = [wearer for wearer in read_scene(path).wearers if wearer.truth is not None]
        trials += [_trial(path.name, wearer, Settings()) for wearer in known]
    if not trials:
        raise InputError("no start to judge: expected .mcap files of recordings with a truth")
    return tuple(trials)


def starts_table(trials: Sequence[StartTrial]) -> str:
    """Markdown, a row for each wearer and one for all."""
    lines = [
        "| recording | wearer | pose | sensors | start > 60° wrong | of these flagged | right but flagged | CPU s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = np.array([_counts(one) for one in trials])
    for one, counts in zip(trials, rows, strict=True):
        cells = [one.recording, one.wearer, one.initial_pose, *map(str, counts), f"{one.cpu_s:.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    total = ["all", "", "", *map(str, rows.sum(axis=0)), f"{sum(one.cpu_s for one in trials):.1f}"]
    return "\n".join([*lines, "| " + " | ".join(total) + " |"]) + "\n"


def starts_json(trials: Sequence[StartTrial]) -> str:
    """Everything, as JSON."""
    return json_text({f"{one.recording} {one.wearer}": asdict(one) for one in trials})


def _counts(one: StartTrial) -> tuple[int, int, int, int]:
    wrong, flagged = set(one.wrong), set(one.flagged)
    return len(one.off_deg), len(wrong), len(wrong & flagged), len(flagged - wrong)


def _trial(name: str, recording: Recording, settings: Settings) -> StartTrial:
    recording, _ = checked(recording, settings)
    begin = clock.process_time()
    frames = resample(recording, settings.frame_rate)
    usual = first_calibration(recording, frames, settings)
    starts = search_start(recording, frames, usual, settings)
    cpu_s = clock.process_time() - begin
    best, flagged = (starts.best.calibration, (*starts.doubtful, *starts.tilted)) if starts else (usual, ())
    off = dict(zip(frames.sensors, np.rad2deg(bones_off(recording, frames, best)).tolist(), strict=True))
    questioned = tuple(frames.sensors[s] for s in sorted(set(flagged)))
    return StartTrial(name, recording.subject.name, recording.initial_pose, off, questioned, cpu_s)


def bones_off(recording: Recording, frames: ImuFrames, start: InitialCalibration) -> Array:
    """``(S,)`` radians, the median over frames of how far a start turns each sensor's bone against the truth.

    The world's heading is the one about which most sensors agree.
    """
    assert recording.truth is not None
    true = recording.truth.motion
    bones = [recording.placement.site(name).bone_index for name in frames.sensors]
    at = np.clip(np.searchsorted(true.time, frames.time), 0, len(true) - 1)
    R_true = true.state.R_world_bone[at][:, bones]
    R_found = rotation_z(start.headings) @ frames.R_inertial_sensor @ transpose(start.R_bone_sensor)
    seen = frames.orientation_valid & ((frames.time >= true.time[0]) & (frames.time <= true.time[-1]))[:, None]
    yaw = np.angle(np.sum(np.exp(1j * yaw_of(R_found @ transpose(R_true))) * seen, axis=0))
    common = yaw[np.abs(wrap_angle(yaw[:, None] - yaw)).sum(axis=1).argmin()]
    off = angle_between(rotation_z(common) @ R_true, R_found)
    return np.nanmedian(np.where(seen, off, np.nan), axis=0)
