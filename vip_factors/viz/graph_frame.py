"""One frame of a factor graph in full: joints as a body seen from the front, what is shared around it, all factors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from vip_factors.body.skeleton import PARENTS
from vip_factors.viz.graph_description import FrameFactors, GraphDescription
from vip_factors.viz.graph_symbols import RADIUS, Symbols
from vip_factors.viz.svg import FAINT, MUTED, RULE, Point, Svg, text_width

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


MANY, ALMOST_ALL = 8, 20  # variables that one factor sees; joints that have each one: then rings instead of lines
KEY_ROW = 34.0
FLESH = "#eef1f5"


def draw_frame(svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> None:
    """Draw the frame into a panel ``WIDTH`` by ``HEIGHT``."""
    panel = _Panel(svg, symbols, graph, corner)
    panel.boxes()
    panel.body()
    panel.lines()
    panel.variables()
    panel.squares()
    panel.rings()


class _Panel:
    """All of it; places are within the panel, ``_on`` puts them on the picture."""

    def __init__(self, svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> None:
        self.svg, self.symbols, self.graph, self.corner = svg, symbols, graph, corner
        self.places = places_of(graph)
        self.row_of = {number: row for row in self.places.rows for number in row.numbers}
        by_kind: dict[str, list[FrameFactors]] = {}
        for one in graph.factors:
            by_kind.setdefault(one.kind, []).append(one)
        self.collective = {kind: those for kind, those in by_kind.items() if self._is_collective(those)}
        self.single: list[tuple[FrameFactors, Point]] = []
        for one in graph.factors:
            if one.kind not in self.collective:
                self.single.append((one, self._square_place(one)))

    def _is_collective(self, those: list[FrameFactors]) -> bool:
        if max(len(one.sees) for one in those) > MANY:
            return True
        alone = all(len(one.sees) == 1 and self.graph.variables[one.sees[0]].joint is not None for one in those)
        return alone and len(those) > ALMOST_ALL

    def _on(self, point: Point) -> Point:
        return self.corner[0] + point[0], self.corner[1] + point[1]

    # Squares' places

    def _square_place(self, factor: FrameFactors) -> Point:
        """Where a factor goes: to its sensor's row, its joint, or what else it sees; the next free place there."""
        variables = self.graph.variables
        rows = [self.row_of[number] for number in factor.sees if number in self.row_of]
        joints = [number for number in factor.sees if variables[number].joint is not None]
        if rows and all(number in self.row_of for number in factor.sees) and len(factor.sees) == 1:
            x, y = self.places.at[factor.sees[0]]
            return self._free((x + 27 * rows[0].side, y), (18.0 * rows[0].side, 0.0))
        if rows:
            return self._free((rows[0].x(PORT_X), rows[0].y), (-20.0 * rows[0].side, 0.0))
        if joints:
            number = joints[0]
            joint, (x, y) = variables[number].joint, self.places.at[number]
            dx, dy = _away(joint or 0)
            return self._free((x + 27 * dx, y + 27 * dy), (19 * dx, 19 * dy))
        points = sorted({self.places.at[number] for number in factor.sees})
        x, y = sum(one[0] for one in points) / len(points), max(one[1] for one in points)
        return self._free((x - 26, y) if len(points) == 1 else (x, y - 47), (-19.0, 0.0))

    def _free(self, wanted: Point, step: Point) -> Point:
        x, y = wanted
        while any(abs(x - other[0]) < 15 and abs(y - other[1]) < 15 for _, other in self.single):
            x, y = x + step[0], y + step[1]
        return x, y

    # Painted, the lowest first

    def boxes(self) -> None:
        rows, top = self.places.rows, 40.0
        last = max((row.y for row in rows), default=0.0) + 36
        for side in sorted({row.side for row in rows}):
            left = 0.0 if side < 0 else WIDTH - COLUMN
            self._box((left, top), (COLUMN, last - top), "shared by all frames", top + 17)
        for group in self.places.groups:
            self._box((group.left, SHARED_TOP), (group.width, SHARED_HEIGHT), f"{group.owner}: shared", SHARED_TOP + 74)

    def _box(self, corner: Point, size: Point, title: str, y: float) -> None:
        self.svg.box(self._on(corner), size, "#f6f8fa", RULE)
        self.svg.text(self._on((corner[0] + size[0] / 2, y)), title, 10.5, MUTED, "middle")

    def body(self) -> None:
        """A grey figure: not part of the graph, but the order of its joints."""
        for joint, parent in enumerate(PARENTS):
            if parent >= 0:
                width = 24.0 if joint in ARMS else 32.0 if joint in LEGS else 50.0 if joint != 15 else 26.0
                self.svg.line(self._joint(parent), self._joint(joint), FLESH, width)
        self.svg.circle(self._joint(15), 33, FLESH, FLESH)
        for number, one in enumerate(self.graph.variables):
            if one.of_the_body and not one.shared and one.joint is None:  # the root, on which the pelvis stands
                self.svg.line(self._joint(0), self._on(self.places.at[number]), FLESH, 24.0)
        for side, x in (("right", -285.0), ("left", 285.0)):
            self.svg.text(self._on((BODY[0] + x, BODY[1] - 82)), f"wearer's {side}", 10.5, FAINT, "middle")

    def _joint(self, joint: int) -> Point:
        return self._on((BODY[0] + JOINTS[joint][0], BODY[1] + JOINTS[joint][1]))

    def lines(self) -> None:
        for factor, place in self.single:
            colour = self.symbols.factor_colour(factor.kind)
            for number in factor.sees:
                far = self.graph.variables[number].of_the_body
                self.svg.line(self._on(place), self._on(self.places.at[number]), colour, 1.2, 0.7 if far else 0.38)

    def variables(self) -> None:
        ringed = 8.0 + 4.0 * len(self.collective)
        for row in self.places.rows:
            x, anchor = (118.0, "end") if row.side < 0 else (WIDTH - 118.0, "start")
            self.svg.text(self._on((x, row.y + 4)), row.label, 11.5, anchor=anchor)
        for group in self.places.groups:
            for text, alike in by_kind(self.graph, group.numbers).items():
                x, y = self.places.at[alike[0]]
                self.symbols.variable(self.graph.variables[alike[0]].kind, self._on((x, y)))
                self.svg.text(self._on((x, y + 26)), text, 11.5, anchor="middle", halo=True)
        grouped = {number for group in self.places.groups for number in group.numbers}
        for number, one in enumerate(self.graph.variables):
            if number in grouped:
                continue
            x, y = self.places.at[number]
            self.symbols.variable(one.kind, self._on((x, y)))
            if one.joint is not None:
                self._joint_label(one.joint, one.label, (x, y), ringed)
            elif number not in self.row_of:
                below, at = (26, "middle") if one.of_the_body or one.shared else (4, "start")
                shift = 0 if at == "middle" else RADIUS + 8
                self.svg.text(self._on((x + shift, y + below)), one.kind, 11.5, anchor=at, halo=True)

    def _joint_label(self, joint: int, label: str, at: Point, ringed: float) -> None:
        text = label.removeprefix("left ").removeprefix("right ")
        x, y = at
        if joint in ARMS:
            self.svg.text(self._on((x, y - ringed - 5)), text, 11, MUTED, "middle", halo=True)
        elif joint in LEGS:
            inwards = -1 if JOINTS[joint][0] > 0 else 1
            anchor = "end" if inwards < 0 else "start"
            self.svg.text(self._on((x + inwards * (ringed + 5), y + 4)), text, 11, MUTED, anchor, halo=True)
        else:
            self.svg.text(self._on((x + ringed + 5, y + 4)), text, 11, MUTED, halo=True)

    def squares(self) -> None:
        for factor, place in self.single:
            self.symbols.factor(factor.kind, self._on(place), factor.count)

    def rings(self) -> None:
        """Kinds that see many variables: a ring around each, and what they are in a box below."""
        for place, (kind, those) in enumerate(self.collective.items()):
            for number in sorted({number for one in those for number in one.sees}):
                self.symbols.ring(kind, self._on(self.places.at[number]), RADIUS + 3.5 + 3.5 * place)
        if not self.collective:
            return
        texts = {kind: _ringed(those) for kind, those in self.collective.items()}
        size = 54 + max(text_width(text, 11) for text in texts.values()), KEY_ROW * len(texts) + 12
        top = SHARED_TOP + SHARED_HEIGHT - size[1]
        self.svg.box(self._on((0, top)), size, "#ffffff", RULE)
        for place, (kind, text) in enumerate(texts.items()):
            y = top + 6 + KEY_ROW * (place + 0.5)
            self.symbols.ring(kind, self._on((22, y)), RADIUS + 2)
            self.symbols.factor(kind, self._on((22, y)), side=9)
            self.svg.text(self._on((42, y - 2)), kind, 11.5)
            self.svg.text(self._on((42, y + 11)), text, 11, MUTED)


def _ringed(those: list[FrameFactors]) -> str:
    count = sum(one.count for one in those)
    if max(len(one.sees) for one in those) == 1:
        each, more = divmod(count, len(those))
        return f"{count} factors, {'some' if more else 'one' if each == 1 else each} on each ringed circle"
    return f"{'one factor' if count == 1 else f'{count} factors, each'} on all ringed circles"


def _away(joint: int) -> Point:
    """The direction from a joint in which its factors go: below arms, outside of legs, at the left of the middle."""
    if joint in ARMS:
        return 0.0, 1.0
    if joint in LEGS:
        return (0.87 if JOINTS[joint][0] > 0 else -0.87), 0.5
    return -1.0, 0.0
