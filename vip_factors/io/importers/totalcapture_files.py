"""The text files of one TotalCapture sequence, as arrays in the units and frames of the files."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array

MOST_DIGITS = 12  # of a frame's number
COMPANIONS = {
    "bone": "calib_imu_bone.txt",
    "ref": "calib_imu_ref.txt",
    "position": "gt_skel_gbl_pos.txt",
    "orientation": "gt_skel_gbl_ori.txt",
}


@dataclass(frozen=True)
class SensorTable:
    """Content of a ``.sensors`` file.

    Attributes:
        names: of the sensors.
        index: ``(N,)`` 1-based frame numbers.
        values: ``(N, S, 7)`` ``qw qx qy qz ax ay az``, or ``(N, S, 13)`` with ``gx gy gz mx my mz``.
        truncated: a sentence if the file holds fewer frames than it announces.
    """

    names: tuple[str, ...]
    index: Array
    values: Array
    truncated: str = ""


def is_sensors_file(path: Path) -> bool:
    """Whether the head of the file is that of a ``.sensors`` file."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        lines = file.read(2048).decode("ascii", "replace").split("\n")
    if len(lines) < 3:
        return False
    counts, number, sample = lines[0].split(), lines[1].split(), lines[2].split()
    integers = len(counts) == 2 and len(number) == 1 and all(word.isdigit() for word in (*counts, *number))
    return integers and len(sample) in (8, 14) and not _is_number(sample[0]) and all(map(_is_number, sample[1:]))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def sensors_file(path: Path) -> Path:
    """The ``.sensors`` file at a path; of a folder's, the one with angular rates if there are two of one sequence.

    Raises:
        FileFormatError: if there is none, or several sequences.
    """
    if path.is_file():
        return path
    found = [file for file in sorted(path.glob("*.sensors")) if is_sensors_file(file)]
    if not found:
        raise FileFormatError(f"{path}: no .sensors file of TotalCapture there: expected 13 and the number of frames")
    if len({_sequence(file) for file in found}) > 1:
        names = ", ".join(file.name for file in found[:4])
        raise FileFormatError(f"{path}: holds several sequences ({names}): name the .sensors file you mean")
    return next((file for file in found if "AuxFields" in file.name), found[0])


def _sequence(file: Path) -> str:
    """The sequence's name without the subject, which only some of its files carry: ``s1_walking2_Xsens`` → walking2."""
    words = [word for word in file.stem.split("_") if word not in ("Xsens", "AuxFields")]
    return re.sub(r"^[sS]\d+_", "", "_".join(words))


def companion(sensors: Path, kind: str) -> Path | None:
    """The calibration or truth beside a ``.sensors`` file, found by its ending; of several, the same sequence's.

    Raises:
        FileFormatError: if it stays unclear which one.
    """
    ending = COMPANIONS[kind]
    found = sorted(file for file in sensors.parent.iterdir() if file.name.endswith(ending))
    if len(found) > 1:
        ours = [file for file in found if _sequence(sensors) in file.name.removesuffix(ending)]
        if len(ours) > 1:
            names = ", ".join(file.name for file in ours)
            raise FileFormatError(f"{sensors}: {names} may all belong to it: keep one sequence in a folder")
        found = ours
    return found[0] if found else None


def read_sensors(path: Path) -> SensorTable:
    """Read a ``.sensors`` file; one that breaks off gives its whole frames.

    Raises:
        FileFormatError: naming the line.
    """
    lines = path.read_text(encoding="ascii", errors="replace").rstrip().split("\n")
    counts = lines[0].split()
    if len(counts) != 2 or not all(word.isdigit() for word in counts) or int(counts[0]) < 1:
        raise FileFormatError(f"{path}: line 1 is '{lines[0][:40]}': expected the numbers of sensors and of frames")
    sensors, announced = int(counts[0]), int(counts[1])
    frames = (len(lines) - 1) // (sensors + 1)
    if frames < 1:
        raise FileFormatError(f"{path}: holds no whole frame: expected {announced}")
    names = tuple((line.split() or ["?"])[0] for line in lines[2 : 2 + sensors])
    index, rows = [], []
    for at, line in enumerate(lines[1 : 1 + frames * (sensors + 1)]):
        words, row = line.split(), at % (sensors + 1)
        if row == 0:
            if not line.strip().isdigit() or len(line.strip()) > MOST_DIGITS:
                raise FileFormatError(f"{path}: line {at + 2} is '{line[:40]}': expected a frame's number alone")
            index.append(float(line))
        elif words[:1] != [names[row - 1]]:
            said = words[0] if words else ""
            raise FileFormatError(f"{path}: line {at + 2} begins with '{said}': expected sensor {names[row - 1]}")
        else:
            rows.append(words[1:])
    values = _numbers(path, rows, first_line=3, widths=(7, 13)).reshape(frames, sensors, -1)
    truncated = "" if frames >= announced else f"{path.name} announces {announced} frames and holds {frames} whole ones"
    return SensorTable(names, np.array(index), values, truncated)


def read_calibration(path: Path) -> dict[str, Array]:
    """Rotations ``(3, 3)`` by sensor name, of a ``calib_imu_*.txt`` (w last).

    Raises:
        FileFormatError: naming the line.
    """
    rows = [line.split() for line in path.read_text(encoding="ascii", errors="replace").split("\n")[1:]]
    found = {}
    for number, words in enumerate(rows, start=2):
        if not words:
            continue
        if len(words) != 5 or not all(map(_is_number, words[1:])):
            raise FileFormatError(f"{path}: line {number} is '{' '.join(words)[:60]}': expected Name qx qy qz qw")
        try:
            found[words[0]] = matrix_from_quaternion(np.array(words[1:], float), Order.XYZW)
        except InputError as error:
            raise FileFormatError(f"{path}: line {number}: {error}") from error
    return found


def read_truth(path: Path, width: int) -> tuple[tuple[str, ...], Array]:
    """Joint names and ``(T, J, width)`` numbers of a ``gt_skel_gbl_*.txt``; a last line that breaks off is left out.

    Raises:
        FileFormatError: naming the line.
    """
    lines = path.read_text(encoding="ascii", errors="replace").rstrip().split("\n")
    names, rows = tuple(lines[0].split()), [line.split() for line in lines[1:]]
    if rows and len(rows[-1]) < len(names) * width:
        rows = rows[:-1]
    if not rows:
        raise FileFormatError(f"{path}: holds no frame: expected joint names and a line a frame")
    return names, _numbers(path, rows, first_line=2, widths=(len(names) * width,)).reshape(len(rows), -1, width)


def _numbers(path: Path, rows: list[list[str]], first_line: int, widths: tuple[int, ...]) -> Array:
    try:
        values = np.array(rows, dtype=float)
    except ValueError:
        values = np.empty((0, 0))
    if values.ndim == 2 and values.shape[1] in widths:
        return values
    width = len(rows[0]) if len(rows[0]) in widths else widths[0]
    for number, row in enumerate(rows):
        if len(row) != width or not all(map(_is_number, row)):
            expected = " or ".join(map(str, widths))
            what = f"{path}: around line {first_line + number}: {len(row)} values, such as '{' '.join(row[:4])}'"
            raise FileFormatError(f"{what}: expected {expected} numbers")
    raise FileFormatError(f"{path}: is no table of {' or '.join(map(str, widths))} numbers a line")
