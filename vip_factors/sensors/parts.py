"""One recording in several parts: what loggers and phones split into files is one session, with gaps between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from vip_factors.errors import InputError
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingInMemory, RecordingSource, one_stream


@dataclass(frozen=True)
class RecordingInParts:
    """Recordings of one session, in the order of time, as one; see :class:`RecordingSource`. The first says who wore
    what, and what was held at the start; ``later`` are seconds of each part's time 0 on its clock.
    """

    parts: tuple[RecordingSource, ...]
    later: tuple[float, ...]

    @property
    def head(self) -> Recording:
        """The recording without what was measured."""
        return self.parts[0].head

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        return self.parts[0].sensors

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of their first and last sample."""
        return self.parts[0].interval[0], self.parts[-1].interval[1] + self.later[-1]

    def between(self, start: float = -float("inf"), end: float = float("inf")) -> Mapping[str, ImuStream]:
        """What was measured from one instant to another."""
        streams: dict[str, list[ImuStream]] = {}
        for part, later in zip(self.parts, self.later, strict=True):
            if part.interval[0] + later > end or part.interval[1] + later < start:
                continue
            for name, stream in part.between(start - later, end - later).items():
                earlier = streams.setdefault(name, [])
                moved = replace(stream, time=stream.time + later)
                if earlier and not moved.time[0] > earlier[-1].time[-1]:  # in both files
                    if not moved.time[-1] > earlier[-1].time[-1]:
                        continue
                    moved = moved.cut(float(moved.time[moved.time > earlier[-1].time[-1]][0]), float(moved.time[-1]))
                earlier.append(moved)
        return {name: one_stream(own) for name, own in streams.items() if sum(map(len, own)) >= LEAST_SAMPLES}


@dataclass(frozen=True)
class _AllSensors(RecordingInMemory):
    """A recording of whose sensors those without a place count too."""

    sensors: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.recording.imus))


def in_parts(parts: Sequence[RecordingSource], sources: Sequence[str]) -> RecordingInParts:
    """Parts of one session as one recording, on the clock of the earliest; ``sources`` are what each is called in
    messages.

    Where all parts tell their absolute start, that says when they were; else their clock must have gone on.

    Raises:
        InputError: if two overlap or are far apart, or differ in who wore what, in sensors or in their rates.
    """
    for part, source in zip(parts, sources, strict=True):
        if not part.sensors:
            raise InputError(f"{source} holds no samples of any sensor: was it cut off? Leave it out, or copy it again")
    stamped = [part.head.start_ns != 0 for part in parts]
    if any(stamped) and not all(stamped):
        some, none = sources[stamped.index(True)], sources[stamped.index(False)]
        raise InputError(f"{some} tells when it began and {none} does not: nothing tells how much later it is")
    origin = parts[0].head.start_ns
    starts = [(one.head.start_ns - origin) / 1e9 for one in parts]
    order = sorted(range(len(parts)), key=lambda n: starts[n] + parts[n].interval[0])
    parts, sources = [parts[n] for n in order], [sources[n] for n in order]
    later = tuple(starts[n] - starts[order[0]] for n in order)
    for number in range(1, len(parts)):
        _check_follows(parts, later, sources, number, absolute=all(stamped))
        _check_same(parts[0], parts[number], sources[0], sources[number])
    return RecordingInParts(tuple(parts), later)


def joined_in_memory(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """The same of recordings in memory, with all their sensors, without truth; notes of all parts, each once.

    Raises:
        InputError: as :func:`in_parts`.
    """
    whole = in_parts([_AllSensors(one) for one in recordings], sources)
    notes = dict.fromkeys(line for part in whole.parts for line in part.head.notes.splitlines())
    imus = whole.between(-float("inf"), float("inf"))
    return replace(whole.head, imus=imus, truth=None, notes="\n".join(notes))


def wearers_in_parts(
    files: Sequence[Sequence[RecordingSource]], sources: Sequence[str]
) -> tuple[RecordingInParts, ...]:
    """Each wearer's parts as one recording; ``files`` have the same wearers, in the same order.

    Raises:
        InputError: if a file has more wearers or fewer, and as :func:`in_parts`.
    """
    _check_count([len(wearers) for wearers in files], sources)
    return tuple(in_parts(own, sources) for own in zip(*files, strict=True))


def scene_in_parts(scenes: Sequence[Scene], sources: Sequence[str]) -> Scene:
    """Scenes in memory, one after another in time, as one; see :func:`joined_in_memory`.

    Raises:
        InputError: if one has a camera, or other wearers, and as :func:`in_parts`.
    """
    for source, scene in zip(sources, scenes, strict=True):
        if scene.camera is not None:
            raise InputError(f"{source} has a camera: only recordings of IMUs alone may be in several parts")
    _check_count([len(one.wearers) for one in scenes], sources)
    wearers = [joined_in_memory(own, sources) for own in zip(*(one.wearers for one in scenes), strict=True)]
    return Scene(scenes[0].name, tuple(wearers))


def _check_count(counts: Sequence[int], sources: Sequence[str]) -> None:
    for source, count in zip(sources, counts, strict=True):
        if count != counts[0]:
            raise InputError(
                f"{source} has {count} wearers, {sources[0]} {counts[0]}: expected the same in all parts of a recording"
            )


def _check_follows(
    parts: Sequence[RecordingSource], later: Sequence[float], sources: Sequence[str], number: int, absolute: bool
) -> None:
    longest_pause_s = 3600.0  # its frames are estimated too; after longer ones straps have moved
    split_s = 0.5  # by which parts may overlap: files are split at an instant that sensors reach one after another
    (_, end), (start, _) = (parts[n].interval for n in (number - 1, number))
    start, end = start + later[number], end + later[number - 1]
    if start < end - split_s:
        clock = "" if absolute else "; if its clock began anew, nothing in the files tells when"
        raise InputError(
            f"{sources[number]} begins at {start:.2f} s, before {sources[number - 1]} ends at {end:.2f} s: parts of a "
            f"recording must follow one another{clock}"
        )
    if start - end > longest_pause_s:
        raise InputError(
            f"{sources[number]} begins {(start - end) / 3600:.1f} h after {sources[number - 1]} ended: expected "
            f"{longest_pause_s / 3600:g} h or less between parts of a recording; it is one by itself"
        )


def _check_same(first: RecordingSource, other: RecordingSource, source: str, other_source: str) -> None:
    rate_tolerance = 0.1
    rate_s = 5.0  # of a part's beginning, which tells its rates
    who, whom = first.head.subject, other.head.subject
    if (who.name, who.stature_m) != (whom.name, whom.stature_m):
        raise InputError(
            f"{other_source} is of '{whom.name}' ({whom.stature_m} m), {source} of '{who.name}' ({who.stature_m} m): "
            "parts of a recording are of one wearer"
        )
    missing, more = (set(one.sensors) - set(two.sensors) for one, two in ((first, other), (other, first)))
    if missing or more:
        odd = [f"without {', '.join(sorted(missing))}"] if missing else []
        odd += [f"with {', '.join(sorted(more))}"] if more else []
        raise InputError(
            f"{other_source} is {' and '.join(odd)}, unlike {source}: expected the same sensors in all parts"
        )
    for site in first.head.placement.sites:
        if site.sensor in first.sensors and other.head.placement.site(site.sensor).bone != site.bone:
            bone = other.head.placement.site(site.sensor).bone
            raise InputError(
                f"{other_source}: sensor '{site.sensor}' is on {bone}, in {source} on {site.bone}: expected the same "
                "placement in all parts"
            )
    streams, other_streams = (one.between(one.interval[0], one.interval[0] + rate_s) for one in (first, other))
    for name in streams.keys() & other_streams.keys():
        one, two = streams[name].rate, other_streams[name].rate
        if abs(two / one - 1) > rate_tolerance:
            raise InputError(
                f"{other_source}: sensor '{name}' measures {two:.1f} times a second, in {source} {one:.1f} times: "
                "expected the same rate in all parts"
            )
