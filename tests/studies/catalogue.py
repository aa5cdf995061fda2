"""Faults put one by one into real recordings and scenes: what each costs, and whether it is told with its cause."""

import json
import time as clock
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.studies.fault_table import FAULTS
from tests.studies.marker_body import CameraName, filmed
from tests.studies.real import converted
from tests.studies.real_recordings import real_recordings
from tests.studies.study import NAN, Study, Tell, bullets, group, table
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.estimate import Estimate
from vip_factors.evaluate import metrics
from vip_factors.evaluate.metrics import Compared, common_frames
from vip_factors.findings import KINDS, Finding, Severity
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

SOUND, REFUSED = "none", "refused"
COSTLY_DEG, COSTLY_MM = 5.0, 30.0
FIRST = 2  # findings that people read


@dataclass(frozen=True)
class CatalogueRow:
    """One recording with one fault, or with none.

    Attributes:
        recording, fault: their names.
        degrees, mm: of the worst bone with a sensor, and MPJPE, against the estimate without the fault.
        findings: kind, severity and sentence, those of most weight first.
        names: that the sentence must hold.
        cpu_s: of the solution.
    """

    recording: str
    fault: str
    degrees: float
    mm: float
    findings: Sequence[tuple[str, str, str]]
    names: Sequence[str] = ()
    cpu_s: float = 0.0

    @property
    def is_told(self) -> bool:
        """Whether the cause is among the first two findings."""
        return any(self._tells(*finding) for finding in self.findings[:FIRST])

    @property
    def is_costly(self) -> bool:
        """Whether somebody would be misled by the result."""
        return self.degrees > COSTLY_DEG or self.mm > COSTLY_MM

    @property
    def warns(self) -> bool:
        """Whether anything is told that is more than a note and says that something may be wrong."""
        return any(severity != Severity.NOTE and _is_fault(kind) for kind, severity, _ in self.findings)

    @property
    def is_limited(self) -> bool:
        """Whether it is told that the set-up cannot tell more."""
        return any(not _is_fault(kind) for kind, *_ in self.findings)

    def _tells(self, kind: str, _: str, sentence: str) -> bool:
        fault = next(one for one in FAULTS if one.name == self.fault)
        if kind == REFUSED:
            return fault.refusal in sentence
        return kind in fault.kinds and all(name in sentence for name in self.names)


@dataclass(frozen=True, kw_only=True)
class Catalogue(Study):
    """Faults put one by one into real recordings and scenes: cost, told with the cause, not told, told falsely."""

    folder: Path
    """Where rows are kept: what is there is not made again."""
    data: Path | None = None
    """Folder with the public recordings."""
    named: tuple[str, ...] = ()
    """Only those of them whose names contain one of these."""
    camera: CameraName | None = None
    """Only those with markers of the whole body, filmed."""
    scenes: tuple[Path, ...] = ()
    """Recordings or scenes (.mcap) of your own."""
    faults: tuple[str, ...] = ()
    """Only those whose names contain one of these; the recordings without fault always."""
    frame_rate: float = 60.0
    """Hz of the estimates."""

    def rows(self, tell: Tell) -> Iterator[CatalogueRow]:
        real = () if self.data is None else self._real(self.data)
        scenes = [*real, *(read_scene(path) for path in self.scenes)]
        if not scenes:
            raise InputError("no recording to put faults into: name data, or scenes")
        kept = self.folder / "catalogue.jsonl"
        lines = kept.read_text(encoding="utf-8").splitlines() if kept.exists() else []
        known = {(row["recording"], row["fault"]): row for row in map(json.loads, lines)}
        for done, scene in enumerate(scenes):
            others = [one for one in scenes if one.camera is not None and one is not scene]
            tell(scene.name, done / len(scenes))
            for row in self._of(scene, others[0] if others else scene, known):
                if (row.recording, row.fault) not in known:
                    with kept.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(asdict(row)) + "\n")
                yield row

    def _real(self, data: Path) -> Iterator[Scene]:
        for recording in real_recordings(data):
            if self.named and not any(name in recording.name for name in self.named):
                continue
            if self.camera is None:
                yield Scene(recording.name, (converted(recording, data),))
            elif recording.markers is not None:
                seed = zlib.crc32(recording.name.encode())
                yield filmed(converted(recording, data), recording.markers(data), self.camera, seed)

    def _of(self, scene: Scene, other: Scene, known: Mapping[tuple[str, str], Any]) -> Iterator[CatalogueRow]:
        """All rows of a scene; ``other`` is one to take a video from."""
        name = scene.name if scene.camera is None else f"{scene.name}, {scene.camera.name}"
        sound: Estimate | None = None
        for fault in (None, *FAULTS):
            title = SOUND if fault is None else fault.name
            if fault is not None and self.faults and not any(fault in title for fault in self.faults):
                continue
            if (name, title) in known:
                yield CatalogueRow(**known[name, title])
            elif fault is None:
                row, sound = self._solved(name, title, scene, None)
                yield row
            elif (faulty := fault.put(scene, other)) is not None:
                sound = sound or self._solved(name, SOUND, scene, None)[1]
                yield self._solved(name, title, faulty[0], sound, faulty[1])[0]

    def _solved(
        self, name: str, fault: str, scene: Scene, sound: Estimate | None, names: Sequence[str] = ()
    ) -> tuple[CatalogueRow, Estimate | None]:
        """A row, and its estimate; None of a recording that is refused."""
        begin = clock.process_time()
        try:
            estimate = smooth(scene, Settings(frame_rate=self.frame_rate))
        except VipFactorsError as error:
            return CatalogueRow(name, fault, NAN, NAN, [(REFUSED, Severity.DOUBT, str(error))], names), None
        findings = dict.fromkeys(
            (*estimate.findings, *(finding for each in estimate.wearers for finding in each.findings))
        )
        cost = (NAN, NAN) if sound is None else _cost(estimate.wearers[0].motion, sound.wearers[0].motion, scene)
        told = [(finding.kind, str(finding.severity), str(finding)) for finding in sorted(findings, key=_weight)]
        return CatalogueRow(name, fault, *cost, told, names, clock.process_time() - begin), estimate

    def tables(self, rows: Sequence[CatalogueRow]) -> Iterator[str]:
        """By fault; then what was said of recordings without one, and of costly faults without their cause."""
        whole = {one: those for one, those in group(rows, lambda row: row.fault).items() if one != SOUND}
        yield table(
            [
                "fault",
                "number",
                "cost °",
                "cost mm",
                "told",
                "costly",
                "of these told",
                "warned of something else",
                "silent",
            ],
            [_line(fault, those) for fault, those in whole.items()]
            + [_line("all", [one for those in whole.values() for one in those])],
        )
        without = [row for row in rows if row.fault == SOUND]
        yield (
            f"{sum(row.warns for row in without)} of {len(without)} recordings without a fault have a warning that "
            f"names one; of {sum(row.is_limited for row in without)} it is told that the set-up cannot tell more"
        )
        yield bullets(
            "", (f"{row.recording}: {' / '.join(kind for kind, *_ in row.findings)}" for row in without if row.warns)
        )
        missed = [row for row in rows if row.fault != SOUND and row.is_costly and not row.is_told]
        yield bullets("Costly and not told:", (
            f"{row.fault}, {row.recording} ({row.degrees:.0f}°, {row.mm:.0f} mm): "
            f"{' / '.join(kind for kind, *_ in row.findings) or 'nothing'}" for row in missed
        ))  # fmt: skip


def _line(fault: str, rows: Sequence[CatalogueRow]) -> list[object]:
    costly = [row for row in rows if row.is_costly]
    missed = [row for row in rows if not row.is_told]
    known = np.array([(row.degrees, row.mm) for row in rows if np.isfinite(row.degrees)]).reshape(-1, 2)
    cost = np.median(known, axis=0) if len(known) else (NAN, NAN)
    return [fault, len(rows), *cost, len(rows) - len(missed), len(costly), sum(row.is_told for row in costly),
            sum(row.warns for row in missed), sum(not row.warns for row in missed)]  # fmt: skip


def _weight(finding: Finding) -> tuple[int, bool]:
    order = [Severity.DOUBT, Severity.CARE, Severity.NOTE]
    return order.index(finding.severity), not KINDS[finding.kind].is_fault


def _is_fault(kind: str) -> bool:
    return kind not in KINDS or KINDS[kind].is_fault


def _cost(motion: Motion, sound: Motion, scene: Scene) -> tuple[float, float]:
    own = scene.wearers[0]
    compared = Compared(frozenset(own.placement.site(name).bone for name in own.placed))
    ours, true, _ = common_frames(motion, sound)
    try:
        alignment = metrics.align_frames(ours, true, compared=compared)
    except InputError:  # two feet
        return NAN, NAN
    degrees = np.rad2deg(metrics.orientation_error(ours, true, alignment).mean(axis=0))
    return float(degrees[compared.orientations()].max()), metrics.mpjpe(ours, true, compared)
