"""Conversion of a foreign sensor log to a recording: its format, its wearer, the sites of its sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from msgspec import structs

from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.skeleton import POSES
from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.geometry.rotations import Array
from vip_factors.io.body_file import read_body_file, subject_with
from vip_factors.io.importers.column_map import columns_text, read_column_map
from vip_factors.io.importers.shared import ImportedLog, likely_sites, unpacked
from vip_factors.io.log_streams import (
    LEAD_S,
    after_pose,
    check_leaps,
    coverage_notes,
    held_orientations,
    log_in_parts,
    pose_source,
    with_orientations,
    without_sample,
)
from vip_factors.io.mcap_reader import MAGIC, read_few
from vip_factors.io.placement_file import (
    INITIAL_POSES,
    PlacementFile,
    place_sensors,
    placement_from_file,
    placement_text,
)
from vip_factors.io.settings import LogOptions
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject, Truth

# Format → module, or module:reader. The first that matches wins: formats with a signature come before tables.
FORMATS: dict[str, str] = {
    "recording": "vip_factors.io.mcap_recording",
    "ros2": "vip_factors.io.ros2",
    "mvnx": "vip_factors.io.importers.mvnx",
    "opensim_export": "vip_factors.io.importers.maker_tables:EXPORT",
    "opensense_sto": "vip_factors.io.importers.maker_tables:OPENSENSE",
    "totalcapture": "vip_factors.io.importers.totalcapture",
    "apdm": "vip_factors.io.importers.maker_tables:APDM",
    "xsens_dot": "vip_factors.io.importers.xsens:DOT",
    "xsens_txt": "vip_factors.io.importers.xsens:MTW",
    "table": "vip_factors.io.importers.table",
}


@dataclass(frozen=True, kw_only=True)
class ImportOptions(LogOptions):
    """Options of a conversion: what the user knows beyond the log. All are optional, and win over the log's content.

    :class:`~vip_factors.io.settings.LogOptions` describes the other fields.

    Attributes:
        placement: name of a preset, path of a placement file, or site → sensor name.
        name: the recording's; the path's own if None.
    """

    placement: str | Path | Mapping[str, str] | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        if self.format is not None and self.format not in FORMATS:
            raise InputError(f"unknown format '{self.format}'{nearest(self.format, FORMATS)}")
        if self.columns is not None and self.format not in (None, "table"):
            raise InputError(f"column map {self.columns} for format '{self.format}': only format 'table' takes one")
        if self.rate_hz is not None and not 1 <= self.rate_hz <= 20_000:
            raise InputError(f"rate {self.rate_hz:g} Hz: expected 1 to 20000 samples a second")
        if self.initial_pose is not None and self.initial_pose not in INITIAL_POSES:
            raise InputError(f"initial pose '{self.initial_pose}'{nearest(self.initial_pose, INITIAL_POSES)}")
        if self.start_s is not None and self.end_s is not None and not self.start_s < self.end_s:
            raise InputError(f"start {self.start_s:g} s and end {self.end_s:g} s: expected the start before the end")
        beside = [name for name in ("stature_m", "sex", "segment_lengths_m") if getattr(self, name)]
        if self.body is not None and beside:
            raise InputError(
                f"{', '.join(beside)} given beside the body file {self.body}, which holds them: leave them out"
            )


def detect_format(path: str | Path) -> str:
    """Detect the format of a log, one of :data:`FORMATS`, by its content.

    Raises:
        InputError: if there is nothing at the path.
        FileFormatError: if no format matches.
    """
    path = Path(path)
    _check_exists(path)
    with unpacked(path) as log:
        if log.is_file():
            with log.open("rb") as file:
                start = file.read(len(MAGIC))
            if not start:
                raise FileFormatError(f"{log} is empty (0 bytes)")
            if start == MAGIC:
                from vip_factors.io.ros2 import is_imu

                topics = read_few(log, lambda channel: False).messages.values()
                return "ros2" if any(is_imu(topic.channel) for topic in topics) else "recording"
        for name in FORMATS:
            if name not in ("recording", "table") and _reader(name).matches(log):  # a column map declares a table
                return name
        raise FileFormatError(
            f"{log}: not a sensor log of a known format ({', '.join(FORMATS)}); for another table give a column map "
            "(--columns MAP.toml); vip-factors convert LOG --template NAME writes a first version"
        )


def _check_exists(path: Path) -> None:
    if not path.exists() and not (path.name and path.parent.is_dir() and list(path.parent.glob(f"{path.name}*"))):
        raise InputError(f"{path}: no such file or folder, and no file whose name begins so")


def _reader(name: str) -> Any:
    """The format's module, imported late, or the object of the name behind the colon; either matches and reads."""
    module, _, reader = FORMATS[name].partition(":")
    return getattr(import_module(module), reader) if reader else import_module(module)


def read_log(
    path: str | Path, format_name: str | None = None, columns: str | Path | None = None, rate_hz: float | None = None
) -> ImportedLog:
    """Read a log of any format except our own recordings; a table of another make as its column map says.

    ``rate_hz`` are the samples a second of tables, in place of their clocks or stated rates.

    Raises:
        InputError: as :func:`detect_format` and the format's reader, for a table without a column map, and for a
            recording of ours.
    """
    with unpacked(Path(path)) as source:
        format_name = "table" if columns is not None else format_name or detect_format(source)
        if format_name == "recording":
            raise InputError(f"{source} is a recording of this package already: expected a sensor log")
        reader, arguments = _reader(format_name), list[object]()
        if format_name == "table":
            if columns is None:
                raise InputError(
                    f"{source}: format 'table' needs a column map (--columns MAP.toml); --template NAME "
                    "writes a first version"
                )
            _check_exists(source)
            arguments = [read_column_map(columns, rate_hz)]
        elif rate_hz is not None:
            if not getattr(reader, "takes_rate", False):
                raise InputError(
                    f"{source}: rate_hz given, but a log of format '{format_name}' has times: leave --rate-hz out"
                )
            arguments = [rate_hz]
        log: ImportedLog = reader.read(source, *arguments)
        return log


def import_recording(path: str | Path, options: ImportOptions | None = None) -> Recording:
    """Convert a sensor log of any known format except our own to a recording.

    Sensors with acceleration and angular rate but no orientation get theirs by an attitude filter. Sensors without a
    known site are kept but not placed. The recording's notes list assumptions, losses and oddities.

    Raises:
        InputError: if nothing is at the path, no sensor can be placed, or an option does not fit the log.
        FileFormatError: if the log is malformed.
        RecordingError: if its samples are unusable.
    """
    path, options = Path(path), options or ImportOptions()
    parts = (path, *options.then)
    logs = [read_log(part, options.format, options.columns, options.rate_hz) for part in parts]
    log = log_in_parts(logs, [str(part) for part in parts]) if options.then else logs[0]
    return recording_of_log(log, path, options)


def recording_of_log(log: ImportedLog, path: Path, options: ImportOptions) -> Recording:
    """Convert a log to a recording with the user's options; ``path`` names it.

    Raises:
        InputError, FileFormatError, RecordingError: as :func:`import_recording`.
    """
    given, body = _given(options), read_body_file(options.body) if options.body is not None else None
    notes = [f"imported from {path.name} ({log.format})", *log.notes]
    held, imus = _held(path, log, options, given.initial_pose)
    log = replace(log, imus=_cut(imus, options, notes))
    check_leaps(log.imus)
    notes += coverage_notes(log.imus)
    if body is None:
        lengths, stature = dict(given.segment_lengths_m), given.stature_m or log.stature_m
        subject = Subject(given.subject or options.name or path.stem, stature, given.mass_kg, given.sex, lengths)
        notes += [subject.body_note] if subject.body_note else []
    else:
        subject = subject_with(body, given.subject, given.mass_kg, given.sex)
        notes.append(f"body of '{body.name}' from {options.body}, which overrides the given stature and lengths")
    log = replace(log, imus=after_pose(log.imus, held, notes) if held else with_orientations(log.imus, notes))
    choice = options.placement
    rule = choice if isinstance(choice, Mapping | str) and not _is_file(choice) else given.sensors
    placement = place_sensors(log, subject.body(), rule, notes)
    if (given.initial_pose or "none") == "none":
        notes.append(
            "no initial pose declared: headings and mountings are estimated from the motion only, and some may be "
            "wrong; hold a T- or N-pose for two seconds at the start and declare it with --initial-pose"
        )
    start = (options.start_s or 0.0) - (LEAD_S if held else 0.0)
    return Recording(
        name=options.name or path.stem,
        subject=subject,
        imus=log.imus,
        placement=placement,
        initial_pose=given.initial_pose or "none",
        truth=_truth(log, options, start),
        notes="\n".join(notes),
        start_ns=log.start_ns + round(start * 1e9) if log.start_ns else 0,
        clock_s=(log.clock_s or 0.0) + start,
    )


def _held(
    path: Path, log: ImportedLog, options: ImportOptions, pose: str | None
) -> tuple[dict[str, Array], Mapping[str, ImuStream]]:
    """Orientations by sensor in a pose that was held elsewhere, and the log's streams without it."""
    if options.pose_from is None:
        return {}, log.imus
    if pose not in POSES:
        raise InputError(f"pose from {options.pose_from}: expected an initial pose, {' or '.join(POSES)}")
    source, sample = pose_source(options.pose_from)
    if not source.exists():
        raise InputError(f"pose from {options.pose_from}: there is no file or folder {source}")
    same = path.exists() and source.samefile(path)
    imus = log.imus if same else read_log(source, log.format, options.columns, options.rate_hz).imus
    held = held_orientations(imus, source, sample)
    return held, without_sample(log.imus, sample) if same and sample else log.imus


def _is_file(placement: str | Path | Mapping[str, str] | None) -> TypeGuard[str | Path]:
    return isinstance(placement, Path) or (
        isinstance(placement, str) and placement.lower().endswith((".toml", ".json", ".xml"))
    )


def _given(options: ImportOptions) -> PlacementFile:
    """The placement file's content with the options' values over it."""
    content = placement_from_file(options.placement) if _is_file(options.placement) else PlacementFile()
    names = ("subject", "stature_m", "mass_kg", "sex", "initial_pose")
    values = {name: value for name in names if (value := getattr(options, name)) is not None}
    lengths = {**content.segment_lengths_m, **options.segment_lengths_m}
    return structs.replace(content, **values, segment_lengths_m=lengths)


def _cut(imus: Mapping[str, ImuStream], options: ImportOptions, notes: list[str]) -> dict[str, ImuStream]:
    """The streams between start and end, on a clock that begins at start."""
    if options.start_s is None and options.end_s is None:
        return dict(imus)
    start, end = options.start_s or 0.0, np.inf if options.end_s is None else options.end_s
    parts = {}
    for name, stream in imus.items():
        if np.any((stream.time >= start) & (stream.time <= end)):
            part = stream.cut(start, end)
            parts[name] = replace(part, time=part.time - start)
        else:
            notes.append(f"sensor '{name}' has no sample between {start:g} s and {end:g} s: left out")
    if not parts:
        last = max(stream.time[-1] for stream in imus.values())
        raise InputError(f"no sensor has a sample between {start:g} s and {end:g} s: the log ends at {last:.2f} s")
    return parts


def _truth(log: ImportedLog, options: ImportOptions, zero: float) -> Truth | None:
    """The log's own motion between start and end, on a clock that is 0 at ``zero`` of the log's."""
    motion = log.truth_motion
    if motion is None:
        return None
    if options.start_s is not None or options.end_s is not None:
        start, end = options.start_s or 0.0, np.inf if options.end_s is None else options.end_s
        inside = np.flatnonzero((motion.time >= start) & (motion.time <= end))
        if not len(inside):
            return None
        motion = motion.frames(slice(int(inside[0]), int(inside[-1]) + 1))
    return Truth(replace(motion, start=motion.start - zero), known_bones=log.truth_bones)


class Templates(NamedTuple):
    """Paths of the files that were written.

    Attributes:
        placement: where the sensors sit.
        columns: what the columns mean; None for a log whose format is known.
        undeclared: a sentence on each thing that the log does not say and only its owner knows.
    """

    placement: Path
    columns: Path | None
    undeclared: tuple[str, ...]


def write_templates(path: str | Path, name: Path, overwrite: bool = False, rate_hz: float | None = None) -> Templates:
    """Write first guesses to correct: ``NAME_placement.toml`` and, for a table, ``NAME_columns.toml``.

    Args:
        path: the log: a file, a folder, or how the names of its files begin.
        name: what the names of the files begin with; a suffix ``.toml`` is dropped.
        overwrite: whether existing files may be replaced.
        rate_hz: samples per second, if the log has no times, or wrong ones.

    Raises:
        InputError: if nothing is at the path, it is a recording of ours, or a file exists.
        FileFormatError: if its format is unknown and no column's name gives a quantity.
    """
    from vip_factors.io.importers.column_guess import guess
    from vip_factors.io.importers.units import PLEASE_DECLARE

    path = Path(path)
    stem = name.with_suffix("") if name.suffix.lower() == ".toml" else name
    placement, columns = (stem.with_name(f"{stem.name}_{kind}.toml") for kind in ("placement", "columns"))
    for file in (placement, columns):
        check_target(file, overwrite)
    try:
        format_name = detect_format(path)
    except FileFormatError:
        format_name = ""
    if format_name == "recording":
        raise InputError(f"{path} is a recording of this package already: it needs neither columns nor places")
    undeclared: dict[str, None] = {}
    if format_name:
        sensors = list(read_log(path, format_name, rate_hz=rate_hz).imus)
    else:
        with unpacked(path) as log:
            column_map, reasons, sensors = guess(log, rate_hz)
        undeclared = dict.fromkeys(word for words in reasons.values() for word in words if PLEASE_DECLARE in word)
        with atomic_open(columns, "w", overwrite) as stream:
            stream.write(columns_text(path, column_map, reasons))
    sites = likely_sites(sensors)
    columns_file = None if format_name else columns
    with atomic_open(placement, "w", overwrite) as stream:
        stream.write(placement_text(path, {name: sites.get(name) for name in sensors}, placement, columns_file))
    others = [name for name in sensors if name not in sites]
    if placed := [name for name in sensors if name in sites]:
        undeclared[f"no mounting is declared: {', '.join(placed)} have the default axes of their sites"] = None
    if others:
        undeclared[f"no site is declared for {', '.join(others)}"] = None
    return Templates(placement, columns_file, tuple(undeclared))
