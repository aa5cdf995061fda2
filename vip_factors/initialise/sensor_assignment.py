"""Which sensor is on which bone: bones that share a joint are accelerated alike there, whatever the mountings are.

Joint-centre accelerations of two sensors, with the arms to the joint and the heading between them left free, agree
within a tenth where the sensors are on neighbouring bones, and not at all elsewhere (joint positions are found so by
Seel, Schauer and Raisch 2012). Summed over the links of the sensor tree this tells how well a placement explains the
recording; the sum is compared with that of every exchange of two sensors.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, log, mean_rotation, nearest_rotation, transpose
from vip_factors.initialise.sensor_clocks import JointSignal, joint_misfit
from vip_factors.initialise.sensor_tree import MOST_LOOKS, SWINGS_PER_SECOND
from vip_factors.sensors.calibration import Placement

Pair = tuple[int, int]


# Nats by which an exchange has to be likelier to be reported. Of 58 recordings and scenes with all sensors in their
# places none came near; thighs, shanks or feet exchanged had 15 to 150 wherever legs moved for ten seconds.
LEAST_NATS = 10.0
# Share of the joints' acceleration by which neighbours may disagree: soft tissue leaves 0.05 to 0.3.
MISFIT = 0.1
SECONDS = 40.0  # of the recording, from its middle


@dataclass(frozen=True)
class Exchange:
    """Two sensors that are on one another's segments.

    Attributes:
        sensors: their numbers.
        nats: by which the recording is likelier with them exchanged.
        rivals: other exchanges that explain it as well, of which one is right.
        others: pairs that are exchanged as well, where whole limbs or sides are.
        evidence: in words, where it is not neighbours' accelerations.
    """

    sensors: Pair
    nats: float
    rivals: tuple[Pair, ...] = ()
    others: tuple[Pair, ...] = ()
    evidence: str = ""


ALIKE = 3.0  # nats between exchanges of which neither is told for the other: 20 to 1


def exchanged_sensors(
    signals: Sequence[JointSignal | None], links: Sequence[Pair], least: float = LEAST_NATS
) -> tuple[Exchange, ...]:
    """Exchanges that explain a recording better, one after the other; each supposes those before it.

    Args:
        signals: of ``S`` sensors; None of those that tell nothing.
        links: numbers of the sensors on bones that share a joint, as placed.
        least: nats by which an exchange has to be likelier.
    """
    cost = _pair_costs(signals)
    of, found = list(range(len(signals))), list[Exchange]()  # the sensor that is in each one's place
    while len(found) < len(signals) // 2:
        now = _gains(of, links, cost, least)
        if not now or max(now.values()) < least:
            break
        best = max(now, key=lambda pair: now[pair])
        rivals = tuple(pair for pair in now if pair != best and now[best] - now[pair] < ALIKE)
        found.append(Exchange(best, now[best], rivals))
        of[best[0]], of[best[1]] = of[best[1]], of[best[0]]
    return tuple(found)


def _pair_costs(signals: Sequence[JointSignal | None]) -> Callable[[int, int], float]:
    """Nats by which two sensors disagree about a joint that they would share, against two that share none."""

    @cache
    def cost(one: int, other: int) -> float:
        first, second = signals[one], signals[other]
        fitted = None if first is None or second is None else joint_misfit(first, second)
        if fitted is None:
            return 0.0
        share, seconds = fitted
        looks = min(seconds * SWINGS_PER_SECOND, MOST_LOOKS)
        return 1.5 * looks * float(np.log((min(share, 1.0) + MISFIT) / (1.0 + MISFIT)))

    return lambda one, other: cost(min(one, other), max(one, other))


def _gains(
    of: Sequence[int], links: Sequence[Pair], cost: Callable[[int, int], float], least: float
) -> dict[Pair, float]:
    """Nats that exchanges would gain, of those that could gain enough."""
    cheapest = 1.5 * MOST_LOOKS * float(np.log(MISFIT / (1.0 + MISFIT)))
    touching = [[link for link in links if one in link] for one in range(len(of))]
    found = {}
    for one, other in itertools.combinations(range(len(of)), 2):
        own = {*touching[one], *touching[other]} - {(one, other), (other, one)}
        now = sum(cost(of[a], of[b]) for a, b in own)
        if now - len(own) * cheapest < least:
            continue
        swap, then = {one: other, other: one}, len(own) * cheapest
        for a, b in own:
            then += cost(of[swap.get(a, a)], of[swap.get(b, b)]) - cheapest
            if now - then < least - ALIKE:  # whatever the others say
                break
        else:
            found[one, other] = now - then
    return found


def exchanged(placement: Placement, names: Sequence[str], exchanges: Sequence[Exchange]) -> Placement:
    """A placement with sensors in each other's sites."""
    sites = {site.sensor: site for site in placement.sites}
    for pair in (pair for exchange in exchanges for pair in (exchange.sensors, *exchange.others)):
        one, other = (names[number] for number in pair)
        sites[one], sites[other] = replace(sites[other], sensor=one), replace(sites[one], sensor=other)
    return replace(placement, sites=tuple(sites.values()))


TURN_FRAMES, WINDOW_FRAMES = 2, 100  # over which turns are compared; in which headings hardly drift


def spread_between(one: Array, other: Array, step: float) -> tuple[float, float]:
    """How two sensors turn against each other, RMS in radians about the mean of five seconds, whatever their mountings
    and headings are; and how fast the slower of the two turns, rad/s. NaN in less than five seconds.

    Args:
        one, other: ``(T, 3, 3)`` orientations in inertial frames, all known.
        step: seconds between frames.
    """
    turns = [log(transpose(R[:-TURN_FRAMES]) @ R[TURN_FRAMES:]) for R in (one, other)]
    between = one @ nearest_rotation(turns[0].T @ turns[1]) @ transpose(other)
    windows = [between[n : n + WINDOW_FRAMES] for n in range(0, len(between) - WINDOW_FRAMES + 1, WINDOW_FRAMES)]
    squares = [np.mean(angle_between(mean_rotation(own), own) ** 2) for own in windows]
    speed = min(float(np.sqrt(np.sum(turn**2, axis=1).mean())) for turn in turns) / (TURN_FRAMES * step)
    return (float(np.sqrt(np.mean(squares))), speed) if squares else (float("nan"), speed)
