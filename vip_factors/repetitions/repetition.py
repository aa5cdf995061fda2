"""A repetition of an exercise, and those of one wearer."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

from vip_factors.display import Summarised
from vip_factors.estimate import dataframe
from vip_factors.repetitions.signals import Signals

if TYPE_CHECKING:
    import pandas

Kind = Literal["squat", "lunge", "jump", "curl"]
Side = Literal["left", "right", "both"]
UNKNOWN = float("nan")


@dataclass(frozen=True)
class Measured:
    """A value and its standard deviation, NaN if that is not known; both NaN of what there is not."""

    value: float = UNKNOWN
    sigma: float = UNKNOWN


@dataclass(frozen=True)
class Repetition:
    """One repetition; seconds on the recording's clock.

    Attributes:
        kind: of exercise.
        side: the leg in front in a lunge, the arm that curls.
        start, turn, end: when it begins, is deepest (a jump highest) and ends.
        down_s, hold_s, up_s: the ways there and back and the stay between; a jump's squat before it, and no stay.
        depth_m: that the pelvis sinks; a jump's before it. None of a curl.
        depth_deg: flexion of the knees, or elbows, at the turn; mean of the sides that take part.
        ranges_deg: of every principal angle, by name, between its least and most.
        left_less_right_deg: what the left knee's or elbow's range is larger than the right one's; of both sides alike
            only.
        flight_s: without a foot on the floor.
        flight_height_m: that free fall says of it: that the centre of mass rises beyond take-off.
        rise_m: of the centre of mass above that of standing before.
    """

    kind: Kind
    side: Side
    start: float
    turn: float
    end: float
    down_s: float
    hold_s: float
    up_s: float
    depth_m: Measured
    depth_deg: Measured
    ranges_deg: dict[str, Measured] = field(default_factory=dict)
    left_less_right_deg: Measured = Measured()
    flight_s: float = UNKNOWN
    flight_height_m: Measured = Measured()
    rise_m: Measured = Measured()

    def columns(self) -> dict[str, object]:
        """Columns of a table of numbers: standard deviations follow as ``…_sd_…``; an unknown number is empty text."""
        units = {"start": "start_s", "turn": "turn_s", "end": "end_s"}
        columns: dict[str, object] = {}
        for name, value in vars(self).items():
            ranges = {f"{angle}_range_deg": extent for angle, extent in self.ranges_deg.items()}
            for column, cell in (ranges if name == "ranges_deg" else {units.get(name, name): value}).items():
                if isinstance(cell, Measured):
                    quantity, _, unit = column.rpartition("_")
                    columns |= {column: _cell(cell.value), f"{quantity}_sd_{unit}": _cell(cell.sigma)}
                else:
                    columns[column] = _cell(cell) if isinstance(cell, float) else cell
        return columns


def _cell(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""


@dataclass(frozen=True, repr=False)
class WearerRepetitions(Summarised):
    """The repetitions of one wearer, in the order of time, and their signals."""

    name: str
    signals: Signals
    repetitions: tuple[Repetition, ...]

    @property
    def counts(self) -> str:
        """Numbers by kind, such as ``6 squats, 2 jumps``."""
        kinds = Counter(repetition.kind for repetition in self.repetitions)
        counts = (f"{kinds[kind]} {kind}{'s' if kinds[kind] > 1 else ''}" for kind in get_args(Kind) if kinds[kind])
        return ", ".join(counts) or "no repetitions"

    def summary(self) -> list[str]:
        """List the repetitions with their times."""
        title = f"{self.name or 'wearer'}: {self.counts}"
        return [
            title,
            *(
                f"{repetition.kind}: {repetition.start:.1f} to {repetition.end:.1f} s, {repetition.side}"
                for repetition in self.repetitions
            ),
        ]

    def to_dataframe(self) -> "pandas.DataFrame":
        """A pandas table with the columns of ``repetitions.csv``; an :class:`InputError` without pandas."""
        lines = [repetition.columns() for repetition in self.repetitions]
        names = list(dict.fromkeys(name for line in lines for name in line)) or ["kind", "side", "start_s", "end_s"]
        return dataframe([names, *([line.get(name, "") for name in names] for line in lines)])
