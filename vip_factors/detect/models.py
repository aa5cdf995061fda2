"""Pose models: the files of BlazePose's two, and top-down models in ONNX files, such as RTMPose.

BlazePose comes from a folder, a wheel of MediaPipe, or that wheel fetched once with pip. The models are Google's, under
the Apache licence 2.0. MediaPipe itself is not installed, as it requires an older NumPy.

For an ONNX model the image is scaled as for MMPose's (Jiang et al. 2023, "RTMPose"): the box widened by a quarter and
to the input's proportions, colours red first, normalised by ImageNet's mean and deviation. Outputs are identified by
their shapes: two of ``(1, K, bins)`` are SimCC's rows along x and y, one of ``(1, K, h, w)`` are heat maps.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.body.keypoints import KeypointSet, keypoint_set
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

MEDIAPIPE = "mediapipe==0.10.21"
# All of its wheels have the same models; this one can be fetched on every system.
WHEEL_OF = ("--python-version", "3.11", "--platform", "manylinux_2_28_x86_64", "--only-binary", ":all:")
DETECTOR, LANDMARKS = "pose_detection.tflite", "pose_landmark_full.tflite"
MEMBERS = {
    DETECTOR: "mediapipe/modules/pose_detection/pose_detection.tflite",
    LANDMARKS: "mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
}
SHA256 = {
    DETECTOR: "9ba9dd3d42efaaba86b4ff0122b06f29c4122e756b329d89dca1e297fd8f866c",
    LANDMARKS: "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
}


def cache_folder() -> Path:
    """Folder for fetched models: the platform's cache folder."""
    if sys.platform == "darwin":
        usual = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        usual = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        usual = Path.home() / ".cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or usual) / "vip-factors" / "blazepose"


def blazepose_files(
    source: Path | None, on_message: Callable[[str], None] = lambda sentence: None
) -> tuple[Path, Path]:
    """Find detector and landmark model in a wheel or folder, or in the cache, into which pip fetches them once.

    Args:
        source: wheel of MediaPipe (``.whl``), or a folder with the two ``.tflite`` files at any depth; None for the
            cache.
        on_message: called before a download, with what is fetched and from where.

    Raises:
        InputError: if a file is missing or cannot be fetched; the message says what to do instead.
        FileFormatError: if the file is no wheel, or a model is not the published one.
    """
    if source is not None and source.is_dir():
        return _model_of(source, DETECTOR), _model_of(source, LANDMARKS)
    cache = cache_folder()
    if source is not None:
        _unpack(source, cache)
    elif not all((cache / name).is_file() and _is_published(name, (cache / name).read_bytes()) for name in MEMBERS):
        _fetch(cache, on_message)
    return cache / DETECTOR, cache / LANDMARKS


def _model_of(folder: Path, name: str) -> Path:
    paths = sorted(folder.rglob(name))
    if not paths:
        raise InputError(f"{folder}: there is no {name} in it: expected {DETECTOR} and {LANDMARKS}")
    return paths[0]


def _is_published(name: str, content: bytes) -> bool:
    return hashlib.sha256(content).hexdigest() == SHA256[name]


def _unpack(wheel: Path, cache: Path) -> None:
    """Check the two models of a wheel and put them into the cache."""
    if not wheel.is_file():
        raise InputError(f"{wheel}: no such file: expected a wheel of {MEDIAPIPE}, or a folder with its models")
    try:
        with zipfile.ZipFile(wheel) as archive:
            content = {name: archive.read(member) for name, member in MEMBERS.items()}
    # Damage, also in names, unknown compression, or encryption.
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{wheel}: not a wheel ({error}): expected one of {MEDIAPIPE}") from error
    except KeyError as error:
        raise FileFormatError(f"{wheel}: {error.args[0]}: expected a wheel of {MEDIAPIPE}") from error
    for name, data in content.items():
        if not _is_published(name, data):
            raise FileFormatError(f"{wheel}: its {name} is not that of {MEDIAPIPE}: the SHA-256 sum differs")
    cache.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        with atomic_path(cache / name, overwrite=True) as path:
            path.write_bytes(data)


def _fetch(cache: Path, on_message: Callable[[str], None]) -> None:
    on_message(f"fetching BlazePose's models with pip, once: from the wheel of {MEDIAPIPE} (35 MB) into {cache}")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "--no-deps", *WHEEL_OF, "--dest", folder, "--quiet"]
        done = subprocess.run([*command, MEDIAPIPE], capture_output=True, text=True, check=False)
        wheels = sorted(Path(folder).glob("*.whl"))
        if done.returncode or not wheels:
            lines = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith("WARNING")]
            raise InputError(
                f"pip could not fetch {MEDIAPIPE} ({lines[-1].strip() if lines else 'no wheel came'}): download one of "
                "its wheels by other means, and give it as --blazepose WHEEL"
            )
        _unpack(wheels[0], cache)


MEAN, DEVIATION = np.array([123.675, 116.28, 103.53]), np.array([58.395, 57.12, 57.375])
# Keypoint set by the number of keypoints: COCO, Halpe, their whole-body forms, which begin with the set.
SET_OF_COUNT = {17: "coco17", 26: "halpe26", 133: "coco17", 136: "halpe26"}


@dataclass(frozen=True)
class Box:
    """Edges of a box in pixels."""

    left: float
    upper: float
    right: float
    lower: float


def box_around(points: Array) -> Box:
    """Box of a person from keypoints ``(N, 2)`` between toes and eyes."""
    above = 0.12  # of the keypoints' height: boxes in training reach to the hair, keypoints to the eyes
    (left, upper), (right, lower) = points.min(axis=0), points.max(axis=0)
    return Box(left, upper - above * (lower - upper), right, lower)


class OnnxPose:
    """Top-down pose model of an ``.onnx`` file; its keypoint set is the named one, or chosen by their number.

    Raises:
        InputError: if onnxruntime is not installed, or no keypoint set has this number of keypoints.
        FileFormatError: if the file is no such model.
    """

    def __init__(self, path: Path, threads: int, keypoints: str | None = None) -> None:
        largest_input = 4096  # pixels; top-down models take 256 × 192 to 384 × 288
        if not path.is_file():
            raise InputError(f"{path}: no such model file (.onnx)")
        try:
            import onnxruntime
        except ImportError as error:
            raise InputError(
                f"{path} needs onnxruntime, which is not installed: pip install 'vip-factors[detect]'"
            ) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = threads, 3  # 3: errors
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
            # Names may be no text.
            inputs = [(model_input.name, model_input.shape) for model_input in self._session.get_inputs()]
        except Exception as error:  # its exceptions share no base class
            reason = str(error).partition("\n")[0]
            raise FileFormatError(f"{path}: expected an ONNX model ({reason})") from error
        name, shape = inputs[0] if inputs else ("", [])
        sized = all(isinstance(length, int) and 0 < length <= largest_input for length in shape[2:])
        if len(inputs) != 1 or len(shape) != 4 or shape[1] != 3 or not sized:
            raise FileFormatError(
                f"{path}: input {shape}: expected one input (1, 3, height, width) of fixed size, {largest_input} at "
                "most, as a top-down pose model has"
            )
        self._path, self._name, self._height, self._width = path, name, shape[2], shape[3]
        count = self._outputs(np.zeros((self._height, self._width, 3)))[0].shape[0]
        self.keypoints = self._set(count, keypoints)

    def _set(self, count: int, declared: str | None) -> KeypointSet:
        name = declared or SET_OF_COUNT.get(count)
        if name is None:
            known_sets = ", ".join(f"{name} ({number})" for number, name in SET_OF_COUNT.items())
            raise InputError(
                f"{self._path} gives {count} keypoints: expected {known_sets}, or name their order (keypoints)"
            )
        chosen = keypoint_set(name)
        if len(chosen) > count or (len(chosen) < count and SET_OF_COUNT.get(count) != name):
            raise InputError(f"{self._path} gives {count} keypoints, but {name} has {len(chosen)}")
        return chosen

    def look(self, image: np.ndarray, box: Box) -> tuple[Array, Array]:
        """Keypoints ``(K, 2)`` of the person in a box of an image ``(height, width, 3)``, and confidences ``(K,)``.

        The image has bytes, red first; keypoints are in its pixels.
        """
        import cv2

        widened = 1.25
        size = (self._width, self._height)
        edges = (max(length, 1.0) for length in (box.right - box.left, box.lower - box.upper))
        scale = widened * max(edge / length for edge, length in zip(edges, size, strict=True))  # pixels per input pixel
        corner = np.array([box.left + box.right, box.upper + box.lower]) / 2
        corner = corner - scale * np.array(size) / 2
        matrix = np.column_stack([scale * np.eye(2), corner + (scale - 1) / 2])  # of pixels' middles
        crop = cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        outputs = self._outputs((crop - MEAN) / DEVIATION)
        if len(outputs) == 2:
            x, y = outputs
            place = np.column_stack([x.argmax(axis=1) / x.shape[1], y.argmax(axis=1) / y.shape[1]])
            confidence = np.minimum(x.max(axis=1), y.max(axis=1))
        else:
            place, confidence = heat_peaks(outputs[0]), outputs[0].max(axis=(1, 2))
        count = len(self.keypoints)
        return (corner + scale * (place * np.array(size)))[:count], np.clip(confidence, 0, 1)[:count]

    def _outputs(self, crop: Array) -> list[np.ndarray]:
        """Outputs for a normalised crop ``(height, width, 3)``: rows along x and y, or heat maps, without the batch."""
        batch = crop.transpose(2, 0, 1)[None].astype(np.float32)
        try:
            every = self._session.run(None, {self._name: batch})
        except Exception as error:  # its exceptions share no base class
            reason = str(error).partition("\n")[0]
            raise FileFormatError(
                f"{self._path}: the model does not run ({reason}); expected one that takes {batch.shape} floats"
            ) from error
        outputs = [output for output in every if isinstance(output, np.ndarray)]
        rows, maps = ([output[0] for output in outputs if output.ndim == axes] for axes in (3, 4))
        if len(rows) == 2 and len(rows[0]) == len(rows[1]):
            return rows
        if maps and not rows:
            return maps[:1]
        shapes = ", ".join(str(output.shape) for output in outputs)
        raise FileFormatError(f"{self._path}: outputs {shapes}: expected SimCC's two (1, K, bins), or heat maps")


def heat_peaks(heat: np.ndarray) -> Array:
    """Peaks ``(K, 2)`` of heat maps ``(K, h, w)`` as fractions of their size, moved by a quarter of a cell to the
    warmer side as the models' authors do (Newell et al. 2016).
    """
    count, height, width = heat.shape
    y, x = np.divmod(heat.reshape(count, -1).argmax(axis=1), width)
    which = np.arange(count)

    def towards(index: np.ndarray, length: int, warm: np.ndarray) -> Array:
        inner = (index > 0) & (index < length - 1)
        rise = warm[which, np.minimum(index + 1, length - 1)] - warm[which, np.maximum(index - 1, 0)]
        return np.where(inner, 0.25 * np.sign(rise), 0.0)

    dx, dy = towards(x, width, heat[which, y]), towards(y, height, heat[which, :, x])
    return np.column_stack([(x + 0.5 + dx) / width, (y + 0.5 + dy) / height])
