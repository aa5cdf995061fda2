"""Gait beside optical and force references: strikes, toe-offs, lengths and times of strides, and none invented."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.studies.gait_truth import TrueGait, gaitmap_truth, geneva_truth, treadmill_truth
from tests.studies.marker_body import SIDES
from tests.studies.real import converted
from tests.studies.real_recordings import RealRecording, real_recordings
from tests.studies.study import Study, Tell, group, table
from vip_factors.cli.options import Flag
from vip_factors.errors import InputError
from vip_factors.estimate import WearerEstimate
from vip_factors.gait.analysis import foot_sensor, gait_of
from vip_factors.gait.events import events_of_sensor
from vip_factors.gait.results import Gait
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_estimate import read_estimate, write_estimate
from vip_factors.pipeline import smooth
from vip_factors.sensors.recording import Recording

MISSED_S = 0.2  # from a true event to the nearest found: it was not found
EDGE_S = 0.5  # at a recording's ends, where a swing is seen in part


@dataclass(frozen=True)
class GaitTrial:
    """One walk, all in seconds and metres, found less true; lists of what was matched.

    Attributes:
        recording, by: its name, and what told events: all sensors, those of the feet alone, or the motion alone.
        strike, off: of true events.
        missed: true events that nothing was found near.
        invented: strides in means between whose strikes, within the reference's time, there are not just two true ones.
        time, length: of strides in means.
    """

    recording: str
    by: str
    strike: tuple[float, ...]
    off: tuple[float, ...]
    missed: int
    invented: int
    strides: int
    time: tuple[float, ...]
    length: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class GaitStudy(Study):
    """Foot strikes, toe-offs and strides beside markers and force plates, by foot sensors and by the legs."""

    data: Path
    """Folder with the public recordings: gaitmap_feet, geneva_gait, xsens_treadmill_optical."""
    estimates: Path | None = None
    """Folder of estimates: what is there is not made again."""
    named: str = ""
    """Only those whose names contain this."""
    clocks: Flag = False
    """Take off how late each foot sensor's clock is known to be, so that the references' own errors are left out."""

    def walks(self, tell: Tell) -> Iterator[tuple[RealRecording, TrueGait, Recording, WearerEstimate]]:
        """Those with a reference, and their estimates."""
        known = [(recording, truth) for recording in real_recordings(self.data) if self.named in recording.name
                 and (truth := _truth(recording, self.data)) is not None]  # fmt: skip
        if not known:
            raise InputError(f"{self.data}: no walk '{self.named}' with a reference of foot strikes in it")
        for done, (one, truth) in enumerate(known):
            tell(one.name, done / len(known))
            recording = converted(one, self.data)
            yield one, truth, recording, self._estimate(one, recording)

    def rows(self, tell: Tell) -> Iterator[Any]:
        for one, truth, recording, estimate in self.walks(tell):
            feet = {site.sensor: recording.imus[site.sensor] for site in recording.placement.sites
                    if site.bone.endswith(("_ankle", "_foot")) and site.sensor in recording.imus}  # fmt: skip
            ways = {"all": recording, "feet alone": replace(recording, imus=feet), "legs alone": None}
            for name, measured in ways.items():
                if name != "feet alone" and one.name == "gaitmap_feet":
                    continue  # of whom no leg was measured
                gait = gait_of(estimate, measured)
                yield _trial(one.name, name, gait, truth, _late(recording, truth) if self.clocks else {})

    def _estimate(self, one: RealRecording, recording: Recording) -> WearerEstimate:
        if self.estimates is None:
            return smooth(recording).wearer()
        self.estimates.mkdir(exist_ok=True)
        path = self.estimates / f"{one.name.replace(' ', '_').replace(',', '')}.estimate.mcap"
        if not path.exists():
            write_estimate(smooth(recording), path)
        return read_estimate(path).wearer()

    def tables(self, rows: Sequence[Any]) -> Iterator[str]:
        """By data set and by what told: medians and 95 % of the distances from the reference; all walks together."""
        lines = []
        for (name, by), own in group(rows, lambda one: (one.recording.partition(" ")[0], one.by)).items():
            line: list[object] = [name.partition(",")[0], by, len(own)]
            for key, scale in (("strike", 1000), ("off", 1000), ("time", 1000), ("length", 100)):
                line.append(_words(np.array([x for one in own for x in getattr(one, key)]), scale))
            line += [sum(one.missed for one in own), sum(one.invented for one in own), sum(one.strides for one in own)]
            lines.append(line)
        yield table(["data", "by", "walks", "strike ms: median / 95 % (mean)", "toe-off ms", "stride time ms",
                     "length cm", "events missed", "strides invented", "strides"], lines)  # fmt: skip


@dataclass(frozen=True)
class EventEnds:
    """Events of one walk, by foot sensors: seconds less the true ones, at either end of the way on which they lie."""

    data: str
    kind: str
    first: tuple[float, ...]
    last: tuple[float, ...]

    def errors_ms(self, share: float) -> Array:
        """At a share of the way."""
        return 1000 * ((1 - share) * np.array(self.first) + share * np.array(self.last))


@dataclass(frozen=True, kw_only=True)
class TrainGaitEvents(GaitStudy):
    """Where between two moments of a foot's turn events lie, chosen by all data sets, and without each of them."""

    def rows(self, tell: Tell) -> Iterator[Any]:
        for one, truth, recording, estimate in self.walks(tell):
            late = _late(recording, truth) if self.clocks else {}
            for side in SIDES:
                sensor = foot_sensor(estimate, recording, side)
                ends = [None if sensor is None else events_of_sensor(*sensor, (share, share)) for share in (0.0, 1.0)]
                if ends[0] is None or ends[1] is None or not len(ends[0]):
                    continue
                for kind in ("strike", "off"):
                    first, last = (getattr(each, kind) - late.get(side, 0.0) for each in ends)
                    true = getattr(truth.events[side], kind)
                    near = [int(np.argmin(np.abs((first + last) / 2 - at))) for at in true]
                    pairs = [(first[k] - at, last[k] - at) for k, at in zip(near, true, strict=True)
                             if abs((first[k] + last[k]) / 2 - at) < MISSED_S]  # fmt: skip
                    if pairs:
                        yield EventEnds(one.name.partition(" ")[0].partition(",")[0], kind, *zip(*pairs, strict=True))

    def tables(self, rows: Sequence[Any]) -> Iterator[str]:
        """The share that is best for the worst of the others' medians, and what it does to the one left out."""
        lines = []
        for kind in ("strike", "off"):
            sets = group([row for row in rows if row.kind == kind], lambda row: row.data)
            at = {share: {name: _joined(own, share) for name, own in sets.items()} for share in SHARES}
            for out in (None, *sets) if len(sets) > 1 else ():
                share = min(SHARES, key=lambda s: max(abs(np.median(at[s][name])) for name in sets if name != out))
                for name in sets if out is None else (out,):
                    errors = at[share][name]
                    middle, (half, most) = float(np.median(errors)), np.quantile(np.abs(errors), [0.5, 0.95])
                    lines.append([kind, out or "none", f"{share:.2f}", name, len(errors), middle, half, most])
        yield table(
            ["event", "left out", "share", "judged by", "events", "median ms", "median distance", "95 %"], lines
        )


SHARES = tuple(np.arange(0, 1.01, 0.05).round(2).tolist())


def _joined(rows: Sequence[EventEnds], share: float) -> Array:
    return np.concatenate([row.errors_ms(share) for row in rows])


def _words(errors: Array, scale: float) -> str:
    errors = scale * errors[np.isfinite(errors)]
    if not len(errors):
        return "n/a"
    return f"{np.median(np.abs(errors)):.1f} / {np.quantile(np.abs(errors), 0.95):.1f} ({np.mean(errors):+.1f})"


def _truth(one: RealRecording, data: Path) -> TrueGait | None:
    if one.name == "gaitmap_feet":
        return gaitmap_truth(data / "gaitmap_feet")
    if one.name.startswith("geneva_gait"):
        return geneva_truth((data / one.log).parent)
    if one.name.startswith("xsens_treadmill_optical") and "accelerometers" in one.name:
        return treadmill_truth(data / "xsens_treadmill_optical")
    return None


def _late(recording: Recording, truth: TrueGait) -> dict[str, float]:
    """By side, of the sensors on feet."""
    found = {}
    for site in recording.placement.sites:
        side = site.bone.partition("_")[0]
        if site.bone in (f"{side}_ankle", f"{side}_foot"):
            found[side] = truth.late_s.get(site.sensor, 0.0)
    return found


def _trial(name: str, by: str, gait: Gait, truth: TrueGait, late: dict[str, float]) -> GaitTrial:
    errors: dict[str, list[float]] = {"strike": [], "off": [], "time": [], "length": []}
    missed = invented = strides = 0
    for side in SIDES:
        found, true, shift = (
            gait.feet[side],
            truth.events[side],
            late.get(side, 0.0) if gait.feet[side].by_sensor else 0.0,
        )
        first, last = _seen(gait)
        for kind in ("strike", "off"):
            own = getattr(found, kind) - shift
            for at in getattr(true, kind):
                if not first + EDGE_S < at < last - EDGE_S:
                    continue
                error = float(own[np.argmin(np.abs(own - at))] - at) if len(own) else np.inf
                missed += abs(error) > MISSED_S
                errors[kind] += [error] if abs(error) <= MISSED_S else []
        rests = dict(zip(found.strike.tolist(), found.rest.tolist(), strict=True))
        for stride in (stride for stride in gait.counted if stride.side == side):
            start, end = stride.start - shift, stride.end - shift
            if start < true.strike[0] - EDGE_S or end > true.strike[-1] + EDGE_S:
                continue
            strides += 1
            between = true.strike[(true.strike > start - MISSED_S) & (true.strike < end + MISSED_S)]
            if len(between) != 2:
                invented += 1
                continue
            errors["time"].append(float((end - start) - (between[1] - between[0])))
            length = truth.length(side, rests[stride.start] - shift, rests[stride.end] - shift)
            errors["length"].append(stride.values["length"] - length)
    lists = {key: tuple(values) for key, values in errors.items()}
    return GaitTrial(name, by, missed=missed, invented=invented, strides=strides, **lists)


def _seen(gait: Gait) -> tuple[float, float]:
    times = np.concatenate([np.concatenate([foot.off, foot.strike]) for foot in gait.feet.values()])
    return (float(times.min()) - 2 * EDGE_S, float(times.max()) + 2 * EDGE_S) if len(times) else (0.0, 0.0)
