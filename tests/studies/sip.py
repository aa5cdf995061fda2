"""SOP and SIP with six sensors, simulated from motion capture that the pose prior has not seen (thesis 3.4, 4.4.2)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.studies.scenes import (
    BLEND_S,
    HOLD_S,
    POSE,
    SETTLED_S,
    ClipStudy,
    calibrated_at_first_frame,
    middle_of,
    true_motion,
    with_nominal_pose,
)
from tests.studies.study import Fixed, Tell, group, mean, table
from tests.studies.thesis import TRUE_POSE, ZERO_POSE
from vip_factors.body.kinematics import Motion
from vip_factors.evaluate.metrics import common_frames, mpjae, mpjpe
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose


@dataclass(frozen=True)
class Variant:
    """A tracker and what it is told.

    Attributes:
        method: ``"SOP"`` or ``"SIP"``.
        start: ``"true pose"``: mountings from the true first pose; ``"zero pose"``: from the nominal T-pose, taken at
            its word; ``"zero pose, calibrated"``: from there on estimated, as the pipeline does by default.
    """

    method: str
    start: str

    @property
    def calibration(self) -> CalibrationSettings:
        free = self.start == "zero pose, calibrated"
        return CalibrationSettings(
            estimate_headings=free, estimate_mountings=free, from_truth=self.start == "true pose"
        )


SOP_TRUE, SIP_TRUE = Variant("SOP", "true pose"), Variant("SIP", "true pose")
VARIANTS = (
    SOP_TRUE, SIP_TRUE, Variant("SOP", "zero pose"), Variant("SIP", "zero pose"),
    Variant("SIP", "zero pose, calibrated"),
)  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Errors of one variant on one recording, over ``frames`` frames."""

    variant: Variant
    kind: str
    clip: str
    seed: int
    frames: int
    mpjpe_mm: float
    mpjae_deg: float
    solve_seconds: float


@dataclass(frozen=True, kw_only=True)
class Sip(ClipStudy):
    """Six simulated sensors on the motions held out of the pose prior, beside the thesis's tables."""

    # Along the chain 8° add up to some 30° at a forearm: told, not shown.
    pose_error_deg: float = 8.0
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""
    sensors: Fixed[SimulateSettings] = field(default_factory=SimulateSettings.realistic)
    settings: Fixed[Settings] = field(default_factory=Settings)

    def rows(self, tell: Tell) -> Iterator[Trial]:
        work = self.chosen()
        for done, clip in enumerate(work):
            recording = self.recording(clip.motion(), clip.name, clip.repetition)
            for number, variant in enumerate(VARIANTS):
                tell("SOP and SIP", (done + number / len(VARIANTS)) / len(work))
                yield self._trial(recording, variant, clip.kind, clip.name, clip.repetition)

    def recording(self, motion: Motion, name: str, seed: int) -> Recording:
        """The middle of a clip after a carelessly held T-pose, as six realistic sensors record it."""
        middle = middle_of(motion, self.seconds, name)
        posed = with_initial_pose(middle, POSE, HOLD_S, BLEND_S, self.pose_error_deg, seed)
        return simulate_recording(posed, preset("sip6", motion.skeleton), self.sensors, seed, name, POSE)

    def _trial(self, recording: Recording, variant: Variant, kind: str, name: str, seed: int) -> Trial:
        settings = replace(with_nominal_pose(self.settings), frame_rate=self.frame_rate)
        settings = replace(settings, acceleration=variant.method == "SIP", calibration=variant.calibration)
        told = calibrated_at_first_frame(recording) if variant.start == "true pose" else recording
        estimate = smooth(told, settings).only_wearer
        moving = estimate.motion.frames(slice(int(np.ceil(SETTLED_S * estimate.motion.rate)), None))
        motion, truth, _ = common_frames(moving, true_motion(recording))
        seconds = sum(report.seconds for report in estimate.reports)
        return Trial(variant, kind, name, seed, len(motion), mpjpe(motion, truth), mpjae(motion, truth), seconds)

    def tables(self, rows: Sequence[Trial]) -> Iterator[str]:
        yield (
            f"MPJPE mm / MPJAE deg of six simulated sensors, {len(rows) // len(VARIANTS)} recordings after a T-pose "
            f"held with errors of {self.pose_error_deg:g} deg per joint and axis"
        )
        variants = group(rows, lambda one: (one.variant.method, one.variant.start))
        yield _table({variant: errors_by_kind(own) for variant, own in variants.items()})
        yield "Thesis, on TotalCapture (other motions, real sensors; tables 3.3 to 3.5 and 4.9)"
        starts = (("true pose", TRUE_POSE), ("zero pose", ZERO_POSE))
        yield _table({(method, start): row for start, several in starts for method, row in several.items()})


def errors_by_kind(trials: Sequence[object]) -> dict[str, tuple[float, float]]:
    """MPJPE in mm and MPJAE in degrees by kind of motion, every recording alike, and ``mean`` of the kinds."""
    found = {
        kind: (mean(one.mpjpe_mm for one in own), mean(one.mpjae_deg for one in own))  # type: ignore[attr-defined]
        for kind, own in group(trials, lambda one: str(one.kind)).items()  # type: ignore[attr-defined]
    }
    return found | {"mean": (mean(p for p, _ in found.values()), mean(a for _, a in found.values()))}


def _table(rows: dict[tuple[str, str], dict[str, tuple[float, float]]]) -> str:
    """Every variant by kind of motion, and what acceleration gains."""
    longest = max(rows.values(), key=len)
    kinds = list(longest)
    lines = [[method, start, *(row.get(kind) for kind in kinds)] for (method, start), row in rows.items()]
    sop, sip = (rows.get((method, "true pose"), {}) for method in ("SOP", "SIP"))
    gains = [f"{-gain(sop[kind][0], sip[kind][0]):.0f} %" if kind in sop and kind in sip else None for kind in kinds]
    return table(["tracker", "mountings from", *kinds], [*lines, ["SIP against SOP, MPJPE", "true pose", *gains]])


def gain(before: float, after: float) -> float:
    """By how many percent an error fell."""
    return 100 * (1 - after / before)
