"""The least certain moments, with pictures: where the estimate fits worst, or knows least."""

import base64
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import Block, Image, Paragraph, Picture, Pictures, Section, joint_words
from vip_factors.report.fit import joined, mean_residual
from vip_factors.report.material import Material, Wearer
from vip_factors.viz.images import jpeg_bytes, png_bytes
from vip_factors.viz.picture import frame_picture, pose_picture

APART_S = 1.0  # between two moments of one wearer
SMOOTH_S = 0.2  # a moment lasts: single frames do not count
SIZE = (320, 400)  # pixels of a pose
FRAME_WIDTH = 640  # pixels of a video frame


@dataclass(frozen=True)
class Moment:
    """A wearer at a time, how many times as bad as usual it is there, and in what."""

    wearer: Wearer
    frame: int
    time: float
    times: float
    reason: str


def moments_section(material: Material, most: int) -> Section | None:
    """The worst moments of all wearers, with a picture of each; None if none is asked for or nothing tells of them."""
    worst = worst_moments(material, most)
    if not worst:
        return None
    pictures = []
    for one in worst:
        pose = pose_picture(one.wearer.estimate.motion, one.frame, SIZE)
        images = [Image(png(pose), f"the body at {one.time:.2f} s"), *_video_frame(material, one)]
        whose = f"{one.wearer.name}, " if len(material.wearers) > 1 else ""
        pictures.append(Picture(tuple(images), f"{whose}{one.time:.2f} s", one.reason, one.time))
    camera = material.scene.camera if material.scene is not None else None
    blind = camera is not None and (camera.video is None or not (camera.video.images or camera.video.path))
    blocks: list[Block] = [
        Paragraph(
            "Where the estimate differs most from what was measured, or knows least, against what is usual in this "
            "recording. Look at these first; elsewhere the body fits better. Left limbs are orange, "
            "right ones blue; in frames of the video bodies are the reconstructed ones, thin lines what "
            "the detector saw." + (" The video itself is not in the recording." if blind else "")
        ),
        Pictures(tuple(pictures)),
    ]
    return Section("moments", "The least certain moments", tuple(blocks))


def worst_moments(material: Material, most: int) -> list[Moment]:
    """Of all wearers and measures the worst, each of a wearer at least :data:`APART_S` from the others."""
    moments: list[Moment] = []
    for wearer in material.wearers:
        motion = wearer.estimate.motion
        for name, values in _measures(material, wearer).items():
            smooth = _smoothed(values, round(SMOOTH_S * motion.rate))
            usual = float(np.nanmedian(smooth)) if np.isfinite(smooth).any() else 0.0
            if usual <= 0:
                continue
            for frame in _peaks(smooth, round(APART_S * motion.rate), most):
                reason = f"{name.format(smooth[frame])} (usually {usual:.2g}){_where(wearer, name, frame)}"
                moments.append(Moment(wearer, frame, float(motion.time[frame]), smooth[frame] / usual, reason))
    chosen: list[Moment] = []
    for one in sorted(moments, key=lambda moment: -moment.times):
        near = any(one.wearer is other.wearer and abs(one.time - other.time) < APART_S for other in chosen)
        if not near and len(chosen) < most:
            chosen.append(one)
    return sorted(chosen, key=lambda moment: moment.time)


ORIENTATION, ACCELERATION = "orientations differ by {:.1f}°", "accelerations differ by {:.1f}\u202fm/s²"
VIDEO, UNSURE = "body and video differ by {:.0f}\u202fpx", "joints are known to ± {:.1f}° only"
_KINDS = {ORIENTATION: "orientation_deg", ACCELERATION: "acceleration_m_s2"}
"""Sentences with a place for the value, and of which residuals."""


def _measures(material: Material, wearer: Wearer) -> dict[str, Array]:
    """By name, ``(T,)`` each."""
    estimate, camera = wearer.estimate, material.estimate.camera
    measures = {
        name: mean_residual(estimate.residuals[kind])
        for name, kind in _KINDS.items()
        if kind in estimate.residuals and estimate.residuals[kind].size
    }
    if camera is not None and camera.residual_px is not None and len(camera.residual_px) == len(estimate.motion):
        measures[VIDEO] = joined(camera.residual_px)[:, wearer.index]
    if estimate.covariance is not None:
        measures[UNSURE] = np.rad2deg(estimate.covariance.joint_sigma.mean(axis=1))
    return measures


def _where(wearer: Wearer, name: str, frame: int) -> str:
    """Most of it where."""
    estimate = wearer.estimate
    if name == UNSURE and estimate.covariance is not None:
        return f", most at the {joint_words(JOINT_NAMES[int(np.argmax(estimate.covariance.joint_sigma[frame]))])}"
    if name in _KINDS:
        values = estimate.residuals[_KINDS[name]][frame]
        return f", most at {estimate.sensors[int(np.nanargmax(values))]}" if np.isfinite(values).any() else ""
    return ""


def _smoothed(values: Array, width: int) -> Array:
    """A running mean that leaves out what is not known."""
    width = max(1, min(width, len(values)))
    good, ones = np.isfinite(values), np.ones(width)
    total = np.convolve(np.where(good, values, 0.0), ones, "same")
    counted = np.convolve(good.astype(float), ones, "same")
    return np.where(good, total / np.maximum(counted, 1), np.nan)


def _peaks(values: Array, apart: int, most: int) -> list[int]:
    """Frames of the largest values, each a while from the others."""
    left, peaks = values.copy(), list[int]()
    while len(peaks) < most and np.isfinite(left).any():
        frame = int(np.nanargmax(left))
        peaks.append(frame)
        left[max(frame - apart, 0) : frame + apart] = np.nan
    return peaks


def _video_frame(material: Material, moment: Moment) -> list[Image]:
    """The frame of the video at a moment with the bodies over it, if the camera is there and sees something then."""
    drawn = material.drawn
    if drawn.detections is None or drawn.model is None or not len(drawn.detections.time):
        return []
    time = drawn.detections.time
    frame = int(np.argmin(np.abs(time - moment.time)))
    if abs(time[frame] - moment.time) > APART_S / 2:
        return []
    height = round(FRAME_WIDTH * drawn.model.height / drawn.model.width)
    image = frame_picture(drawn, frame, (FRAME_WIDTH, height))
    return [Image(jpeg(image), f"the video at {time[frame]:.2f} s with the bodies over it", wide=True)]


def png(image: np.ndarray) -> str:
    """A ``data:`` address of an image ``(height, width, 3)``, blue green red: of drawings."""
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode()}"


def jpeg(image: np.ndarray) -> str:
    """The same of photographs."""
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg_bytes(image)).decode()}"


POSES, STRIP_SIZE = 6, (180, 260)  # a row, pixels of a pose


def strip(material: Material) -> np.ndarray:
    """A row of poses for each wearer ``(height, width, 3)``, blue green red, evenly over the time."""
    rows = []
    for wearer in material.wearers:
        motion = wearer.estimate.motion
        frames = np.round(np.linspace(0.04, 0.96, POSES) * (len(motion) - 1)).astype(int)
        rows.append(np.concatenate([pose_picture(motion, int(frame), STRIP_SIZE) for frame in frames], axis=1))
    return np.concatenate(rows, axis=0)
