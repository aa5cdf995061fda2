"""What goes wrong with live streams: samples lost, late, twice, in disorder, from clocks that leap, sensors that slip.

Every function takes samples in the order of their arrival and gives them in theirs; a sample's time is when it was
measured, and only those of clocks change it. Same seed, same fault.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count

import numpy as np

from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame

FOREVER = float("inf")
Samples = Iterable[LiveSample]
Chosen = Callable[[LiveSample], bool]


def everything(sample: LiveSample) -> bool:
    """All samples."""
    return True


def of_imus(sample: LiveSample) -> bool:
    """Samples of sensors, on wearers and cameras."""
    return isinstance(sample, ImuSample)


def of_video(sample: LiveSample) -> bool:
    """Video frames."""
    return isinstance(sample, VideoFrame)


@dataclass(frozen=True)
class OfSensors:
    """Samples of sensors with one of these names."""

    names: Collection[str]

    def __call__(self, sample: LiveSample) -> bool:
        """Whether a sample is one of theirs."""
        return isinstance(sample, ImuSample) and sample.sensor in self.names


def lost(samples: Samples, chosen: Chosen, start: float, end: float = FOREVER, share: float = 1.0,
         seed: int = 0) -> Iterator[LiveSample]:  # fmt: skip
    """A share of the chosen samples measured from ``start`` to ``end`` (s) never arrives; which ones is chance."""
    random = np.random.default_rng([seed, 1])
    for sample in samples:
        if not (start <= sample.time < end and chosen(sample) and random.random() < share):
            yield sample


def delayed(samples: Samples, chosen: Chosen, delay: float, start: float, end: float = FOREVER, jitter: float = 0.0,
            seed: int = 0) -> Iterator[LiveSample]:  # fmt: skip
    """Chosen samples arrive ``delay`` to ``delay + jitter`` seconds late, all others in time.

    With a jitter longer than their period they overtake one another.
    """
    random = np.random.default_rng([seed, 2])
    number = count()
    waiting: list[tuple[float, int, LiveSample]] = []
    for sample in samples:
        while waiting and waiting[0][0] <= sample.time:
            yield heappop(waiting)[2]
        if start <= sample.time < end and chosen(sample):
            heappush(waiting, (sample.time + delay + jitter * random.random(), next(number), sample))
        else:
            yield sample
    while waiting:
        yield heappop(waiting)[2]


def repeated(samples: Samples, chosen: Chosen, share: float, start: float, end: float = FOREVER,
             seed: int = 0) -> Iterator[LiveSample]:  # fmt: skip
    """A share of the chosen samples arrives twice in a row."""
    random = np.random.default_rng([seed, 3])
    for sample in samples:
        yield sample
        if start <= sample.time < end and chosen(sample) and random.random() < share:
            yield sample


def turned_on_bone(samples: Samples, sensor: str, turn: Array, start: float,
                   takes: float = 0.0) -> Iterator[LiveSample]:  # fmt: skip
    """A strap slips: a sensor is turned by a rotation vector ``(3,)`` rad in its own axes, steadily for ``takes`` s."""
    for sample in samples:
        if isinstance(sample, ImuSample) and sample.sensor == sensor and sample.time >= start:
            orientation, force = sample.R_inertial_sensor, sample.specific_force
            R = exp(np.asarray(turn, dtype=float) * (min(1.0, (sample.time - start) / takes) if takes else 1.0))
            yield replace(
                sample,
                R_inertial_sensor=None if orientation is None else orientation @ R,
                specific_force=None if force is None else R.T @ force,
            )
        else:
            yield sample


def heading_reset(samples: Samples, sensor: str, angle: float, start: float) -> Iterator[LiveSample]:
    """A filter starts anew: from ``start`` on a sensor's inertial frame is turned about z by ``angle`` rad."""
    R = rotation_z(angle)
    for sample in samples:
        mine = isinstance(sample, ImuSample) and sample.sensor == sensor and sample.time >= start
        if mine and isinstance(sample, ImuSample) and sample.R_inertial_sensor is not None:
            yield replace(sample, R_inertial_sensor=R @ sample.R_inertial_sensor)
        else:
            yield sample


def clock_jumping(samples: Samples, chosen: Chosen, jump: float, start: float) -> Iterator[LiveSample]:
    """From ``start`` on the clocks of the chosen samples are ``jump`` seconds ahead; behind if it is negative."""
    for sample in samples:
        yield replace(sample, time=sample.time + jump) if sample.time >= start and chosen(sample) else sample


def clocks_leaping(samples: Samples, leaps: Sequence[tuple[float, Chosen, float]]) -> Iterator[LiveSample]:
    """Clocks that leap again: each leap is when (s), whose, and by how much (s); they add up."""
    for sample in samples:
        shift = sum(by for at, chosen, by in leaps if sample.time >= at and chosen(sample))
        yield replace(sample, time=sample.time + shift) if shift else sample


def clock_drifting(samples: Samples, chosen: Chosen, drift: float, start: float, takes: float) -> Iterator[LiveSample]:
    """From ``start`` on the clocks of the chosen samples drift ahead by ``drift`` seconds within ``takes`` seconds."""
    for sample in samples:
        share = min(1.0, max(0.0, (sample.time - start) / takes))
        yield replace(sample, time=sample.time + drift * share) if chosen(sample) else sample
