"""The last stage: the estimate of a scene, with how sure it is and what is odd about it."""

from collections.abc import Iterator, Mapping

import numpy as np

from vip_factors.associate.associate import Association
from vip_factors.errors import SolveError
from vip_factors.estimate import CameraEstimate, Estimate, SceneEstimate, SolveReport
from vip_factors.geometry.rotations import Array
from vip_factors.graph.scene_batch import SceneObjective
from vip_factors.graph.scene_decode import camera_with_sigmas, decode_camera, decode_wearers, with_sigmas
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings, flatten
from vip_factors.solve.marginals import chain_marginals, last_marginals
from vip_factors.stages.fusion import Fused

UNSURE_HEADING = np.deg2rad(10.0)  # a heading no better known than this came from the straps
# Reprojection errors of the median frame, in sigmas of the detector: beyond this the camera is not the one calibrated.
IMPLAUSIBLE_MISFIT = 3.0
JUMP_SPEED = 15.0  # m/s: no hand moves a camera so; a cut in the video does


def scene_estimate(
    scene: Scene, coarse: Fused, fine: Fused, association: Association, reports: tuple[SolveReport, ...],
    settings: Settings,
) -> SceneEstimate:  # fmt: skip
    """The estimate: motions and camera of the full rate, how sure headings and mountings are of the coarse problem."""
    assert scene.camera is not None
    shared = _marginals_of_shared(coarse)
    marginals = None
    if settings.covariance:
        marginals = chain_marginals(SceneObjective(fine.model).linearise(fine.state))
    names = [wearer.name for wearer in scene.wearers]
    wearers = tuple(
        with_sigmas(estimate, coarse.model, number, shared)
        for number, estimate in enumerate(decode_wearers(names, "VIP", fine.model, fine.state, marginals))
    )
    camera = decode_camera(scene.camera.name, fine.model, fine.state, marginals, scene.camera.time_offset)
    camera = camera_with_sigmas(camera, coarse.model, shared)
    findings = tuple(dict.fromkeys([*association.findings, *_findings(scene, coarse, fine, wearers, camera, shared)]))
    return SceneEstimate(scene.name, "VIP", wearers, camera, association.wearer, reports, findings, flatten(settings))


def _marginals_of_shared(fused: Fused) -> Mapping[int, Array] | None:
    objective = SceneObjective(fused.model)
    if not objective.static_keys:
        return {}
    try:
        return last_marginals(objective.linearise(fused.state), objective.static_keys)
    except SolveError:
        return None


def _findings(
    scene: Scene, coarse: Fused, fine: Fused, wearers: tuple[Estimate, ...], camera: CameraEstimate,
    shared: Mapping[int, Array] | None,
) -> Iterator[str]:  # fmt: skip
    assert scene.camera is not None
    if shared is None:
        yield "the data do not determine all headings, mountings and the camera: they are as first guessed, in part"
    for recording, view, estimate in zip(scene.wearers, fine.model.views, wearers, strict=True):
        who = f"wearer '{recording.subject.name}'"
        if not view.seen.any():
            yield f"{who} is never seen: the pose is of the IMUs alone, and the place relative to the others unknown"
        unsure = [name for name, one in estimate.calibration.items() if one.heading_sigma > UNSURE_HEADING]
        if unsure:
            yield (
                f"{who}: the headings of {', '.join(unsure)} are not determined by the data (standard deviation above "
                f"{np.rad2deg(UNSURE_HEADING):.0f}°): keypoints beyond them (toes, hands) or longer motion would help"
            )
    yield from _camera_findings(scene, fine, camera)


def _camera_findings(scene: Scene, fine: Fused, camera: CameraEstimate) -> Iterator[str]:
    assert scene.camera is not None
    assert camera.residual_px is not None
    sigmas = [np.median(view.sigma[view.seen]) for view in fine.model.views if view.seen.any()]
    seen = camera.residual_px[np.isfinite(camera.residual_px)]
    if len(seen) and np.median(seen) > IMPLAUSIBLE_MISFIT * np.median(sigmas):
        yield (
            f"the reprojected skeletons miss the keypoints by {np.median(seen):.0f} px in the median frame, where "
            f"{np.median(sigmas):.0f} px would be usual: check the camera's calibration (another zoom or resolution?), "
            "the order of the keypoints, the clock offset and the wearers' stature"
        )
    path = camera.path
    if len(path) > 1 and scene.camera.known_path is None:
        step = np.diff(path.time)
        speed = np.linalg.norm(np.diff(path.p_world_camera, axis=0), axis=1) / step
        jumps = path.time[1:][speed > JUMP_SPEED]
        if len(jumps):
            yield (
                f"the camera jumps at {', '.join(f'{time:.2f}' for time in jumps[:5])} s: a cut in the video? Cut the "
                "recording there"
            )
