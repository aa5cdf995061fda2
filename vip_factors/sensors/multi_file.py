"""Recordings in several files: loggers and phones split a session into files, with gaps between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vip_factors.errors import InputError
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingInMemory, RecordingSource, one_stream


@dataclass(frozen=True)
class MultiFileRecording:
    """Recordings of one session in the order of time; see :class:`RecordingSource`.

    The first file declares wearer, placement and initial pose; ``offsets`` are seconds of each file's time 0 on its
    clock.
    """

    sources: tuple[RecordingSource, ...]
    offsets: tuple[float, ...]

    @property
    def head(self) -> Recording:
        """Head of the recording, without its measurements."""
        return self.sources[0].head

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        return self.sources[0].sensors

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample."""
        return self.sources[0].interval[0], self.sources[-1].interval[1] + self.offsets[-1]

    def between(self, start: float = -float("inf"), end: float = float("inf")) -> Mapping[str, ImuStream]:
        """Measurements with ``start <= time <= end``."""
        streams: dict[str, list[ImuStream]] = {}
        for source, offset in zip(self.sources, self.offsets, strict=True):
            if source.interval[0] + offset > end or source.interval[1] + offset < start:
                continue
            for name, stream in source.between(start - offset, end - offset).items():
                pieces = streams.setdefault(name, [])
                moved = replace(stream, time=stream.time + offset)
                if pieces and not moved.time[0] > pieces[-1].time[-1]:  # in both files
                    if not moved.time[-1] > pieces[-1].time[-1]:
                        continue
                    moved = moved.cut(float(moved.time[moved.time > pieces[-1].time[-1]][0]), float(moved.time[-1]))
                pieces.append(moved)
        return {name: one_stream(pieces) for name, pieces in streams.items() if sum(map(len, pieces)) >= LEAST_SAMPLES}


def join_sources(recordings: Sequence[RecordingSource], sources: Sequence[str]) -> MultiFileRecording:
    """Join recordings of one session, on the clock of the earliest; ``sources`` are their names in messages.

    Absolute starts order the files if all have them; otherwise their times must be on one continuing clock.

    Raises:
        InputError: if two overlap or are far apart, or differ in wearer, placement, sensors or rates.
    """
    for recording, source in zip(recordings, sources, strict=True):
        if not recording.sensors:
            raise InputError(
                f"{source} holds no samples of any sensor: leave it out, or copy it again if it is damaged"
            )
    stamped = [recording.head.start_ns != 0 for recording in recordings]
    if any(stamped) and not all(stamped):
        stamped_source, none = sources[stamped.index(True)], sources[stamped.index(False)]
        raise InputError(
            f"{stamped_source} has an absolute start time and {none} has none: the time between them is unknown"
        )
    origin = recordings[0].head.start_ns
    starts = [(recording.head.start_ns - origin) / 1e9 for recording in recordings]
    order = sorted(range(len(recordings)), key=lambda n: starts[n] + recordings[n].interval[0])
    recordings, sources = [recordings[n] for n in order], [sources[n] for n in order]
    offsets = tuple(starts[n] - starts[order[0]] for n in order)
    for number in range(1, len(recordings)):
        _check_follows(recordings, offsets, sources, number, absolute=all(stamped))
        _check_same(recordings[0], recordings[number], sources[0], sources[number])
    return MultiFileRecording(tuple(recordings), offsets)


def join_recordings(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """Join recordings in memory, with all sensors and all notes, without truth.

    Raises:
        InputError: as :func:`join_sources`.
    """
    joined = join_sources([RecordingInMemory(recording, only_placed=False) for recording in recordings], sources)
    notes = dict.fromkeys(line for source in joined.sources for line in source.head.notes.splitlines())
    imus = joined.between(-float("inf"), float("inf"))
    return replace(joined.head, imus=imus, truth=None, notes="\n".join(notes))


def join_wearers(files: Sequence[Sequence[RecordingSource]], sources: Sequence[str]) -> tuple[MultiFileRecording, ...]:
    """Join the recordings of each wearer; ``files`` have the same wearers, in the same order.

    Raises:
        InputError: if a file has more wearers or fewer, and as :func:`join_sources`.
    """
    _check_count([len(wearers) for wearers in files], sources)
    return tuple(join_sources(sources_of_wearer, sources) for sources_of_wearer in zip(*files, strict=True))


def join_scenes(scenes: Sequence[Scene], sources: Sequence[str]) -> Scene:
    """Join scenes in memory; see :func:`join_recordings`.

    Raises:
        InputError: if a scene has a camera or other wearers, and as :func:`join_sources`.
    """
    for source, scene in zip(sources, scenes, strict=True):
        if scene.camera is not None:
            raise InputError(f"{source} has a camera: only recordings without cameras may be in several files")
    _check_count([len(scene.wearers) for scene in scenes], sources)
    wearers = [
        join_recordings(recordings, sources) for recordings in zip(*(scene.wearers for scene in scenes), strict=True)
    ]
    return Scene(scenes[0].name, tuple(wearers))


def _check_count(counts: Sequence[int], sources: Sequence[str]) -> None:
    for source, count in zip(sources, counts, strict=True):
        if count != counts[0]:
            raise InputError(
                f"{source} has {count} wearers, {sources[0]} {counts[0]}: expected the same in all files of a recording"
            )


def _check_follows(
    recordings: Sequence[RecordingSource], offsets: Sequence[float], sources: Sequence[str], number: int, absolute: bool
) -> None:
    longest_pause_s = 3600.0  # pauses are estimated too; after longer ones straps have moved
    split_s = 0.5  # possible overlap: sensors switch to the next file one after another
    (_, end), (start, _) = (recordings[n].interval for n in (number - 1, number))
    start, end = start + offsets[number], end + offsets[number - 1]
    if start < end - split_s:
        clock = "" if absolute else "; if its clock restarted, the time between the files is unknown"
        raise InputError(
            f"{sources[number]} begins at {start:.2f} s, before {sources[number - 1]} ends at {end:.2f} s: files of a "
            f"recording must follow one another{clock}"
        )
    if start - end > longest_pause_s:
        raise InputError(
            f"{sources[number]} begins {(start - end) / 3600:.1f} h after {sources[number - 1]} ended: expected "
            f"{longest_pause_s / 3600:g} h or less between files of a recording; process it separately"
        )


def _check_same(reference: RecordingSource, recording: RecordingSource, source: str, other_source: str) -> None:
    rate_tolerance = 0.1
    rate_s = 5.0  # time from the start over which rates are compared
    who, whom = reference.head.subject, recording.head.subject
    if (who.name, who.stature_m) != (whom.name, whom.stature_m):
        raise InputError(
            f"{other_source} is of '{whom.name}' ({whom.stature_m} m), {source} of '{who.name}' ({who.stature_m} m): "
            "files of a recording must have the same wearer"
        )
    missing, added = (
        set(source_a.sensors) - set(two.sensors) for source_a, two in ((reference, recording), (recording, reference))
    )
    if missing or added:
        odd = [f"without {', '.join(sorted(missing))}"] if missing else []
        odd += [f"with {', '.join(sorted(added))}"] if added else []
        raise InputError(
            f"{other_source} is {' and '.join(odd)}, unlike {source}: expected the same sensors in all files"
        )
    for site in reference.head.placement.sites:
        if site.sensor in reference.sensors and recording.head.placement.site(site.sensor).bone != site.bone:
            bone = recording.head.placement.site(site.sensor).bone
            raise InputError(
                f"{other_source}: sensor '{site.sensor}' is on {bone}, in {source} on {site.bone}: expected the same "
                "placement in all files"
            )
    streams, other_streams = (
        source.between(source.interval[0], source.interval[0] + rate_s) for source in (reference, recording)
    )
    for name in streams.keys() & other_streams.keys():
        rate, two = streams[name].rate, other_streams[name].rate
        if abs(two / rate - 1) > rate_tolerance:
            raise InputError(
                f"{other_source}: sensor '{name}' measures {two:.1f} times a second, in {source} {rate:.1f} times: "
                "expected the same rate in all files"
            )
