"""Clocks of a live stream that step, drift or go back, at moments that chance chooses: faults by name."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from tests.studies.stream_fault import Fault
from vip_factors.simulate.stream_faults import (
    FOREVER,
    Chosen,
    OfSensors,
    clock_drifting,
    clock_jumping,
    clocks_leaping,
    everything,
    of_video,
)

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
