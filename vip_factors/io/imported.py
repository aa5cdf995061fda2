"""What every reader of a foreign sensor log hands back, before it becomes a recording."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from vip_factors.body.kinematics import Motion
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.imu_stream import ImuStream


@dataclass(frozen=True)
class ImportedLog:
    """The content of a foreign sensor log, in the package's units and frames.

    Attributes:
        format: name of the format, the reader's ``FORMAT``.
        imus: one stream per sensor, by sensor name; one time base, seconds from the log's start.
        default_sites: sensor name → one of :data:`~vip_factors.sensors.calibration.SITES`, where the log itself tells.
        placement: sites that only positions and mountings can say; it wins over ``default_sites``.
        truth_motion: the wearer's motion as the log's own system estimated or measured it.
        truth_bones: names of the bones of which that motion knows anything; None: all.
        stature_m: the wearer's height, if the log knows it.
        start_ns: absolute time of t = 0 in nanoseconds, 0 if unknown.
        clock_s: what the log's own clock said at t = 0, where it does not begin anew with each log; None if unknown.
        notes: one sentence each: what was assumed, dropped, or looked odd.
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
