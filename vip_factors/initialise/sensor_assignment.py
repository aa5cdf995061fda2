"""Check of the assignment of sensors to bones: two bones have the same acceleration at their common joint.

Joint-centre accelerations of two sensors, with free arms and relative heading, agree within a tenth if the sensors are
on neighbouring bones, and not at all otherwise (cf. Seel, Schauer and Raisch 2012). Their sum over the links of the
sensor tree rates a placement; it is compared with that of every exchange of two sensors.
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

LEAST_NATS = 10.0  # gain for which an exchange is reported; exchanged leg sensors gain 15 to 150 in ten seconds
MISFIT = 0.1  # share of the joints' acceleration by which neighbours may disagree: soft tissue causes 0.05 to 0.3
SECONDS = 40.0  # of the recording, from its middle


@dataclass(frozen=True)
class Exchange:
    """Two sensors that are exchanged.

    Attributes:
        sensors: numbers of the sensors.
        nats: gain in log-likelihood by the exchange.
        rivals: alternative exchanges that explain the recording as well.
        others: further exchanged pairs, if whole limbs or sides are exchanged.
        evidence: in words, if it is not the acceleration of neighbours.
    """

    sensors: Pair
    nats: float
    rivals: tuple[Pair, ...] = ()
    others: tuple[Pair, ...] = ()
    evidence: str = ""


AMBIGUOUS_NATS = 3.0  # difference below which two exchanges are equally likely: 20 to 1


def exchanged_sensors(
    signals: Sequence[JointSignal | None], links: Sequence[Pair], least: float = LEAST_NATS
) -> tuple[Exchange, ...]:
    """Find exchanges that explain a recording better, greedily; each assumes the previous ones.

    ``signals`` are None for unusable sensors, ``links`` pairs of sensors on bones that share a joint, as placed;
    ``least`` is the smallest gain in nats.
    """
    cost = _pair_costs(signals)
    of, exchanges = list(range(len(signals))), list[Exchange]()  # sensor at each site
    while len(exchanges) < len(signals) // 2:
        gains = _gains(of, links, cost, least)
        if not gains or max(gains.values()) < least:
            break
        likeliest = max(gains, key=lambda pair: gains[pair])
        rivals = tuple(pair for pair in gains if pair != likeliest and gains[likeliest] - gains[pair] < AMBIGUOUS_NATS)
        exchanges.append(Exchange(likeliest, gains[likeliest], rivals))
        of[likeliest[0]], of[likeliest[1]] = of[likeliest[1]], of[likeliest[0]]
    return tuple(exchanges)


def _pair_costs(signals: Sequence[JointSignal | None]) -> Callable[[int, int], float]:
    """Cost in nats of a common joint of two sensors, relative to sensors without a common joint."""

    @cache
    def cost(sensor_a: int, sensor_b: int) -> float:
        signal_a, second = signals[sensor_a], signals[sensor_b]
        fitted = None if signal_a is None or second is None else joint_misfit(signal_a, second)
        if fitted is None:
            return 0.0
        share, seconds = fitted
        looks = min(seconds * SWINGS_PER_SECOND, MOST_LOOKS)
        return 1.5 * looks * float(np.log((min(share, 1.0) + MISFIT) / (1.0 + MISFIT)))

    return lambda a, b: cost(min(a, b), max(a, b))


def _gains(
    of: Sequence[int], links: Sequence[Pair], cost: Callable[[int, int], float], least: float
) -> dict[Pair, float]:
    """Gains in nats of exchanges that could gain enough."""
    cheapest = 1.5 * MOST_LOOKS * float(np.log(MISFIT / (1.0 + MISFIT)))
    touching = [[link for link in links if sensor in link] for sensor in range(len(of))]
    gains = {}
    for sensor_a, sensor_b in itertools.combinations(range(len(of)), 2):
        affected = {*touching[sensor_a], *touching[sensor_b]} - {(sensor_a, sensor_b), (sensor_b, sensor_a)}
        cost_before = sum(cost(of[a], of[b]) for a, b in affected)
        if cost_before - len(affected) * cheapest < least:
            continue
        swap, cost_after = {sensor_a: sensor_b, sensor_b: sensor_a}, len(affected) * cheapest
        for a, b in affected:
            cost_after += cost(of[swap.get(a, a)], of[swap.get(b, b)]) - cheapest
            if cost_before - cost_after < least - AMBIGUOUS_NATS:  # cannot gain enough any more
                break
        else:
            gains[sensor_a, sensor_b] = cost_before - cost_after
    return gains


def exchanged(placement: Placement, names: Sequence[str], exchanges: Sequence[Exchange]) -> Placement:
    """Exchange sensors between sites of a placement."""
    sites = {site.sensor: site for site in placement.sites}
    for pair in (pair for exchange in exchanges for pair in (exchange.sensors, *exchange.others)):
        sensor_a, sensor_b = (names[number] for number in pair)
        sites[sensor_a], sites[sensor_b] = (
            replace(sites[sensor_b], sensor=sensor_a),
            replace(sites[sensor_a], sensor=sensor_b),
        )
    return replace(placement, sites=tuple(sites.values()))


TURN_FRAMES, WINDOW_FRAMES = 2, 100  # for comparing rotations; short against the drift of headings


def spread_between(R_a: Array, R_b: Array, step: float) -> tuple[float, float]:
    """Relative rotation of two sensors, RMS in radians about its mean over five seconds, for any calibration.

    Also returns the angular speed of the slower one, rad/s. NaN in less than five seconds. ``R_a`` and ``R_b``
    ``(T, 3, 3)`` are orientations in inertial frames, all valid, every ``step`` seconds.
    """
    turns = [log(transpose(R[:-TURN_FRAMES]) @ R[TURN_FRAMES:]) for R in (R_a, R_b)]
    between = R_a @ nearest_rotation(turns[0].T @ turns[1]) @ transpose(R_b)
    windows = [between[n : n + WINDOW_FRAMES] for n in range(0, len(between) - WINDOW_FRAMES + 1, WINDOW_FRAMES)]
    squares = [np.mean(angle_between(mean_rotation(window), window) ** 2) for window in windows]
    speed = min(float(np.sqrt(np.sum(turn**2, axis=1).mean())) for turn in turns) / (TURN_FRAMES * step)
    return (float(np.sqrt(np.mean(squares))), speed) if squares else (float("nan"), speed)
