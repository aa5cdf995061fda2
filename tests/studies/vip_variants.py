"""The thesis's trackers by name (4.4.2): what each is told of a scene, what it may change, and its published errors."""

from dataclasses import dataclass, replace

import numpy as np

from tests.studies.scenes import (
    as_calibration,
    calibrated_at_first_frame,
    distorted,
    nominal_start,
    pelvis_of,
    true_calibration,
    true_motion,
    with_nominal_pose,
    without_camera,
)
from vip_factors.errors import InputError
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.sensors.calibration import PRESETS, SITES, Calibration
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

SIX = frozenset(SITES[site].bone for site in PRESETS["sip6"])
NOMINAL, TRUE, FOUND = "nominal pose", "true pose", "as VIP found it"


@dataclass(frozen=True)
class Variant:
    """One tracker.

    Attributes:
        name: the thesis's, where it has one.
        start: where mountings and headings come from. :data:`NOMINAL`: the declared T-pose, headings by straps;
            :data:`TRUE`: the true first pose and true headings; :data:`FOUND`: the estimate of VIP.
        headings, mountings: whether they are estimated from there on.
        distortion_deg: the headings of the start are off by up to this, each sensor's for itself.
        six: of the sensors only those of SIP are used.
        camera: whether there is one.
        true_pixels, true_camera: detections without error; the camera's poses told.
        acceleration: False for the inertial tracker, frame by frame.
        spread: what the estimator's sigmas of keypoints are multiplied by.
    """

    name: str
    start: str = NOMINAL
    headings: bool = True
    mountings: bool = True
    distortion_deg: float = 0.0
    six: bool = False
    camera: bool = True
    true_pixels: bool = False
    true_camera: bool = False
    acceleration: bool = True
    spread: float = 1.0

    @property
    def needs_vip(self) -> bool:
        """Whether VIP has to have run on the same scene."""
        return self.start == FOUND


def _gtip(name: str, distortion_deg: float = 0.0) -> tuple[Variant, ...]:
    """Mountings of the true first pose, kept; with and without estimating headings."""
    return (
        Variant(name, TRUE, mountings=False, distortion_deg=distortion_deg),
        Variant(f"{name}-noHeadParam", TRUE, headings=False, mountings=False, distortion_deg=distortion_deg),
    )


def _inertial(name: str, start: str, **changes: bool) -> Variant:
    """Without camera, calibration kept."""
    return Variant(name, start, headings=False, mountings=False, camera=False, **changes)


VARIANTS: dict[str, Variant] = {
    one.name: one
    for one in (
        _inertial("IT", NOMINAL, acceleration=False),
        Variant("VIP"),
        _inertial("VIP-IT", FOUND, acceleration=False),
        Variant("VIP-2D", true_pixels=True),  # weighted as if they were a detector's, as in the thesis
        Variant("VIP-2D-exact", true_pixels=True, spread=0.1),  # and told that they are better than that
        Variant("VIP-Cam", true_camera=True),
        Variant("VIP-6", six=True),
        _inertial("SIP", TRUE, six=True),
        _inertial("SIP-zero", NOMINAL, six=True),
        _inertial("SOP", TRUE, six=True, acceleration=False),
        Variant("VIP-vanilla", headings=False, mountings=False),
        Variant("VIP-noHeadParam", headings=False),
        *_gtip("VIP-gtip"),
        Variant("VIP-25", distortion_deg=25.0),
        Variant("VIP-45", distortion_deg=45.0),
        *_gtip("VIP-gtip-25", 25.0),
        *_gtip("VIP-gtip-45", 45.0),
    )
}


def chosen_variants(names: tuple[str, ...] = ()) -> tuple[Variant, ...]:
    """Variants by name; all without one."""
    unknown = [name for name in names if name not in VARIANTS]
    if unknown:
        raise InputError(f"unknown variant '{unknown[0]}': expected some of {', '.join(VARIANTS)}")
    return tuple(VARIANTS[name] for name in names or VARIANTS)


def settings_of(variant: Variant, settings: Settings) -> Settings:
    """The pipeline's settings for a variant."""
    from_truth = variant.start != NOMINAL or variant.distortion_deg > 0
    camera = settings.camera
    reprojection = replace(camera.reprojection, spread=variant.spread * camera.reprojection.spread)
    return replace(
        with_nominal_pose(settings),
        acceleration=variant.acceleration,
        camera=replace(camera, reprojection=reprojection),
        fusion=replace(settings.fusion, use_camera=variant.camera),
        calibration=replace(
            settings.calibration,
            estimate_headings=variant.headings,
            estimate_mountings=variant.mountings,
            from_truth=from_truth,
        ),
    )


def told(scene: Scene, variant: Variant, settings: Settings, seed: int, found: Calibration | None = None) -> Scene:
    """The scene as a variant gets it; what it may not know of the truth is for the evaluation to keep."""
    wearer = scene.wearers[0]
    if variant.six:
        wearer = _with_six(wearer)
    wearer = _started(wearer, variant, settings, seed, found)
    scene = replace(scene, wearers=(wearer,))
    if not variant.camera:
        return without_camera(scene)
    if variant.true_pixels:
        scene = with_true_pixels(scene)
    if variant.true_camera:
        if scene.camera is None or scene.truth is None:
            raise InputError(f"scene '{scene.name}' has no true camera: expected a simulated one")
        scene = replace(scene, camera=replace(scene.camera, known_path=scene.truth.camera))
    return scene


def with_true_pixels(scene: Scene) -> Scene:
    """The wearers' own detections alone, each keypoint where it really is, with confidence one."""
    camera, truth = scene.camera, scene.truth
    if camera is None or truth is None or truth.pixels is None:
        raise InputError(f"scene '{scene.name}' does not know its true keypoints: expected a simulated one")
    mine = truth.wearer >= 0
    pixels = truth.pixels[mine]
    confidence = np.all(np.isfinite(pixels), axis=2).astype(float)
    detections = replace(camera.detections, frame=camera.detections.frame[mine], pixels=pixels, confidence=confidence)
    truth = replace(truth, wearer=truth.wearer[mine], pixels=pixels)
    return replace(scene, camera=replace(camera, detections=detections), truth=truth)


def _with_six(wearer: Recording) -> Recording:
    sites = tuple(site for site in wearer.placement.sites if site.bone in SIX)
    kept = {site.sensor: wearer.imus[site.sensor] for site in sites if site.sensor in wearer.imus}
    return replace(wearer, imus=kept, placement=replace(wearer.placement, sites=sites))


def _started(
    wearer: Recording, variant: Variant, settings: Settings, seed: int, found: Calibration | None
) -> Recording:
    """The recording with the calibration that the pipeline is to start from where its truth should be."""
    if variant.start == NOMINAL and not variant.distortion_deg:
        return wearer
    if variant.start == FOUND:
        if found is None:
            raise InputError(f"variant {variant.name} starts from what VIP found: run VIP on the same scene first")
        return replace(wearer, truth=Truth(true_motion(wearer), found), initial_pose="none")
    if variant.start == TRUE:
        wearer = calibrated_at_first_frame(wearer)
        known, names = true_calibration(wearer), tuple(wearer.placed)
        start = InitialCalibration(
            np.array([known[name].heading for name in names]), np.zeros(len(names)),
            np.stack([known[name].R_bone_sensor for name in names]),
        )  # fmt: skip
    else:
        names, start = nominal_start(wearer, settings)
    if variant.distortion_deg:
        random = np.random.default_rng([seed, 0xD157])
        start = distorted(start, pelvis_of(wearer, names), variant.distortion_deg, random)
    return replace(wearer, truth=Truth(true_motion(wearer), as_calibration(names, start)))


# What von Marcard's thesis (2019) reports, on TotalCapture and 3DPW, other data sets than ours: (MPJPE mm, MPJAE deg)
# by tracker over all of TotalCapture's test sequences, then by activity.
SECONDS_1000_FRAMES_20_ITERATIONS = 450.0  # 3.4.1: MATLAB, one core, six sensors
PUBLISHED: dict[str, tuple[float, float]] = {
    "IT": (55.0, 17.5),  # table 4.1; its text says 16.9 deg
    "VIP": (26.0, 12.3),  # table 4.1
    "VIP-IT": (28.2, 12.2),  # table 4.4
    "VIP-vanilla": (45.8, 18.0),
    "VIP-noHeadParam": (25.9, 12.3),  # table 4.5
    "VIP-gtip": (25.3, 12.4),  # table 4.6
    "VIP-gtip-noHeadParam": (26.5, 13.1),
    "VIP-gtip-25": (25.3, 12.4),
    "VIP-gtip-45": (25.2, 12.5),
    "VIP-gtip-25-noHeadParam": (34.5, 15.8),
    "VIP-gtip-45-noHeadParam": (50.3, 20.2),
    "VIP-2D": (15.1, 10.2),  # table 4.7
    "VIP-Cam": (25.3, 12.2),  # table 4.8
    "VIP-6": (35.8, 14.7),  # table 4.9
    "SIP": (52.2, 14.6),
    "SIP-zero": (68.7, 18.6),
    "SOP": (76.2, 19.7),  # table 3.3
}
PUBLISHED_BY_ACTIVITY: dict[str, dict[str, tuple[float, float]]] = {  # tables 4.2 and 4.3
    "IT": {"walking": (54.5, 15.6), "freestyle": (57.3, 20.5), "acting": (53.2, 16.8), "mean": (55.0, 17.5)},
    "VIP": {"walking": (21.9, 10.5), "freestyle": (32.2, 15.3), "acting": (24.2, 11.2), "mean": (26.0, 12.3)},
}

ASSOCIATION_3DPW = (99.3, 92.2)  # 4.4.3: precision and recall in percent
