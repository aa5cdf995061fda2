"""A factor graph as a picture: one of its frames in full, and all kinds of variables and factors with their frames.

It draws whatever kinds a graph is made of, from :class:`GraphDescription`: circles are variables, squares are factors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from vip_factors.body.skeleton import PARENTS
from vip_factors.viz.charts import GRID, INK, SOFT_INK, Point, canvas, svg


@dataclass(frozen=True)
class VariableKind:
    """All variables of one kind.

    Attributes:
        kind: its name.
        count: how many there are in the graph.
        shared: whether all frames share them; else each frame has its own.
    """

    kind: str
    count: int
    shared: bool


@dataclass(frozen=True)
class FactorKind:
    """All factors of one kind.

    Attributes:
        kind: its name.
        count: how many there are in the graph.
        reach: frames that one of them spans; 0 if it sees only what all frames share.
        sees: kinds of the variables that they see.
        runs: first and last frame of each run of frames in which one of them begins.
    """

    kind: str
    count: int
    reach: int
    sees: tuple[str, ...]
    runs: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class FrameVariable:
    """A variable of the frame that is drawn in full, or one that all frames share.

    Attributes:
        kind: of it.
        owner: whose: a wearer's name, or the camera.
        label: of which sensor or joint, in words; empty of what there is one of.
        joint: index in the skeleton; None of what is no joint's.
        bone: index of the one that its sensor is strapped to; None of what is no such sensor's.
        shared: whether all frames share it.
        of_the_body: whether it is a wearer's; else the camera's.
    """

    kind: str
    owner: str
    label: str = ""
    joint: int | None = None
    bone: int | None = None
    shared: bool = False
    of_the_body: bool = True


@dataclass(frozen=True)
class FrameFactors:
    """Factors of one kind that see the same variables in the frame that is drawn in full: one square.

    Attributes:
        kind: of them.
        sees: indices of the frame's variables; of a chain of joints the last one only.
        count: how many they are.
    """

    kind: str
    sees: tuple[int, ...]
    count: int = 1


@dataclass(frozen=True)
class GraphDescription:
    """A factor graph to be drawn.

    Attributes:
        name: of the recording or scene.
        wearers: their names; the first one is drawn in full.
        frames: how many there are.
        seconds: from the first frame to the last.
        frame: index of the one that is drawn in full.
        frame_seconds: its time since the first frame.
        variable_kinds, factor_kinds: of the whole graph, in the order of their colours.
        variables: of the frame, and those that all frames share.
        factors: that see these alone.
    """

    name: str
    wearers: tuple[str, ...]
    frames: int
    seconds: float
    frame: int
    frame_seconds: float
    variable_kinds: tuple[VariableKind, ...]
    factor_kinds: tuple[FactorKind, ...]
    variables: tuple[FrameVariable, ...]
    factors: tuple[FrameFactors, ...]


WIDTH, MARGIN, ROW = 1600.0, 40.0, 27.0
PANEL = 1120.0  # width of the frame that is drawn in full; beside it is the legend
BODY = (MARGIN + PANEL / 2, 560.0)  # the pelvis
NODE_X, PORT_X, APART = 172.0, 258.0, 23.0  # of what sensors have: from the panel's edge, first circle and squares
SENSORS_Y = (150.0, 850.0)  # the uppermost and the lowest sensor
SHARED_Y, TABLE_TOP = 920.0, 1010.0
MANY, ALMOST_ALL = 8, 20  # variables that one factor sees; joints that have each one: then rings instead of lines
RADIUS, SIDE = 8.0, 13.0  # of a variable's circle and a factor's square
FLESH = "#e9ecf0"
FAINT = "#98a2ae"
MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"
SHOWN = 4  # frames beside the table
SEES_X, REACH_X, COUNT_X, WHEN_X, CHAIN_X, PITCH = 360.0, 610.0, 690.0, 720.0, 980.0, 160.0
# By the order of the kinds in a graph: a new kind takes the next one. Apart from each other on white.
VARIABLE_COLOURS = (
    "#3f6fb5", "#12918c", "#d4821a", "#8a5fd0", "#c2527e", "#2f6f4f", "#b0642f", "#607089", "#7f9f3f", "#a3283c",
)  # fmt: skip
FACTOR_COLOURS = (
    "#2f5fa8", "#e0474c", "#f28e2b", "#3f9b46", "#b07aa1", "#7b4fb5", "#17a2a2", "#d4a017", "#9c6b4f", "#d6568f",
    "#8c8c2b", "#5aa9d6", "#6b7684", "#a3283c", "#c44e1b", "#3b3f8f", "#40b890", "#7f9f3f", "#e08fb0", "#4a4a4a",
)  # fmt: skip
LEFT_HALF = {  # the wearer's left, at the right of the picture; the other half is its mirror image
    1: (50, 40), 4: (62, 168), 7: (70, 286), 10: (84, 332),
    13: (50, -214), 16: (106, -216), 18: (180, -184), 20: (240, -154), 22: (284, -132),
}  # fmt: skip
JOINTS: Mapping[int, Point] = {
    0: (0, 0), 3: (0, -58), 6: (0, -114), 9: (0, -170), 12: (0, -262), 15: (0, -322),
    **LEFT_HALF, **{left + 1: (-x, y) for left, (x, y) in LEFT_HALF.items()},
}  # fmt: skip
ARMS = (13, 14, 16, 17, 18, 19, 20, 21, 22, 23)
LEGS = (1, 2, 4, 5, 7, 8, 10, 11)
NOTES = (
    "Circles are variables, squares factors; a number in",
    "a square says how many of a kind it stands for.",
    "",
    "A factor on a bone sees every joint above it too,",
    "along the grey body to the pelvis, and the root if",
    "it asks where the bone is: only the last joint is",
    "joined to it.",
)


def graph_picture(graph: GraphDescription) -> str:
    """The picture as SVG text."""
    return svg(graph_axes(graph))


def graph_axes(graph: GraphDescription) -> Axes:
    """The same as axes in pixels."""
    axes = canvas(WIDTH, TABLE_TOP + 70 + ROW * len(graph.factor_kinds))
    painter = _Painter(axes, graph)
    painter.head()
    painter.frame()
    painter.legend()
    painter.table()
    return axes


def places_of(graph: GraphDescription) -> dict[int, Point]:
    """Where on the page each variable of the frame lies, by its number; of several alike that are shared, one place.

    Joints as a body seen from the front; what all frames share of a sensor in a row at that side, in the order of
    height; everything else in a row below.
    """
    at: dict[int, Point] = {}
    sensors: dict[str, list[int]] = {}
    below: dict[str, list[int]] = {}
    for number, one in enumerate(graph.variables):
        if one.joint is not None:
            at[number] = BODY[0] + JOINTS[one.joint][0], BODY[1] + JOINTS[one.joint][1]
        elif one.shared and one.label:
            sensors.setdefault(one.label, []).append(number)
        elif one.shared or not one.of_the_body:
            below.setdefault(f"{one.owner} {one.kind}", []).append(number)
        else:  # the root, between the legs
            at[number] = (
                BODY[0],
                BODY[1] + 100 + 56 * sum(place[0] == BODY[0] and place[1] > BODY[1] for place in at.values()),
            )
    for side, labels in _sides(graph, sensors).items():
        step = min(70.0, (SENSORS_Y[1] - SENSORS_Y[0]) / max(len(labels) - 1, 1))
        first = sum(SENSORS_Y) / 2 - step * (len(labels) - 1) / 2
        for row, label in enumerate(labels):
            for place, number in enumerate(sensors[label]):
                at[number] = _at_side(side, NODE_X + APART * place), first + step * row
    pitch = min(190.0, PANEL / max(len(below), 1))
    for place, numbers in enumerate(below.values()):
        x = MARGIN + PANEL / 2 + pitch * (place - (len(below) - 1) / 2)
        at |= dict.fromkeys(numbers, (x, SHARED_Y))
    return at


def _sides(graph: GraphDescription, sensors: Mapping[str, Sequence[int]]) -> dict[int, list[str]]:
    """Sensors at the left (−1) and right (1) of the picture, the uppermost first; those of the middle where is room."""
    place = {label: JOINTS[graph.variables[numbers[0]].bone or 0] for label, numbers in sensors.items()}
    sides: dict[int, list[str]] = {-1: [], 1: []}
    for label in sorted(sensors, key=lambda one: place[one][0] == 0):
        x = place[label][0]
        sides[-1 if x < 0 or (x == 0 and len(sides[-1]) <= len(sides[1])) else 1].append(label)
    return {side: sorted(labels, key=lambda one: place[one][1]) for side, labels in sides.items()}


def _at_side(side: int, distance: float) -> float:
    return MARGIN + (distance if side < 0 else PANEL - distance)


class _Painter:
    """Draws one graph, in the colours of its kinds."""

    def __init__(self, axes: Axes, graph: GraphDescription) -> None:
        self.axes, self.graph, self.at = axes, graph, places_of(graph)
        self.variable_colour = _coloured([one.kind for one in graph.variable_kinds], VARIABLE_COLOURS)
        self.factor_colour = _coloured([one.kind for one in graph.factor_kinds], FACTOR_COLOURS)
        by_kind: dict[str, list[FrameFactors]] = {}
        for one in graph.factors:
            by_kind.setdefault(one.kind, []).append(one)
        self.ringed = {kind: those for kind, those in by_kind.items() if self._is_ringed(those)}
        self.squares: list[tuple[FrameFactors, Point]] = []
        for one in graph.factors:
            if one.kind not in self.ringed:
                self.squares.append((one, self._square_place(one)))

    def _is_ringed(self, those: Sequence[FrameFactors]) -> bool:
        if max(len(one.sees) for one in those) > MANY:
            return True
        alone = all(len(one.sees) == 1 and self.graph.variables[one.sees[0]].joint is not None for one in those)
        return alone and len(those) > ALMOST_ALL

    def _square_place(self, factor: FrameFactors) -> Point:
        """Where a factor goes: to its sensor's row, its joint, or what else it sees; the next free place there."""
        variables = self.graph.variables
        rows = [number for number in factor.sees if variables[number].shared and variables[number].label]
        joints = [number for number in factor.sees if variables[number].joint is not None]
        (x, y), step = self.at[(rows or joints or factor.sees)[0]], (-19.0, 0.0)
        if rows:
            side = -1 if x < BODY[0] else 1
            if len(factor.sees) == 1:
                y, step = y + 19, (0.0, 16.0)
            else:
                x, step = _at_side(side, PORT_X), (-19.0 * side, 0.0)
        elif joints:
            dx, dy = _away(variables[joints[0]].joint or 0)
            x, y, step = x + 27 * dx, y + 27 * dy, (19 * dx, 19 * dy)
        elif len(factor.sees) == 1:
            x -= 26
        else:
            places = [self.at[number] for number in factor.sees]
            x, y = sum(place[0] for place in places) / len(places), max(place[1] for place in places) - 47
        while any(abs(x - other[0]) < 15 and abs(y - other[1]) < 15 for _, other in self.squares):
            x, y = x + step[0], y + step[1]
        return x, y

    def text(self, at: Point, text: str, size: float = 12.0, colour: str = INK, **more: Any) -> None:
        self.axes.text(*at, text, size=size, color=colour, zorder=6, **more)

    def line(self, start: Point, end: Point, colour: str, width: float = 1.3, alpha: float = 1.0) -> None:
        self.axes.plot(*zip(start, end, strict=True), color=colour, lw=width, alpha=alpha, solid_capstyle="round")

    def variable(self, kind: str, at: Point, radius: float = RADIUS) -> None:
        colour = self.variable_colour[kind]
        pale = [0.32 * one + 0.68 for one in to_rgb(colour)]
        self.axes.plot(*at, "o", ms=2 * radius, mfc=pale, mec=colour, mew=1.6, gid=f"variable {kind}", zorder=4)

    def factor(self, kind: str, at: Point, count: int = 1) -> None:
        """A square, with the number of factors it stands for if they are several."""
        side, colour = SIDE if count < 10 else 18.0, self.factor_colour[kind]
        self.axes.plot(*at, "s", ms=side, mfc=colour, mec="white", gid=f"factor {kind}", zorder=5)
        if count > 1:
            self.text(at, str(count), 10, "white", ha="center", va="center_baseline", weight="bold")

    def ring(self, kind: str, at: Point, radius: float) -> None:
        colour = self.factor_colour[kind]
        self.axes.plot(*at, "o", ms=2 * radius, mfc="none", mec=colour, mew=2.0, gid=f"ring {kind}", zorder=3)

    def head(self) -> None:
        """What it is, and how much of it."""
        graph = self.graph
        totals = [sum(one.count for one in kinds) for kinds in (graph.variable_kinds, graph.factor_kinds)]
        wearers = graph.wearers[0] if len(graph.wearers) == 1 else f"{len(graph.wearers)} wearers"
        self.text((MARGIN, 50), f"Factor graph of “{graph.name}”", 24, weight="bold")
        facts = (
            wearers,
            f"{graph.frames} frames in {graph.seconds:.2f} s",
            f"{totals[0]} variables",
            f"{totals[1]} factors",
        )
        self.text((MARGIN, 76), "  ·  ".join(facts), 14, SOFT_INK)
        more = len(graph.wearers) - 1
        which = f"at {graph.frame_seconds:.2f} s, {graph.wearers[0]}"
        which += f", and {more} more wearer{'s' if more > 1 else ''} alike" if more else ""
        self.text((MARGIN, 112), f"One frame in full: t = {graph.frame}", 15, weight="bold")
        self.text((MARGIN + 260, 112), which, 13, SOFT_INK)

    def frame(self) -> None:
        """One frame in full, over a grey figure that is not part of the graph, but the order of its joints."""
        joints = {joint: (BODY[0] + x, BODY[1] + y) for joint, (x, y) in JOINTS.items()}
        for joint, parent in enumerate(PARENTS[1:], start=1):
            width = 24.0 if joint in ARMS else 32.0 if joint in LEGS else 50.0 if joint != 15 else 26.0
            self.line(joints[parent], joints[joint], FLESH, width)
        self.axes.plot(*joints[15], "o", ms=66, color=FLESH)
        for factor, place in self.squares:
            for number in factor.sees:
                alpha = 0.7 if self.graph.variables[number].of_the_body else 0.38
                self.line(place, self.at[number], self.factor_colour[factor.kind], 1.2, alpha)
            self.factor(factor.kind, place, factor.count)
        for order, (kind, those) in enumerate(self.ringed.items()):
            for number in sorted({number for one in those for number in one.sees}):
                self.ring(kind, self.at[number], RADIUS + 3.5 + 3.5 * order)
        labels: dict[Point, list[str]] = {}
        for number, one in enumerate(self.graph.variables):
            x, y = self.at[number]
            self.variable(one.kind, (x, y))
            if one.joint is not None:
                self._joint_label(one.joint, one.label)
            elif one.shared and one.label:
                side = -1 if x < BODY[0] else 1
                labels[_at_side(side, NODE_X - 22), y] = [one.label]
            else:
                labels.setdefault((x, y + 32), []).append(one.kind)
        for (x, y), kinds in labels.items():
            beside = y + 4 if kinds[0] not in self.variable_colour else y
            anchor = "center" if beside == y else "right" if x < BODY[0] else "left"
            count = f" \N{MULTIPLICATION SIGN} {len(kinds)}" if len(kinds) > 1 else ""
            self.text((x, beside), kinds[0] + count, 11.5, ha=anchor)

    def _joint_label(self, joint: int, label: str) -> None:
        text, off = label.removeprefix("left ").removeprefix("right "), 13.0 + 4.0 * len(self.ringed)
        x, y = BODY[0] + JOINTS[joint][0], BODY[1] + JOINTS[joint][1]
        if joint in ARMS:
            self.text((x, y - off), text, 11, SOFT_INK, ha="center")
        elif joint in LEGS:
            inwards = -1 if x > BODY[0] else 1
            self.text((x + inwards * off, y + 4), text, 11, SOFT_INK, ha="right" if inwards < 0 else "left")
        else:
            self.text((x + off, y + 4), text, 11, SOFT_INK)

    def legend(self) -> None:
        """Kinds of variables with their numbers, and what rings stand for."""
        left, y = MARGIN + PANEL + 40, 112.0
        self.text((left, y), "Variables", 15, weight="bold")
        for one in self.graph.variable_kinds:
            y += ROW
            self.variable(one.kind, (left + 9, y - 4), 7)
            self.text((left + 26, y), one.kind, 12.5)
            self.text((left + 250, y), "all frames" if one.shared else "each frame", 11, SOFT_INK)
            self.text((WIDTH - MARGIN, y), _grouped(one.count), ha="right")
        y += 2 * ROW
        if self.ringed:
            self.text((left, y), "Rings", 15, weight="bold")
        for kind, those in self.ringed.items():
            y += 1.4 * ROW
            self.ring(kind, (left + 9, y - 4), RADIUS + 2)
            self.text((left + 26, y - 6), kind, 12.5)
            self.text((left + 26, y + 9), _ringed(those), 11, SOFT_INK)
        for number, note in enumerate(NOTES):
            self.text((left, y + 2 * ROW + 17 * number), note, 11.5, SOFT_INK)

    def table(self) -> None:
        """A row for each kind of factors: what it sees, how many frames, how many, when; and in a few frames, where."""
        graph, y = self.graph, TABLE_TOP
        first = max(0, min(graph.frame - 1, graph.frames - SHOWN))
        frames = range(first, min(first + SHOWN, graph.frames))
        columns = {frame: MARGIN + CHAIN_X + PITCH * (frame - first) for frame in frames}
        self.text((MARGIN, y), "Factors", 15, weight="bold")
        for x, name, anchor in (
            (SEES_X, "sees", "left"), (REACH_X, "frames", "center"), (COUNT_X, "number", "right"),
            (WHEN_X, "when", "left"),
        ):  # fmt: skip
            self.text((MARGIN + x, y), name, 11, FAINT, ha=anchor)
        bottom = y + 30 + ROW * len(graph.factor_kinds)
        for frame, x in columns.items():
            after = frame - graph.frame
            name = f"t {'+' if after > 0 else MINUS} {abs(after)}" if after else "t"
            self.text((x, y), f"frame {name}", 13, weight="bold", ha="center")
            self.line((x, y + 14), (x, bottom), GRID, 6.0)
        self.line((MARGIN, y + 9), (WIDTH - MARGIN, y + 9), GRID)
        for row, one in enumerate(graph.factor_kinds):
            self._row(one, y + 36 + ROW * row, columns)

    def _row(self, one: FactorKind, y: float, columns: Mapping[int, float]) -> None:
        graph, colour = self.graph, self.factor_colour[one.kind]
        self.factor(one.kind, (MARGIN + 9, y - 4))
        self.text((MARGIN + 26, y), one.kind, 12.5)
        step = min(20.0, (REACH_X - SEES_X - 50) / max(len(one.sees) - 1, 1))
        for place, kind in enumerate(one.sees):
            self.variable(kind, (MARGIN + SEES_X + 6 + step * place, y - 4), 5)
        self.text((MARGIN + REACH_X, y), str(one.reach or DASH), 11, SOFT_INK, ha="center")
        self.text((MARGIN + COUNT_X, y), _grouped(one.count), ha="right")
        width = CHAIN_X - WHEN_X - 100
        if one.runs:
            self.axes.barh(y - 4, width, 6, MARGIN + WHEN_X, color="#edf0f3")
        for a, b in one.runs:
            left = MARGIN + WHEN_X + width * a / graph.frames
            self.axes.barh(y - 4, width * (b - a + 1) / graph.frames, 6, left, color=colour)
        for frame in columns:
            last = frame + one.reach - 1
            if one.reach and last in columns and any(a <= frame <= b for a, b in one.runs):
                x, end = columns[frame], columns[last]
                self.line((x, y - 4), (end, y - 4), colour, 2.0)
                self.factor(one.kind, ((x + end) / 2, y - 4))


def _coloured(kinds: Sequence[str], palette: Sequence[str]) -> dict[str, str]:
    return {kind: palette[number % len(palette)] for number, kind in enumerate(kinds)}


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _ringed(those: Sequence[FrameFactors]) -> str:
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
