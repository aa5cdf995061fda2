"""What the estimators return: motion, calibration, how sure they are, and how the solve went. Plain data."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.motion import Motion
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration


@dataclass(frozen=True)
class Iteration:
    """One step of the optimiser: total cost after it, its damping, whether it was taken, and seconds by part."""

    cost: float
    damping: float
    accepted: bool
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SolveReport:
    """How a solve went.

    Attributes:
        stage: which solve of the pipeline this was.
        iterations: in order.
        initial_cost, final_cost: half the sum of squared whitened residuals (robust losses applied) by factor kind.
        converged: whether the cost stopped falling before the iteration limit.
        seconds: wall time of the whole solve.
    """

    stage: str
    iterations: tuple[Iteration, ...]
    initial_cost: Mapping[str, float]
    final_cost: Mapping[str, float]
    converged: bool
    seconds: float


@dataclass(frozen=True)
class PoseCovariance:
    """Marginal covariance of the joint rotations and of the root, at every frame.

    Attributes:
        joints: ``(T, 24, 3, 3)`` rad², of right perturbations of ``R_parent_child``.
        root: ``(T, 3, 3)`` m², of the root translation.
    """

    joints: Array
    root: Array

    @property
    def joint_sigma(self) -> Array:
        """Root mean square standard deviation of each joint's rotation, ``(T, 24)`` rad."""
        return np.sqrt(np.trace(self.joints, axis1=-2, axis2=-1) / 3)


@dataclass(frozen=True)
class Estimate:
    """A reconstructed recording.

    Attributes:
        name: of the recording it was made from.
        method: name of the variant (``"IT"``, ``"SOP"``, ``"SIP"`` …).
        motion: the wearer's motion.
        calibration: heading and mounting of every sensor used.
        covariance: on request.
        residuals: by factor kind, ``(T, sensors)`` norms in the unit named in the key (``orientation_deg``,
            ``acceleration_m_s2``); NaN where a sensor gave nothing. Columns follow ``sensors``.
        sensors: names of the sensors used.
        reports: one per solve, in order.
        settings: the effective settings, flattened to text.
    """

    name: str
    method: str
    motion: Motion
    calibration: Calibration
    covariance: PoseCovariance | None = None
    residuals: Mapping[str, Array] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    reports: tuple[SolveReport, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
