"""What is done to a live stream, and when: faults by name, those of clocks at moments that chance chooses."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from tests.studies.stream_fault_injection import (
    FOREVER,
    Chosen,
    OfSensors,
    clock_drifting,
    clock_jumping,
    clocks_leaping,
    delayed,
    everything,
    heading_reset,
    lost,
    of_imus,
    of_video,
    repeated,
    turned_on_bone,
)  # fmt: skip
from vip_factors.errors import InputError
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

Samples = Iterable[LiveSample]


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: for people and for the command line.
        begin: seconds from the start of the stream.
        end: when it is over; infinite if what has changed stays so.
        change: the stream with the fault.
        overload_s: seconds that each update takes from begin to end; 0: the tracker keeps up.
        restart: whether tracking is begun anew at ``end`` by a program that knows nothing of before.
        jump: seconds that the clocks of all samples leap at ``begin``.
    """

    name: str
    begin: float
    end: float
    change: Callable[[Samples], Iterator[LiveSample]]
    overload_s: float = 0.0
    restart: bool = False
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
OVERLOAD_S = 8.0  # with updates of three frames each, five seconds of samples pile up: more than the queue holds


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
        Fault("started again after 2 s", begin, away, partial(lost, chosen=everything, start=begin, end=away),
              restart=True),
        Fault("video 150 ms late", begin, begin + 5, partial(
            delayed, chosen=of_video, delay=0.15, start=begin, end=begin + 5)),
        Fault("20 % of samples twice", begin, begin + 5, partial(
            repeated, chosen=everything, share=0.2, start=begin, end=begin + 5, seed=seed)),
        Fault("IMU samples up to 40 ms late, in disorder", begin, begin + 5, partial(
            delayed, chosen=of_imus, delay=0.0, jitter=0.04, start=begin, end=begin + 5, seed=seed)),
        Fault("right_shank's clock 3 s back", begin, FOREVER, partial(
            clock_jumping, chosen=OfSensors(["right_shank"]), jump=-3.0, start=begin)),
        *clock_faults(begin, seed),
        Fault("updates of 50 ms for 8 s", begin, begin + OVERLOAD_S, iter, overload_s=0.05),
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
                partial(clock_jumping, chosen=chosen, jump=step, start=at), jump=step if of_all else 0.0,
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
