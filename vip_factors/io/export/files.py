"""Export of an estimate in the format of a file's suffix, at another frame rate on request."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from vip_factors.atomic import atomic_path, check_target
from vip_factors.body.joint_angles import R_WORLD_ISB
from vip_factors.body.kinematics import Motion
from vip_factors.display import distinct_file_names
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.geometry.quaternions import interpolate_points, interpolate_smoothly
from vip_factors.geometry.rotations import Array
from vip_factors.io.settings import ExportSettings, TimeZero

DEFAULT = ExportSettings()
R_YUP_WORLD = R_WORLD_ISB.T
"""x stays, z becomes y, y becomes -z, as in Blender and glTF. At rest a body then faces z, its left along x."""

Writer = Callable[[Estimate, Path, ExportSettings], None]
"""Writes all wearers of an estimate (one, if the format holds one person only) into a file."""


@dataclass(frozen=True)
class ExportFormat:
    """Format of an exported file.

    Attributes:
        writer: ``module:function`` in this folder, a :data:`Writer`, imported when it is needed.
        several: whether one file holds several wearers.
        has_times: whether it states the time of each frame, on a clock that can be chosen.
        package: required package of the extra ``export``.
    """

    writer: str
    several: bool = False
    package: str = ""
    has_times: bool = False


FORMATS: dict[str, ExportFormat] = {
    ".bvh": ExportFormat("animation:write_bvh"),
    ".glb": ExportFormat("animation:write_gltf", True, "pygltflib"),
    ".fbx": ExportFormat("animation:write_fbx", True, "pygltflib"),
    ".npz": ExportFormat("smpl:write_amass"),
    ".csv": ExportFormat("tables:write_csv", has_times=True),
    ".trc": ExportFormat("tables:write_trc", has_times=True),
    ".mot": ExportFormat("tables:write_mot", has_times=True),
    ".sto": ExportFormat("tables:write_opensense", has_times=True),
    ".c3d": ExportFormat("tables:write_c3d", package="ezc3d", has_times=True),
    ".pkl": ExportFormat("smpl:write_three_dpw", several=True),
}


def export_format(path: Path) -> ExportFormat:
    """The format of a file's suffix; refused if unknown, or without the format's package."""
    file_format = FORMATS.get(path.suffix.lower())
    if file_format is None:
        raise InputError(f"{path}: expected a file that ends in {', '.join(FORMATS)}")
    package = file_format.package
    if package and find_spec(package) is None:
        raise InputError(f"{path}: this needs {package}, which is not installed: pip install 'vip-factors[export]'")
    return file_format


def export(
    estimate: Estimate,
    path: Path,
    settings: ExportSettings = DEFAULT,
    overwrite: bool = False,
    on_message: Callable[[str], None] = lambda sentence: None,
    start_ns: int = 0,
    clock_s: float = 0.0,
) -> tuple[Path, ...]:
    """Write an estimate in the format of the suffix of ``path``.

    Args:
        estimate: of one wearer or several.
        path: the file; of several wearers in a format that holds one, ``walk.bvh`` becomes ``walk.Ada.bvh`` …
        settings: of the content.
        overwrite: whether files that exist may be replaced.
        on_message: called with the file of each wearer whose name is no valid or unique file name.
        start_ns, clock_s: t = 0 in nanoseconds since 1970, 0 if unknown, and on the log's own clock, for another zero.

    Returns:
        The files that were written.

    Raises:
        InputError: as :func:`export_format`, for an unknown wearer, one without frames, an unknown absolute time,
            or a file that may not be written.
    """
    file_format = export_format(path)
    chosen = _chosen(estimate, settings.wearer)
    for wearer in chosen.wearers:
        if len(wearer.motion) == 0:
            raise InputError(f"wearer '{wearer.name}' has no frames to export: was the estimate's file cut off?")
    chosen = resampled(chosen, settings.frame_rate)
    if file_format.has_times:
        chosen = _from_zero(chosen, settings.zero, start_ns, clock_s)
    contents = [chosen] if file_format.several else [_one_wearer(chosen, n) for n in range(len(chosen.wearers))]
    paths = [path]
    if len(contents) > 1:
        names = distinct_file_names(content.wearers[0].name for content in contents)
        paths = [path.with_name(f"{path.stem}.{name}{path.suffix}") for name in names]
    for target in paths:
        check_target(target, overwrite)
    module, _, function = file_format.writer.partition(":")
    write: Writer = getattr(import_module(f"vip_factors.io.export.{module}"), function)
    for content, target in zip(contents, paths, strict=True):
        with atomic_path(target, overwrite) as temporary:
            write(content, temporary, settings)
        name = content.wearers[0].name
        if len(contents) > 1 and not target.stem.endswith(f".{name}"):
            on_message(f"wearer '{name}' is written as {target.name}")
    return tuple(paths)


def _from_zero(estimate: Estimate, zero: TimeZero, start_ns: int, clock_s: float) -> Estimate:
    """The wearers' frames with times that count from the chosen zero."""
    if zero is TimeZero.ABSOLUTE and not start_ns:
        raise InputError("the recording states no absolute time: expected --zero recording or --zero log")
    shift = {TimeZero.RECORDING: 0.0, TimeZero.LOG: clock_s, TimeZero.ABSOLUTE: start_ns / 1e9}[zero]
    if not shift:
        return estimate
    motions = [replace(wearer.motion, start=wearer.motion.start + shift) for wearer in estimate.wearers]
    wearers = zip(estimate.wearers, motions, strict=True)
    return replace(estimate, wearers=tuple(replace(wearer, motion=motion) for wearer, motion in wearers))


def _chosen(estimate: Estimate, wearer: str | None) -> Estimate:
    if wearer is None:
        return estimate
    names = [candidate.name for candidate in estimate.wearers]
    if wearer not in names:
        raise InputError(f"no wearer '{wearer}' in the estimate: expected one of {', '.join(names)}")
    return _one_wearer(estimate, names.index(wearer))


def _one_wearer(estimate: Estimate, number: int) -> Estimate:
    """One wearer of a scene, with the detections of that wearer, and cameras without residuals."""
    return replace(
        estimate,
        wearers=(estimate.wearers[number],),
        cameras=tuple(
            replace(camera, residual_px=None, wearer_of_detection=np.where(camera.wearer_of_detection == number, 0, -1))
            for camera in estimate.cameras
        ),
    )


def resampled(estimate: Estimate, rate: float | None) -> Estimate:
    """The estimate at ``rate`` frames per second, from its first frame on; as it is if that is its rate or None.

    Poses follow cubic splines: against linear steps, feet that stand stay five times nearer to where they were.
    Nothing is filtered: at a lower rate, movements faster than half of it are sampled as they come. Covariances of
    poses are interpolated linearly; residuals and the cameras' covariances, which no format holds, are left out.
    """
    if rate is None:
        return estimate
    if not 0 < rate < float("inf"):
        raise InputError(f"{rate:g} frames a second: expected a positive number")
    motion = estimate.wearers[0].motion
    if abs(motion.rate - rate) <= 1e-9 * rate:  # rates come from differences of times
        return estimate
    wearers = tuple(_wearer(wearer, rate) for wearer in estimate.wearers)
    cameras = (replace(camera, covariance=None, residual_px=None) for camera in estimate.cameras)
    time = wearers[0].motion.time
    moved = (replace(camera, path=camera.path.at(time)) if len(camera.path) > 1 else camera for camera in cameras)
    return replace(estimate, wearers=wearers, cameras=tuple(moved))


def frame_times(time: Array, rate: float) -> Array:
    """Times at ``rate`` frames per second from the first to the last of ``time`` ``(N,)``."""
    return time[0] + np.arange(int(np.floor((time[-1] - time[0]) * rate + 1e-6)) + 1) / rate


def poses_at(motion: Motion, time: Array) -> tuple[Array, Array]:
    """Joint rotations ``(N, 24, 3, 3)`` and root positions ``(N, 3)`` at ``time`` ``(N,)``; the ends are kept."""
    inside = np.clip(time, motion.time[0], motion.time[-1])
    spline = make_interp_spline(motion.time, motion.p_world_pelvis, k=min(3, len(motion) - 1))
    return interpolate_smoothly(motion.time, motion.R_parent_child, inside), spline(inside)


def _wearer(estimate: WearerEstimate, rate: float) -> WearerEstimate:
    motion = estimate.motion
    time = frame_times(motion.time, rate)
    R, p = poses_at(motion, time)
    covariance = estimate.covariance
    if covariance is not None:
        numbers = (values.reshape(len(motion), -1) for values in (covariance.joints, covariance.root))
        joints, root = (interpolate_points(motion.time, rows, time) for rows in numbers)
        covariance = PoseCovariance(joints.reshape(-1, *covariance.joints.shape[1:]), root.reshape(-1, 3, 3))
    motion = replace(motion, R_parent_child=R, p_world_pelvis=p, rate=rate)
    return replace(estimate, motion=motion, covariance=covariance, residuals={})
