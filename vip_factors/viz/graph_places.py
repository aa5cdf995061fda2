"""Where the variables of one frame are drawn: joints as a body seen from the front, what frames share around it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from vip_factors.viz.graph_description import GraphDescription
from vip_factors.viz.svg import Point, text_width

WIDTH, HEIGHT = 1100.0, 972.0
BODY = (WIDTH / 2, 472.0)  # the pelvis
COLUMN, NODE_X, PORT_X = 200.0, 172.0, 232.0  # of the rows at the sides: width, its circles, the squares of its factors
APART = {1: 25.0, 2: 25.0}  # from circle to circle within a row of so many; of more 20
ROW_MARGIN = 4.0  # beyond the circles of a row
TIMES = "\N{MULTIPLICATION SIGN}"
KEY_WIDTH = 310.0  # at the left of the box below the body, where rings are explained
CAMERA_Y, SHARED_TOP, SHARED_Y, SHARED_HEIGHT = 838.0, 882.0, 914.0, 86.0
LEFT_HALF = {  # the wearer's left, at the right of the picture; the other half is its mirror image
    1: (50, 40), 4: (62, 168), 7: (70, 286), 10: (84, 332),
    13: (50, -214), 16: (106, -216), 18: (180, -184), 20: (240, -154), 22: (284, -132),
}  # fmt: skip
MIDDLE = {0: (0, 0), 3: (0, -58), 6: (0, -114), 9: (0, -170), 12: (0, -262), 15: (0, -322)}
RIGHT_OF = {1: 2, 4: 5, 7: 8, 10: 11, 13: 14, 16: 17, 18: 19, 20: 21, 22: 23}
JOINTS: Mapping[int, Point] = (
    MIDDLE | LEFT_HALF | {right: (-LEFT_HALF[left][0], LEFT_HALF[left][1]) for left, right in RIGHT_OF.items()}
)
ARMS = (13, 14, 16, 17, 18, 19, 20, 21, 22, 23)
LEGS = (1, 2, 4, 5, 7, 8, 10, 11)
# Rows of arms stand above the arm, the inner ones highest: their lines reach the bone without crossing others.
ROW_LEVEL = {
    13: -335,
    14: -335,
    16: -322,
    17: -322,
    18: -300,
    19: -300,
    20: -250,
    21: -250,
    22: -212,
    23: -212,
    9: -100,
    15: -400,
    12: -390,
}


@dataclass(frozen=True)
class Row:
    """What all frames share of one sensor, level with the bone that it is strapped to.

    Attributes:
        label: the sensor.
        numbers: of its variables.
        side: -1 at the left of the picture, 1 at the right.
        y: of its middle.
    """

    label: str
    numbers: tuple[int, ...]
    side: int
    y: float

    def x(self, distance: float) -> float:
        """At a distance from the panel's edge."""
        return distance if self.side < 0 else WIDTH - distance


@dataclass(frozen=True)
class Group:
    """What all frames share of one owner, beyond the rows, in a box below the body."""

    owner: str
    numbers: tuple[int, ...]
    left: float
    width: float


@dataclass(frozen=True)
class Places:
    """Everything's place in the panel.

    Attributes:
        at: of each variable, by its number.
        rows, groups: of the variables that all frames share.
    """

    at: Mapping[int, Point]
    rows: tuple[Row, ...]
    groups: tuple[Group, ...]


def places_of(graph: GraphDescription) -> Places:
    """Lay out the variables of a graph's frame."""
    at: dict[int, Point] = {}
    own_of_body, own_of_camera = 0, 0
    for number, one in enumerate(graph.variables):
        if one.shared:
            continue
        if one.joint is not None:
            x, y = JOINTS[one.joint]
        elif one.of_the_body:  # the root, between the legs
            x, y = 0, 100 + 56 * own_of_body
            own_of_body += 1
        else:
            x, y = 120 * own_of_camera, CAMERA_Y - BODY[1]
            own_of_camera += 1
        at[number] = BODY[0] + x, BODY[1] + y
    rows, groups = _rows(graph), _groups(graph)
    for row in rows:
        for place, number in enumerate(row.numbers):
            at[number] = row.x(NODE_X), row.y + _apart(row.numbers) * (place - (len(row.numbers) - 1) / 2)
    for group in groups:
        x = group.left
        for numbers in by_kind(graph, group.numbers).values():  # of several alike one circle is drawn
            width = _slot(graph, numbers)
            at |= dict.fromkeys(numbers, (x + width / 2, SHARED_Y))
            x += width
    return Places(at, rows, groups)


def _rows(graph: GraphDescription) -> tuple[Row, ...]:
    found: dict[str, list[int]] = {}
    for number, one in enumerate(graph.variables):
        if one.shared and one.label:
            found.setdefault(one.label, []).append(number)
    joints = {label: graph.variables[numbers[0]].bone or 0 for label, numbers in found.items()}
    sides: dict[int, list[str]] = {-1: [], 1: []}
    # Those of the middle go where there is room.
    for label in sorted(found, key=lambda one: JOINTS[joints[one]][0] == 0):
        x = JOINTS[joints[label]][0]
        side = -1 if x < 0 or (x == 0 and len(sides[-1]) <= len(sides[1])) else 1
        sides[side].append(label)
    rows: list[Row] = []
    for side, labels in sides.items():
        wanted = {label: ROW_LEVEL.get(joints[label], JOINTS[joints[label]][1]) for label in labels}
        labels = sorted(labels, key=lambda one: wanted[one])
        heights = [_apart(found[label]) * max(len(found[label]), 2) + ROW_MARGIN for label in labels]
        levels = _spread([BODY[1] + wanted[label] for label in labels], heights)
        rows += [Row(label, tuple(found[label]), side, y) for label, y in zip(labels, levels, strict=True)]
    return tuple(rows)


def _apart(numbers: Sequence[int]) -> float:
    return APART.get(len(numbers), 20.0)


def _spread(wanted: list[float], heights: list[float], top: float = 92.0, bottom: float = 770.0) -> list[float]:
    """Middles near the wanted ones (rising), rows of these heights apart, within the panel if there is room."""
    found: list[float] = []
    steps = [(one + other) / 2 for one, other in pairwise(heights)]
    for place, y in enumerate(wanted):
        found.append(max(y, found[-1] + steps[place - 1] if found else top))
    for place in reversed(range(len(found))):
        limit = bottom if place == len(found) - 1 else found[place + 1] - steps[place]
        found[place] = min(found[place], limit)
    return found


def _groups(graph: GraphDescription) -> tuple[Group, ...]:
    """The camera's below the body, the wearer's at the right of it."""
    numbers = [number for number, one in enumerate(graph.variables) if one.shared and not one.label]
    camera = tuple(number for number in numbers if not graph.variables[number].of_the_body)
    body = tuple(number for number in numbers if graph.variables[number].of_the_body)
    those = [one for one in (camera, body) if one]
    widths = [sum(_slot(graph, alike) for alike in by_kind(graph, one).values()) for one in those]
    total = sum(widths) + 24 * (len(those) - 1)
    left = min(max(KEY_WIDTH, (WIDTH - total) / 2), max(WIDTH - total, 0.0))
    groups = []
    for one, width in zip(those, widths, strict=True):
        groups.append(Group(graph.variables[one[0]].owner, one, left, width))
        left += width + 24
    return tuple(groups)


def by_kind(graph: GraphDescription, numbers: Sequence[int]) -> dict[str, list[int]]:
    """Variables of a group by what is written below them: the kind, and how many they are."""
    alike: dict[str, list[int]] = {}
    for number in numbers:
        alike.setdefault(graph.variables[number].kind, []).append(number)
    return {f"{kind} {TIMES} {len(those)}" if len(those) > 1 else kind: those for kind, those in alike.items()}


def _slot(graph: GraphDescription, alike: Sequence[int]) -> float:
    """Width of the place of variables of one kind, with what is written below."""
    (text,) = by_kind(graph, alike)
    return max(104.0, 24 + text_width(text, 11.5))
