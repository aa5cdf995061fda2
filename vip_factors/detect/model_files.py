"""Files of BlazePose's two models: from a folder, a wheel of MediaPipe, or that wheel fetched once with pip.

The models are Google's, under the Apache licence 2.0. MediaPipe itself is not installed, as it requires an older NumPy.
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

from vip_factors.atomic import atomic_path
from vip_factors.errors import FileFormatError, InputError

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


@dataclass(frozen=True)
class BlazePoseFiles:
    """Paths of the two models."""

    detector: Path
    landmarks: Path


def cache_folder() -> Path:
    """Folder for fetched models: the platform's cache folder."""
    if sys.platform == "darwin":
        usual = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        usual = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        usual = Path.home() / ".cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or usual) / "vip-factors" / "blazepose"


def blazepose_files(source: Path | None, on_message: Callable[[str], None] = lambda sentence: None) -> BlazePoseFiles:
    """Find the models in a wheel or folder, or in the cache, into which pip fetches them once.

    Args:
        source: wheel of MediaPipe (``.whl``), or a folder with the two ``.tflite`` files at any depth; None for the
            cache.
        on_message: called before a download, with what is fetched and from where.

    Raises:
        InputError: if a file is missing or cannot be fetched; the message says what to do instead.
        FileFormatError: if the file is no wheel, or a model is not the published one.
    """
    if source is not None and source.is_dir():
        return _of_folder(source)
    cache = cache_folder()
    if source is not None:
        _unpack(source, cache)
    elif not all(_is_published(cache / name, name) for name in MEMBERS):
        _fetch(cache, on_message)
    return BlazePoseFiles(cache / DETECTOR, cache / LANDMARKS)


def _of_folder(folder: Path) -> BlazePoseFiles:
    paths_of = {}
    for name in MEMBERS:
        paths = sorted(folder.rglob(name))
        if not paths:
            raise InputError(f"{folder}: there is no {name} in it: expected {DETECTOR} and {LANDMARKS}")
        paths_of[name] = paths[0]
    return BlazePoseFiles(paths_of[DETECTOR], paths_of[LANDMARKS])


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
        if hashlib.sha256(data).hexdigest() != SHA256[name]:
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


def _is_published(path: Path, name: str) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == SHA256[name]
