"""What goes wrong with live streams: samples lost, late, twice, in disorder, from clocks that leap, sensors that slip.

Every function takes samples in the order of their arrival and gives them in theirs; a sample's time is when it was
measured, and only those of clocks change it. Same seed, same fault. Below them are faults by name, those of clocks at
moments that chance chooses.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from heapq import heappop, heappush
from itertools import count

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

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


def clocks_leaping(samples: Samples, leaps: Sequence[tuple[float, Chosen, float]]) -> Iterator[LiveSample]:
    """Clocks that leap: when (s), whose, and by how many seconds they are ahead from then on; leaps add up."""
    for sample in samples:
        shift = sum(by for at, chosen, by in leaps if sample.time >= at and chosen(sample))
        yield replace(sample, time=sample.time + shift) if shift else sample


def clock_drifting(samples: Samples, chosen: Chosen, drift: float, start: float, takes: float) -> Iterator[LiveSample]:
    """From ``start`` on the clocks of the chosen samples drift ahead by ``drift`` seconds within ``takes`` seconds."""
    for sample in samples:
        share = min(1.0, max(0.0, (sample.time - start) / takes))
        yield replace(sample, time=sample.time + drift * share) if chosen(sample) else sample


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: for people and for the command line.
        begin: seconds from the start of the stream.
        end: when it is over; infinite if what has changed stays so.
        change: the stream with the fault.
        jump: seconds that the clocks of all samples leap at ``begin``.
    """

    name: str
    begin: float
    end: float
    change: Callable[[Samples], Iterator[LiveSample]]
    jump: float = 0.0

    @property
    def lasts(self) -> bool:
        """Whether it never ends."""
        return not np.isfinite(self.end)


# Sensors that slip, with their bones' long axes and an axis across, in the bone.
LIMBS: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "left_forearm": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "right_shank": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
DEAD = ("left_forearm", "right_shank", "pelvis")
TURN_DEG, HEADING_DEG = 40.0, 60.0
SLIP_S = 0.2  # that a strap takes to slip; a filter that starts anew takes no time
CAMERA_GONE_S = 10.0


def faults_of(scene: Scene, begin: float, seed: int = 0) -> dict[str, Fault]:
    """All faults of a scene's stream by name, each from ``begin`` (s) on."""
    wearer = scene.wearers[0]
    missing = sorted({*DEAD, *LIMBS} - set(wearer.imus))
    if missing or wearer.truth is None or wearer.truth.calibration is None:
        what = f"no sensor '{missing[0]}'" if missing else "no truth"
        raise InputError(f"recording '{wearer.name}' has {what}: expected a simulated one with the 13 usual sensors")
    away = begin + 2.0
    faults = [
        Fault("30 % of IMU packets lost", begin, begin + 5, partial(
            lost, chosen=of_imus, start=begin, end=begin + 5, share=0.3, seed=seed)),
        Fault("no video for 10 s", begin, begin + CAMERA_GONE_S, partial(
            lost, chosen=of_video, start=begin, end=begin + CAMERA_GONE_S)),
        *(Fault(f"{sensor} dead", begin, FOREVER, partial(lost, chosen=OfSensors([sensor]), start=begin))
          for sensor in DEAD),
        *(fault for sensor in LIMBS for fault in _moved(wearer, sensor, begin)),
        Fault("silence of 2 s", begin, away, partial(lost, chosen=everything, start=begin, end=away)),
        Fault("video 150 ms late", begin, begin + 5, partial(
            delayed, chosen=of_video, delay=0.15, start=begin, end=begin + 5)),
        Fault("20 % of samples twice", begin, begin + 5, partial(
            repeated, chosen=everything, share=0.2, start=begin, end=begin + 5, seed=seed)),
        Fault("IMU samples up to 40 ms late, in disorder", begin, begin + 5, partial(
            delayed, chosen=of_imus, delay=0.0, jitter=0.04, start=begin, end=begin + 5, seed=seed)),
        *clock_faults(begin, seed),
    ]  # fmt: skip
    return {fault.name: fault for fault in faults}


def chosen_faults(scene: Scene, begin: float, names: tuple[str, ...]) -> list[Fault]:
    """Some faults by (parts of) their names; all if none is named."""
    faults = faults_of(scene, begin)
    for name in names:
        if not any(name in known for known in faults):
            raise InputError(f"no fault '{name}': expected some of: {'; '.join(faults)}")
    return [fault for known, fault in faults.items() if not names or any(name in known for name in names)]


def _moved(wearer: Recording, sensor: str, begin: float) -> Iterator[Fault]:
    assert wearer.truth is not None
    assert wearer.truth.calibration is not None
    R_sensor_bone = wearer.truth.calibration[sensor].R_bone_sensor.T
    for axis, where in zip(LIMBS[sensor], ("about", "across"), strict=True):
        turn = np.deg2rad(TURN_DEG) * (R_sensor_bone @ np.array(axis))
        yield Fault(
            f"{sensor} turned {TURN_DEG:g}° {where} its bone", begin, FOREVER,
            partial(turned_on_bone, sensor=sensor, turn=turn, start=begin, takes=SLIP_S),
        )  # fmt: skip
    yield Fault(
        f"{sensor}'s heading set {HEADING_DEG:g}° anew", begin, FOREVER,
        partial(heading_reset, sensor=sensor, angle=np.deg2rad(HEADING_DEG), start=begin),
    )  # fmt: skip


STEPS_S = (0.05, 1.0, 60.0, 3600.0)  # what NTP slews at most, a leap second, a forgotten minute, daylight saving
DRIFTS = ((0.05, 5.0), (-0.05, 5.0))  # seconds, and in how long: a hundred times what NTP does, so that it shows
WHOSE: tuple[tuple[str, Chosen], ...] = (
    ("right_shank's clock", OfSensors(["right_shank"])),
    ("the video's clock", of_video),
    ("all clocks", everything),
)
AGAIN, AGAIN_S = 5, 2.4  # leaps of one stream, and seconds from one to the next at least


def clock_faults(begin: float, seed: int = 0) -> Iterator[Fault]:
    """Each from a moment within a second of ``begin`` (s) on; same seed, same moments."""
    random = np.random.default_rng([seed, 5])
    for whose, chosen in WHOSE:
        of_all = chosen is everything
        for step in (sign * size for size in STEPS_S for sign in (1, -1)):
            at = begin + random.random()
            yield Fault(
                f"{whose} {abs(step):g} s {'ahead' if step > 0 else 'back'}", at, FOREVER,
                partial(clocks_leaping, leaps=[(at, chosen, step)]), jump=step if of_all else 0.0,
            )  # fmt: skip
        for step, takes in DRIFTS:
            at = begin + random.random()
            name = f"{whose} slewed {abs(step):g} s {'ahead' if step > 0 else 'back'} in {takes:g} s"
            change = partial(clock_drifting, chosen=chosen, drift=step, start=at, takes=takes)
            yield Fault(name, at, at + takes, change, jump=step if of_all else 0.0)
    leaps = []
    for number in range(AGAIN):
        _, chosen = WHOSE[number % 2]  # a stream whose every clock leaps begins anew each time
        step = float(random.choice(STEPS_S[1:]) * random.choice((1, -1)))
        leaps.append((begin + number * AGAIN_S + random.random(), chosen, step))
    name = f"{AGAIN} leaps of a sensor's clock and the video's"
    yield Fault(name, leaps[0][0], FOREVER, partial(clocks_leaping, leaps=leaps))
