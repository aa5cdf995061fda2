"""Which weights matter, to what, and which way: all of them moved at once, by the plan of Plackett and Burman.

Nineteen weights at two levels in twenty runs, so that the effect of each is measured by all runs (Plackett & Burman
1946, Biometrika 33: 305). Rows are of the half of the population that is for choosing; what follows from them is to be
judged on the other half.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tests.studies.population import COLUMNS, PopulationRow, Simulated, population
from tests.studies.study import Tell, table
from tests.studies.tune import changed, value_of
from vip_factors.geometry.rotations import Array
from vip_factors.settings import Settings

# What is moved together, by the same ratio.
WEIGHTS: dict[str, tuple[str, ...]] = {
    "correlation time": ("factors.correlation_s", "camera.correlation_s"),
    "pose prior": ("factors.pose_prior.scale",),
    "mean pose": ("factors.pose_prior.mean_scale",),
    "joint limits": ("factors.joint_limit.sigma_deg",),
    "hinges": ("factors.hinge.sigma_deg",),
    "hinges, twist": ("factors.hinge.twist_sigma_deg",),
    "orientation": ("factors.orientation.sigma_deg",),
    "acceleration": ("factors.acceleration.sigma",),
    "acceleration, few sensors": ("factors.acceleration.sparse_sigma",),
    "places along": ("factors.sensor_place.along",),
    "places across": ("factors.sensor_place.across", "factors.sensor_place.elsewhere"),
    "keypoint offsets": (
        "camera.keypoint_offset.sigma", "camera.keypoint_offset.elbow_wrist_sigma", "camera.keypoint_offset.hip_sigma",
    ),
    "declared pose": ("factors.initial_pose.scale",),
    "smoothness": ("factors.smoothness.time",),
    "contacts": ("factors.foot_contact.sigma",),
    "heading prior": ("factors.heading_prior.least_sigma_deg",),
    "length prior": ("factors.length_scale",),
    "reprojection, scatter": ("camera.reprojection.persistence",),
    "reprojection, metres": ("camera.reprojection.point_sigma",),
}  # fmt: skip
RUNS = 20


def design() -> Array:
    """Levels ``(20, 19)``, −1 or 1, of each weight in each run; columns are orthogonal (Paley's construction)."""
    prime = RUNS - 1
    squares = {i * i % prime for i in range(1, prime)}
    signs = np.array([[(i - j) % prime in squares for j in range(prime)] for i in range(prime)]) * 2.0 - 1.0
    np.fill_diagonal(signs, 1.0)
    return np.vstack([np.ones(prime), -signs])


@dataclass(frozen=True)
class WeightsRow:
    """A scene in one run, or with the package's own weights (run 0)."""

    run: int
    result: PopulationRow


@dataclass(frozen=True, kw_only=True)
class Weights(Simulated):
    """Which weights matter, to what, and which way."""

    frame_rate: float = 15.0
    """Hz of the estimates: the calibration's own."""
    number: int = 14
    """Of scenes, spread over the half that is for choosing."""
    ratio: float = 1.42
    """By which each weight is larger or smaller."""

    def rows(self, tell: Tell) -> Iterator[WeightsRow]:
        chosen = [one for one in population(self.motions) if one.is_for_choosing]
        scenes = [chosen[i] for i in np.linspace(0, len(chosen) - 1, self.number).astype(int)]
        own = Settings()
        for run, levels in enumerate(np.vstack([np.zeros(len(WEIGHTS)), design()])):
            values = {
                name: value_of(own, name) * self.ratio**level
                for names, level in zip(WEIGHTS.values(), levels, strict=True)
                for name in names
            }
            for result in self.solved(scenes, changed(own, values), lambda what, done: tell(what, done)):
                yield WeightsRow(run, result)

    def tables(self, rows: Sequence[WeightsRow]) -> Iterator[str]:
        """Percent by which each metric changes where a weight is larger by the ratio, largest first."""
        runs = max(row.run for row in rows)
        levels, logs = design()[:runs], np.full((runs + 1, len(COLUMNS)), np.nan)
        for run in range(runs + 1):
            those = [[row.result.metrics[name] for name in COLUMNS] for row in rows if row.run == run]
            logs[run] = np.nanmean(np.log(np.maximum(those, 1e-3)), axis=0)
        if runs < RUNS:
            yield f"{runs} of {RUNS} runs: effects need all of them"
            return
        effects = 100 * levels.T @ (logs[1:] - logs[1:].mean(axis=0)) / RUNS
        order = np.argsort(-np.abs(effects[:, :2]).sum(axis=1))
        names = list(WEIGHTS)
        lines = [[names[i], *(f"{value:+.1f}" for value in effects[i])] for i in order]
        yield table([f"{self.ratio:g} times the", *(f"{name} %" for name in COLUMNS)], lines)
