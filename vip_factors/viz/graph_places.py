"""Where the variables of one frame are drawn: joints as a body seen from the front, what frames share around it."""

from collections.abc import Mapping
from dataclasses import dataclass

from vip_factors.viz.graph_description import FrameVariable, GraphDescription
from vip_factors.viz.svg import Point, text_width

WIDTH, HEIGHT = 1100.0, 972.0
BODY = (WIDTH / 2, 472.0)  # the pelvis
COLUMN, NODE_X, PORT_X = 200.0, 172.0, 232.0  # of the rows at the sides: width, its circles, the squares of its factors
ROW, APART = 54.0, 25.0  # from row to row, and from circle to circle within one
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
            at[number] = row.x(NODE_X), row.y + APART * (place - (len(row.numbers) - 1) / 2)
    for group in groups:
        pitch = group.width / len(group.numbers)
        for place, number in enumerate(group.numbers):
            at[number] = group.left + pitch * (place + 0.5), SHARED_Y
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
        levels = _spread([BODY[1] + wanted[label] for label in labels])
        rows += [Row(label, tuple(found[label]), side, y) for label, y in zip(labels, levels, strict=True)]
    return tuple(rows)


def _spread(wanted: list[float], top: float = 92.0, bottom: float = 770.0) -> list[float]:
    """Heights near the wanted ones (rising), at least a row apart and within the panel if there is room."""
    found: list[float] = []
    for y in wanted:
        found.append(max(y, found[-1] + ROW if found else top))
    for place in reversed(range(len(found))):
        limit = bottom if place == len(found) - 1 else found[place + 1] - ROW
        found[place] = min(found[place], limit)
    return found


def _groups(graph: GraphDescription) -> tuple[Group, ...]:
    """The camera's below the body, the wearer's at the right of it."""
    numbers = [number for number, one in enumerate(graph.variables) if one.shared and not one.label]
    camera = [number for number in numbers if not graph.variables[number].of_the_body]
    body = [number for number in numbers if graph.variables[number].of_the_body]
    groups, right = [], 0.0
    if camera:
        width = _width([graph.variables[number] for number in camera])
        groups.append(Group(graph.variables[camera[0]].owner, tuple(camera), (WIDTH - width) / 2, width))
        right = (WIDTH + width) / 2
    if body:
        width = _width([graph.variables[number] for number in body])
        groups.append(
            Group(
                graph.variables[body[0]].owner,
                tuple(body),
                min(right + 24, WIDTH - width) if camera else (WIDTH - width) / 2,
                width,
            )
        )
    return tuple(groups)


def _width(variables: list[FrameVariable]) -> float:
    return len(variables) * max(104.0, 20 + max(text_width(one.kind, 11.5) for one in variables))
