"""Common parts of the readers of foreign sensor logs: the log they return, its files, sites by the names of sensors."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os.path import commonprefix
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import BadZipFile, ZipFile

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import (
    UNIT_TOLERANCE,
    Order,
    interpolate_points,
    interpolate_rotations,
    matrix_from_quaternion,
)
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.imu_stream import ImuStream, force_spikes, gaps_of, rate_of


@dataclass(frozen=True)
class LogFormat:
    """A format of sensor logs: its name, whether a path leads to a log of it, reading one, and whether at a rate."""

    name: str
    matches: Callable[[Path], bool]
    read: Callable[..., "ImportedLog"]
    takes_rate: bool = False


def candidates(path: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files with one of the suffixes at a file, in a folder, or beginning with a prefix (``folder/Walk-1``), sorted."""
    if path.is_file():
        return [path] if path.suffix.lower() in suffixes else []
    if path.is_dir():
        inside = sorted(path.iterdir())
        return [file for file in inside if file.suffix.lower() in suffixes and not file.name.startswith(".")]
    if path.name and path.parent.is_dir():
        return [file for file in candidates(path.parent, suffixes) if file.name.startswith(path.name)]
    return []


def only_file(path: Path, files: Sequence[Path], expected: str) -> Path:
    """The only one of the files of a format at ``path``.

    Raises:
        FileFormatError: if there are none or several.
    """
    if len(files) != 1:
        names = ", ".join(file.name for file in files) or "none"
        raise FileFormatError(f"{path}: expected {expected}, found {names}")
    return files[0]


def merge_notes(notes: list[str]) -> tuple[str, ...]:
    """Merge notes ``file: sentence`` of the same sentence into one each."""
    files: dict[str, list[str]] = {}
    for note in notes:
        name, _, sentence = note.partition(": ")
        files.setdefault(sentence, []).append(name)
    merged = []
    for sentence, names in files.items():
        source = f"{len(names)} sensors ({names[0]} …)" if sentence and len(names) > 1 else names[0]
        merged.append(f"{source}: {sentence}" if sentence else source)
    return tuple(merged)


_IGNORED = ("", "imu", "sensor", "offset")  # as in OpenSim's torso_imu_offset_imu
_SIDES = {"l": "left", "lt": "left", "left": "left", "r": "right", "rt": "right", "right": "right"}
# Words for sites, and letters as loggers' labels have them: too short to be believed, but a guess to be looked at.
_MIDLINE_WORDS = {
    "pelvis": "pelvis hip hips sacrum sacral waist SA PE P",
    "lower_back": "lumbar lowerback LB",
    "sternum": "sternum torso chest thorax trunk TR ST CH",
    "head": "head skull HE HD",
    "upper_back": "upperback BACK",
    "belly": "belly abdomen stomach",
}
_LIMB_WORDS = {
    "thigh": "femur thigh upperleg upleg T TH UL",
    "shank": "tibia shank lowerleg lowleg shin S SH LL",
    "ankle": "ankle A",
    "foot": "calcn foot toe toes instep F FT",
    "upper_arm": "humerus upperarm uparm UA",
    "forearm": "radius ulna forearm lowerarm lowarm wrist FA LA W",
    "hand": "hand handback backofhand backhand H",
    "shoulder": "shoulder scapula clavicle",
}
_MIDLINE, _LIMBS = (
    {word: site for site, words in table.items() for word in words.split()} for table in (_MIDLINE_WORDS, _LIMB_WORDS)
)


def site_of_name(name: str) -> str | None:
    """The site of :data:`~vip_factors.sensors.calibration.SITES` that a sensor's name gives, or None."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[LR])(?=[A-Z][a-z])", " ", name)
    words = [word for word in re.split(r"[^a-z]+", spaced.lower()) if word not in _IGNORED]
    sides = {_SIDES[word] for word in words if word in _SIDES}
    segment = "".join(word for word in words if word not in _SIDES)
    if not sides:
        return _MIDLINE.get(segment)
    if len(sides) == 1 and segment in _LIMBS:
        return f"{sides.pop()}_{_LIMBS[segment]}"
    return None


def default_sites(names: list[str]) -> dict[str, str]:
    """Sites of the sensors whose names give a site; none where two names give the same."""
    sites = {name: site for name in names if (site := site_of_name(name))}
    return {name: site for name, site in sites.items() if list(sites.values()).count(site) == 1}


def likely_sites(names: list[str]) -> dict[str, str]:
    """Sites as by :func:`default_sites`, and for the other names what their letters suggest: LF, RUA, TR."""
    sites = default_sites(names)
    words = [re.split(r"[^A-Za-z0-9]+", name) for name in names]
    start = len(commonprefix(words)) if len(names) > 1 else 0  # noqa: RUF071  # words before all sensors' own
    bare = ["_".join(parts[start:]) for parts in words]
    sites_of_bare = default_sites(bare)
    if len(sites_of_bare) > len(sites):
        sites = {name: sites_of_bare[key] for name, key in zip(names, bare, strict=True) if key in sites_of_bare}
    for name, parts in zip(names, words, strict=True):
        letters = re.sub(r"^[a-z]+(?=[A-Z])", "", name).upper()
        site = _MIDLINE.get(letters)
        if site is None and letters[:1] in ("L", "R") and letters[1:] in _LIMBS:
            site = f"{_SIDES[letters[0].lower()]}_{_LIMBS[letters[1:]]}"
        if site is None:  # the longest run of words within a longer name: walk1_left_foot_B7
            runs = ("_".join(parts[i : i + n]) for n in range(len(parts), 0, -1) for i in range(len(parts) - n + 1))
            site = next(filter(None, map(site_of_name, runs)), None)
        if site is not None and name not in sites and site not in sites.values():
            sites[name] = site
    return sites


GRAVITY = 9.80665  # m/s², standard; what vendors subtract
UP = np.array([0.0, 0.0, 1.0])
SAME_RATE = 0.02  # two statements of one rate agree within 2 %: clocks are better than 0.01 %, exports round
# Averaged over a file, specific force points up to within a few degrees in every recording looked at.
TILT_LIMIT_DEG = 30.0
# Half a turn about x: the fixed rotation that puts a z-down frame upright.
R_UP_DOWN = np.diag([1.0, -1.0, -1.0])


def mean_force_inertial(R_inertial_sensor: Array, specific_force: Array) -> Array:
    """Average specific force ``(3,)`` m/s² in the inertial frame over the samples that are finite and no spikes."""
    force = np.einsum("nij,nj->ni", R_inertial_sensor, specific_force)
    force = force[np.all(np.isfinite(force), axis=1) & ~force_spikes(specific_force)]
    return force.mean(axis=0) if len(force) else np.full(3, np.nan)


def tilt_of_up(R_inertial_sensor: Array, specific_force: Array) -> float:
    """Angle in degrees between the inertial frame's z axis and the average specific force; NaN if unknown."""
    force = mean_force_inertial(R_inertial_sensor, specific_force)
    length = np.linalg.norm(force)
    return float(np.rad2deg(np.arccos(np.clip(force[2] / length, -1, 1)))) if length > 0 else float("nan")


def z_up(name: str, R_inertial_sensor: Array, specific_force: Array, notes: list[str]) -> Array:
    """The orientations in a frame whose z is up, turned over if specific force says that z was down."""
    tilt = tilt_of_up(R_inertial_sensor, specific_force)
    if tilt > 180 - TILT_LIMIT_DEG:
        notes.append(f"{name}: its inertial frame had z down; turned by 180° about x")
        return R_UP_DOWN @ R_inertial_sensor
    if tilt > TILT_LIMIT_DEG:
        notes.append(
            f"{name}: averaged specific force stands {tilt:.0f}° off the z axis of the orientation's frame: expected "
            "gravity along z; check that acceleration and orientation belong to the same sensor axes"
        )
    return R_inertial_sensor


@dataclass(frozen=True)
class ImportedLog:
    """The content of a foreign sensor log, in the package's units and frames.

    Attributes:
        format: name of the format, the reader's ``FORMAT``.
        imus: one stream per sensor, by sensor name; one time base, seconds from the log's start.
        default_sites: sensor name → one of :data:`~vip_factors.sensors.calibration.SITES`, where the log itself tells.
        placement: sites that only positions and mountings can say; it wins over ``default_sites``.
        truth_motion: the wearer's motion as the log's own system estimated or measured it.
        truth_bones: names of the bones that this motion covers; None: all.
        stature_m: the wearer's height, if the log knows it.
        start_ns: absolute time of t = 0 in nanoseconds, 0 if unknown.
        clock_s: time of t = 0 on the log's own clock, where that does not restart with each log; None if unknown.
        notes: one sentence each on an assumption, a loss, or an oddity.
    """

    format: str
    imus: Mapping[str, ImuStream]
    default_sites: Mapping[str, str] = field(default_factory=dict)
    placement: Placement | None = None
    truth_motion: Motion | None = None
    truth_bones: frozenset[str] | None = None
    stature_m: float | None = None
    start_ns: int = 0
    clock_s: float | None = None
    notes: tuple[str, ...] = ()


def rotations_or_nan(quaternion: Array, order: Order, where: str, notes: list[str]) -> Array:
    """Rotations ``(N, 3, 3)`` of quaternions ``(N, 4)``; NaN where a row is not of unit length.

    Raises:
        FileFormatError: if most rows are not of unit length.
    """
    length = np.linalg.norm(quaternion, axis=1)
    is_unit = np.abs(length - 1) < UNIT_TOLERANCE
    note_bad_rows(is_unit, np.isfinite(length), where, "quaternions are not of unit length", notes)
    R = np.full((len(quaternion), 3, 3), np.nan)
    try:
        R[is_unit] = matrix_from_quaternion(quaternion[is_unit], order)
    except InputError as error:
        raise FileFormatError(f"{where}: {error}") from error
    return R


def note_bad_rows(is_good: np.ndarray, is_finite: np.ndarray, where: str, fault: str, notes: list[str]) -> None:
    """Add a note on the finite rows that are not good.

    Raises:
        FileFormatError: if these are most.
    """
    bad = int(np.sum(is_finite & ~is_good))
    if bad > np.sum(is_finite) / 2:
        raise FileFormatError(f"{where}: {bad} of {np.sum(is_finite)} {fault}; check the columns and their order")
    if bad:
        notes.append(f"{where}: {bad} samples dropped whose {fault}")


Sampled = tuple[Array, Array]
"""Times ``(N,)`` in seconds and the values at them."""


def stream_of_quantities(
    name: str, force: Sampled | None, orientation: Sampled | None, angular_rate: Sampled | None
) -> ImuStream:
    """A stream of quantities with clocks of their own, on the gyroscope's times, else on the accelerometer's.

    Values in between are interpolated, but not over gaps: there samples are absent.

    Raises:
        RecordingError: if the quantities have no time in common, and as :class:`ImuStream`.
    """
    time, _ = next(sampled for sampled in (angular_rate, force, orientation) if sampled is not None)
    specific_force, rate = (
        None if sampled is None else values_at(sampled, time, interpolate_points) for sampled in (force, angular_rate)
    )
    R = None if orientation is None else values_at(orientation, time, interpolate_rotations)
    return ImuStream.from_samples(name, time, specific_force, R, rate)


def values_at(sampled: Sampled, time: Array, interpolate: Callable[[Array, Array, Array], Array]) -> Array:
    """Values at other times; NaN before the first sample, after the last one, and within gaps."""
    sample_time, values = sampled
    if sample_time is time:
        return values
    is_finite = np.all(np.isfinite(values), axis=tuple(range(1, values.ndim)))
    sample_time, values = sample_time[is_finite], values[is_finite]
    if not len(sample_time):
        return np.full((len(time), *values.shape[1:]), np.nan)
    result = interpolate(sample_time, values, time)
    half_step = 0.5 / rate_of(sample_time) if len(sample_time) > 1 else 0.0
    is_absent = (time < sample_time[0] - half_step) | (time > sample_time[-1] + half_step)
    for start, end in gaps_of(sample_time):
        is_absent |= (time > start + half_step) & (time < end - half_step)
    result[is_absent] = np.nan
    return result


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The folder that a zip archive holds, while the context lasts; any other path as it is.

    Raises:
        FileFormatError: if the archive cannot be unpacked.
    """
    if path.suffix.lower() != ".zip" or not path.is_file():
        yield path
        return
    with TemporaryDirectory() as place:
        folder = Path(place) / path.stem
        try:
            with ZipFile(path) as archive:
                archive.extractall(folder)
        except (BadZipFile, NotImplementedError, OSError, RuntimeError) as error:  # the last: a password is needed
            raise FileFormatError(f"{path}: cannot be unpacked ({error}): expected a zip archive of a log") from error
        hidden = (".", "__MACOSX")
        while len(inside := [file for file in folder.iterdir() if not file.name.startswith(hidden)]) == 1:
            if inside[0].is_file():
                break
            folder = inside[0]
        try:
            yield inside[0] if len(inside) == 1 else folder
        except InputError as error:
            raise type(error)(str(error).replace(f"{folder}", f"{path}")) from error
