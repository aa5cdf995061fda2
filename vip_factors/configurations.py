"""Named settings: other people's estimators, put together from our factors."""

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from math import sqrt
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from vip_factors.settings import CommonSettings, Settings
    from vip_factors.terms.robust import RobustLoss

Tree = TypeVar("Tree", bound="CommonSettings")


class Configuration(StrEnum):
    """Which settings to start from.

    Kaichi et al. 2020 (Sensors 20, 5453) estimate every frame by itself, with headings and mountings kept as the
    calibration pose gave them, no acceleration, and a camera of known pose.
    """

    OWN = "own"  # this package's
    KAICHI_FULL = "kaichi-full"  # F(full)
    KAICHI_UNWEIGHTED = "kaichi-unweighted"  # F(full, w_p = 1): without the adaptive biweight
    KAICHI_NO_CONTACT = "kaichi-no-contact"  # F(E_O, E_RoM, E_P): without the ground contact
    KAICHI_IMU = "kaichi-imu"  # F(E_O, E_RoM): no camera


# The weights that the paper's search found, and the units of what is squared under them. It names the pixel alone: of
# the others these are the ones in which the terms weigh something beside E_O. In radians and metres they would not.
ROM_WEIGHT, ROM_UNIT_DEG = 0.01, 1.0
KEYPOINT_WEIGHT, KEYPOINT_UNIT_PX = 5e-4, 1.0
GROUND_WEIGHT, GROUND_UNIT = 5e-3, 0.01  # m
SIGMA_DEG = 4.0  # of orientation: fixes the scale of the whole cost, and by that nothing else


def named_settings(name: Configuration | str) -> "Settings":
    """The settings of a configuration.

    Raises:
        ValueError: for an unknown name.
    """
    from vip_factors.settings import Settings

    return configured(Settings(), name)


def configured(own: Tree, name: Configuration | str) -> Tree:
    """Settings (of a stream too) with all that a configuration says, and the rest as it is.

    Raises:
        ValueError: for an unknown name.
    """
    if name not in list(Configuration):
        raise ValueError(f"{name!r} is no configuration: expected one of {', '.join(Configuration)}")
    changed: Tree = _SETTINGS[Configuration(name)](own)
    return changed


def cauchy_of(weight: float, unit: float, orientation_sigma: float) -> "tuple[float, RobustLoss]":
    """Sigma (in the unit's own unit) and loss that stand for ``λ log(1 + (e / unit)²)`` beside ``Σ ‖ΔR‖²``.

    ``‖ΔR‖² ≈ 2 θ²`` and our ``θ² / 2 σ²`` differ by the factor ``1 / 4 σ²``, and ours is ``k²/2 log(1 + (e / k s)²)``:
    so ``k² = λ / 2 σ²`` and ``k s`` is the unit.
    """
    from vip_factors.terms.robust import Loss, RobustLoss

    k = sqrt(weight / 2) / orientation_sigma
    return unit / k, RobustLoss(Loss.CAUCHY, k)


def _kaichi(own: Tree, weighted: bool = True, contact: bool = True, camera: bool = True) -> Tree:
    from vip_factors.terms.ground_contact import ContactFrom, GroundContactSettings, Weighing
    from vip_factors.terms.joint_limit import JointLimitSettings
    from vip_factors.terms.orientation import OrientationSettings
    from vip_factors.terms.pose_prior import PosePriorSettings
    from vip_factors.terms.reprojection import AdaptiveBiweightSettings, ReprojectionSettings
    from vip_factors.terms.robust import Loss, RobustLoss
    from vip_factors.terms.sole import SoleSettings

    orientation = OrientationSettings(SIGMA_DEG, RobustLoss(Loss.SQUARE))
    limit, limit_loss = cauchy_of(ROM_WEIGHT, ROM_UNIT_DEG, orientation.sigma)
    pixel, pixel_loss = cauchy_of(KEYPOINT_WEIGHT, KEYPOINT_UNIT_PX, orientation.sigma)
    ground, ground_loss = cauchy_of(GROUND_WEIGHT, GROUND_UNIT, orientation.sigma)
    factors = replace(
        own.factors,
        orientation=orientation,
        joint_limit=JointLimitSettings(limit, limit_loss, per_axis=True),
        # The paper has none: joints that neither sensor nor camera sees are only kept from drifting.
        pose_prior=PosePriorSettings(scale=0.02),
        sole=SoleSettings(thickness=0.0),  # the ankle's own height is all that the paper has
    )
    reprojection = ReprojectionSettings(
        adaptive=False, least_px=0.0, point_sigma=0.0, least_confidence=0.0, fixed_px=pixel, loss=pixel_loss,
        biweight=AdaptiveBiweightSettings(weighted, reach=2.0, scale_px=140.0),
    )  # fmt: skip
    feet = GroundContactSettings(
        contact, ContactFrom.ACCELERATION, Weighing.DISTANCE, ground, acceleration_scale=5.0, loss=ground_loss
    )
    return replace(
        own,
        acceleration=False,
        calibration=replace(own.calibration, estimate_headings=False, estimate_mountings=False),
        factors=factors,
        fusion=replace(own.fusion, use_camera=camera, camera_imu=False, refits=0),
        camera=replace(own.camera, reprojection=reprojection, ground_contact=feet),
    )


_SETTINGS: dict[Configuration, Callable[[Any], Any]] = {
    Configuration.OWN: lambda own: own,
    Configuration.KAICHI_FULL: _kaichi,
    Configuration.KAICHI_UNWEIGHTED: lambda own: _kaichi(own, weighted=False),
    Configuration.KAICHI_NO_CONTACT: lambda own: _kaichi(own, contact=False),
    Configuration.KAICHI_IMU: lambda own: _kaichi(own, camera=False),
}
