"""Quantity, axis and sensor in the names of columns and files: ``LF_acc_x``, ``Acc X [g]``, ``pelvis.gyro.z``, ``qw``.

A column may name its axis alone, ``x-axis (g)``: its unit tells the quantity, or the name of its file does.
"""

import re
from collections.abc import Mapping

AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
IGNORED = "ignored"  # quantity of what is measured, but not read
_WORDS = {
    "acceleration": r"(?:total)?(?:acc|accel|acceleration|accelerometer)|specificforce",
    "angular_rate": r"gyr|gyro|gyros|gyroscope|angvel|angularvelocity|angularrate|rotationrate|omega|turnrate",
    "quaternion": r"quat|quaternion|orientation|orient|ori|rot",
    IGNORED: r"mag|magn|magnet|magnetometer|(?:free|lin|linear|user|earth|highg)acc\w*|grav|gravity|uncal|uncalibrated|"
    r"euler|roll|pitch|yaw|temp|temperature|baro|pressure",
}
_LETTERS = {"a": "acceleration", "g": "angular_rate", "w": "angular_rate", "q": "quaternion", "m": IGNORED}
_UNITS = re.compile(r"axis|m?g|ms2|mps2|dps|degs?|rads?|radps|[mu]?s|ut|si|raw|cal", re.IGNORECASE)
_UNITS_OF = {
    "acceleration": r"m?g|m */ *s(\^?2|²|\*\*2|/s)|m *s\^?-2",
    "angular_rate": r"(deg|degrees?|°|rad|radians?) */ *s(ec)?|dps|rps|rad *s\^?-1",
    IGNORED: r"[munµμ]?t(esla)?|m?gauss|pa|hpa|lx|°?c|deg",
}
_COMPOUNDS = re.compile(
    r"\b(angular|specific|linear|free|user|earth|total|high g|turn|rotation) +(velocity|rate|force|acc\w*)\b",
    re.IGNORECASE,
)
# In files' names: content in other words, when, at which rate, and of which version of a program.
_PLAIN = re.compile(r"inertial|imu|motion|sensors?|data", re.IGNORECASE)
_EDITION = re.compile(
    r"(?<![A-Za-z0-9])(\d{4}-?\d\d-?\d\d[T_ -]?\d\d[.:_-]?\d\d([.:_-]?\d\d)?([.:_-]\d+)?|\d+(\.\d+)?hz|v?\d+(\.\d+)+)"
    r"(?![A-Za-z0-9])", re.IGNORECASE,
)  # fmt: skip


def meaning(name: str, unit: str = "", of_file: str = "") -> tuple[str, str, str] | None:
    """Sensor, quantity and axis that the name of a column tells, None if it is none of ours.

    Args:
        name: of the column, with its unit in brackets or without.
        unit: as a line below the names has it.
        of_file: quantity that the file's name tells, of columns that name an axis alone.
    """
    brackets = r"[\[(]\s*([^\])]{2,}|g)\s*[\])]"
    words = _words(re.sub(brackets, " ", name))
    axes = [word for word in words if word.lower() != "axis"]
    if len(axes) == 1 and re.fullmatch(r"(?i)[wxyz]", axes[0]):
        unit = next(iter(re.findall(brackets, name)), unit).strip()
        of_unit = (key for key, units in _UNITS_OF.items() if re.fullmatch(units, unit, re.IGNORECASE))
        quantity = of_file if of_file == IGNORED else next(of_unit, of_file)
        return None if quantity in ("", IGNORED) else ("", quantity, axes[0].lower())
    quantity, axis, rest = "", "", []
    for word in words:
        kind, letter = _word(word)
        if kind and not quantity:
            quantity, axis = kind, letter or axis
        elif quantity and not axis and re.fullmatch(r"(?i)q?[wxyzs0-4]", word):
            axis = word[-1].lower()
        elif quantity == "quaternion" and kind == "quaternion" and letter:
            axis = letter
        elif not (_UNITS.fullmatch(word) and (quantity or axis)):
            rest.append(word)
    if quantity in ("", IGNORED) or not axis:
        return None
    return "_".join(rest), quantity, "w" if axis == "s" else axis


def meaning_of_file(stem: str) -> tuple[str, str]:
    """The quantity that a file's name tells, blank if none, and the words of its sensor and recording."""
    words = _words(_EDITION.sub(" ", stem))
    kinds = {word: kind for word in words if (kind := _word(word)[0]) and not _word(word)[1]}
    quantity = IGNORED if IGNORED in kinds.values() else next(iter(kinds.values()), "")
    return quantity, "_".join(word for word in words if word not in kinds and not _PLAIN.fullmatch(word))


def complete(axes: Mapping[str, str], count: int) -> tuple[str, ...] | None:
    """The columns of all axes in order, by letters, or by numbers from 0 or 1 on."""
    for keys in (AXES[count], "0123"[:count], "1234"[:count]):
        if all(key in axes for key in keys):
            return tuple(axes[key] for key in keys)
    return None


def _words(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    spaced = re.sub(r"[^A-Za-z0-9]+", " ", spaced)
    return _COMPOUNDS.sub(lambda match: match[0].replace(" ", ""), spaced).split()


def _word(word: str) -> tuple[str, str]:
    """The quantity that a word names, and the axis if it ends in one: ``accX``, ``gz``, ``q0``."""
    lower = word.lower()
    for quantity, names in _WORDS.items():
        if match := re.fullmatch(rf"(?:{names})s?([wxyz0-4]?)", lower):
            return quantity, match[1]
    match = re.fullmatch(r"([agwqm])([wxyz0-4])", lower)
    return (_LETTERS[match[1]], match[2]) if match else ("", "")
