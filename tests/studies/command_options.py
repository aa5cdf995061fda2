"""What each of the benchmarks can be told on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vip_factors.cli.options import Flag


@dataclass(frozen=True)
class SipOptions:
    """Six simulated sensors on the motions held out of the pose prior, beside the thesis's tables."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other sensor errors."""
    pose_error_deg: float = 8.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""


@dataclass(frozen=True)
class VipOptions:
    """The thesis's video-inertial trackers on simulated scenes or on TotalCapture, beside its tables."""

    motions: Path | None = None
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    totalcapture: Path | None = None
    """Folder of TotalCapture: its test sequences are used instead of simulated scenes. 2D poses are OpenPose's JSON in
    a folder beside each .sensors file, or else made by the simulator's detector from the optical motion."""
    json: Path | None = None
    """Also write everything to this file, as JSON, after each recording."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    variants: tuple[str, ...] = ()
    """Names of trackers, such as IT VIP VIP-IT; all if absent."""
    clips: tuple[str, ...] = ()
    """Names of clips (or of TotalCapture's sequences); all if absent."""
    kinds: tuple[str, ...] = ()
    """Kinds of motion: walking, sport, acting, low; all if absent."""
    seconds: float | None = None
    """Of each clip, from its middle (8), or of each sequence of TotalCapture, from its start (30; 0 for all)."""
    seeds: int = 1
    """Recordings of each clip, each with other errors."""
    camera: Literal["fixed", "hand-held", "walking"] = "fixed"
    """What films the simulated scenes."""
    totalcapture_camera: int = 1
    """Which of TotalCapture's cameras, counted from one."""
    pose_error_deg: float = 4.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""
    iterations: int = 30
    """At most, of each solve."""
    processes: int = 1
    """Simulated recordings worked on side by side."""


@dataclass(frozen=True)
class SpeedOptions:
    """Seconds per iteration by part, and peak memory, on a simulated walk."""

    quick: Flag = False
    """A few frames and iterations only."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class WalkOptions:
    """Seven real sensors on a walk with optical reference, beside Xsens MVN."""

    folder: Path
    """The folder xsens_vicon_walk, with raw_mtw, vicon and mvn in it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class RealOptions:
    """Public recordings of real people, and any scenes beside them: all that was not made by this project."""

    data: Path
    """Folder with the public recordings: xsens_vicon_walk, xsens_treadmill_optical, opensense, vidimu and so on."""
    named: str = ""
    """Only those whose names contain this."""
    camera: Literal["standing", "carried"] | None = None
    """Only those with markers of the whole body, and with what a detector would have seen of these: a camera that
    stands, or one that is carried."""
    scenes: tuple[Path, ...] = ()
    """Recordings or scenes (.mcap) with a truth of their own, in a table below."""
    live: Flag = True
    """Stream them too."""
    json: Path | None = None
    """Also write everything, findings too, to this file, as JSON, after each recording."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class RecordingsOptions:
    """Recordings of your own, smoothed and streamed, one row for each wearer: errors where they have a truth."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings or scenes (.mcap)."""
    live: Flag = True
    """Stream them too."""
    json: Path | None = None
    """Also write everything, findings too, to this file, as JSON, after each recording."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class StartsOptions:
    """First headings and mountings of recordings with a truth: sensors that start wrong, one row for each wearer."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings or scenes (.mcap)."""
    json: Path | None = None
    """Also write everything, sensor by sensor, to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class AssociationOptions:
    """Who is who: two wearers among bystanders, labelled from what their IMUs alone say."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 98.0
    """Of each scene, after a T-pose of 2 s: with the default, 3,000 frames at 30 Hz."""
    seeds: int = 3
    """Scenes, each with other motions."""
    wearers: int = 2
    """People with sensors."""
    bystanders: int = 4
    """People without; half of them come and go."""
    camera: Literal["fixed", "hand-held", "walking"] = "hand-held"
    """What films."""
    whole: Flag = False
    """Also run the pipeline to its end, which labels again with what it knows by then."""


@dataclass(frozen=True)
class WearersOptions:
    """Several wearers in one scene: the error of their places relative to one another."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 8.0
    """Of each scene, after a T-pose of 2 s."""
    seeds: int = 3
    """Scenes with each camera, each with other motions."""
    wearers: int = 2
    """People with sensors."""
    bystanders: int = 0
    """People without."""
    cameras: tuple[Literal["fixed", "hand-held", "walking"], ...] = ("fixed", "hand-held")
    """What films."""


@dataclass(frozen=True)
class ConsistencyOptions:
    """Is the reported covariance honest? NEES over seeds, on Gaussian and on realistic noise."""

    motions: Path | None = None
    """Folder of the CMU motions as BVH; without it only Gaussian noise is run."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seeds: int = 20
    """Scenes with each noise."""
    camera: Literal["fixed", "hand-held", "walking"] = "fixed"
    """What films; with Gaussian noise hand-held and walking are one."""
    seconds: float = 4.0
    """Of each clip of the realistic scenes, from its middle."""
    sizes: tuple[float, ...] = (0.25, 1.0)
    """Of the Gaussian noise, against what the factors suppose."""


@dataclass(frozen=True)
class StreamFaultsOptions:
    """Live streams with samples lost, late or wrong: what it costs, and how soon all is good again."""

    motions: Path | None = None
    """Folder of motions, searched with all folders below it; the package's own gestures if absent."""
    clips: tuple[str, ...] = ()
    """Names of the motions' files, such as 07_02; with --motions only."""
    json: Path | None = None
    """Also write everything to this file, as JSON, second by second."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 24.0
    """Of each stream, which begins with a T-pose of 2 s; clips are repeated."""
    fault_s: float = 8.0
    """When the faults begin, in seconds."""
    cameras: tuple[Literal["fixed", "hand-held", "walking"], ...] = ("fixed", "hand-held")
    """What films."""
    faults: tuple[str, ...] = ()
    """Parts of names of faults, such as 'lost', 'shank' or 'clock'; 'killed' for that of the program; all if absent."""
    processes: int = 1
    """Streams worked on side by side."""
    frame_rate: float = 60.0
    """Frames per second."""
    recalibration: Flag = True
    """Find calibrations anew in between, which takes most of the time."""
