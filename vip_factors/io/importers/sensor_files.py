"""The files of one recording among those at a path: one file, a folder, or the common start of their names."""

from collections.abc import Callable
from pathlib import Path

from vip_factors.errors import FileFormatError


def candidates(path: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files with one of the suffixes at a file, in a folder, or beginning with a prefix (``folder/Walk-1``), sorted."""
    if path.is_file():
        return [path] if path.suffix.lower() in suffixes else []
    if path.is_dir():
        inside = sorted(path.iterdir())
        return [file for file in inside if file.suffix.lower() in suffixes and not file.name.startswith(".")]
    if path.name and path.parent.is_dir():
        return [file for file in candidates(path.parent, suffixes) if file.name.startswith(path.name)]
    return []


def sensor_files(
    path: Path,
    suffixes: tuple[str, ...],
    is_ours: Callable[[Path], bool],
    split: Callable[[str], tuple[str, str]],
) -> dict[str, Path]:
    """Sensor name → file, for the files of the one recording at ``path``.

    Args:
        path: a file, a folder or a prefix.
        suffixes: of the files, lower case with the dot.
        is_ours: whether a file is of the format, by content.
        split: of a file's stem into recording and sensor name.

    Raises:
        FileFormatError: if there is none, several recordings, or two files of one sensor.
    """
    found = candidates(path, suffixes)
    files = [file for file in found if is_ours(file)]
    if not files:
        kind = " or ".join(suffixes)
        what = f"none of its {len(found)} {kind} files is of this format" if found else f"no {kind} file there"
        raise FileFormatError(f"{path}: {what}")
    recordings: dict[str, dict[str, Path]] = {}
    for file in files:
        recording, sensor = split(file.stem)
        sensors = recordings.setdefault(recording, {})
        if sensor in sensors:
            raise FileFormatError(
                f"{path}: {sensors[sensor].name} and {file.name} are both of sensor '{sensor}': expected one file per "
                "sensor; keep each recording in a folder of its own"
            )
        sensors[sensor] = file
    if len(recordings) > 1:
        folder = path if path.is_dir() else path.parent
        raise FileFormatError(
            f"{path}: holds files of {len(recordings)} recordings ({', '.join(list(recordings)[:4])} …); "
            f"name the one you mean, such as {folder / next(iter(recordings))}"
        )
    return next(iter(recordings.values()))


def merge_notes(notes: list[str]) -> tuple[str, ...]:
    """Notes of the form ``file: what`` that say the same of several files, as one note each."""
    said: dict[str, list[str]] = {}
    for note in notes:
        name, _, what = note.partition(": ")
        said.setdefault(what, []).append(name)
    return tuple(
        f"{names[0] if len(names) == 1 else f'{len(names)} sensors ({names[0]} …)'}: {what}" if what else names[0]
        for what, names in said.items()
    )
