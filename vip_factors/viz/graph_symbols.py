"""Symbols of a factor graph (circles are variables, squares are factors), and the legend with counts of each."""

from vip_factors.viz.graph_description import FactorKind, GraphDescription
from vip_factors.viz.svg import FAINT, INK, MUTED, RULE, Point, Svg, tinted

RADIUS, SIDE = 8.0, 13.0  # of a variable's circle and a factor's square

# By the order of the kinds in a graph: a new kind takes the next one. Apart from each other on white.
_VARIABLES = (
    "#3f6fb5", "#12918c", "#d4821a", "#8a5fd0", "#c2527e", "#2f6f4f", "#b0642f", "#607089", "#7f9f3f", "#a3283c",
)  # fmt: skip
_FACTORS = (
    "#2f5fa8", "#e0474c", "#f28e2b", "#3f9b46", "#b07aa1", "#7b4fb5", "#17a2a2", "#d4a017", "#9c6b4f", "#d6568f",
    "#8c8c2b", "#5aa9d6", "#6b7684", "#a3283c", "#c44e1b", "#3b3f8f", "#40b890", "#7f9f3f", "#e08fb0", "#4a4a4a",
)  # fmt: skip


class Symbols:
    """Draws variables and factors of one graph, in the colours of their kinds."""

    def __init__(self, svg: Svg, graph: GraphDescription) -> None:
        self.svg = svg
        self._variables = _coloured([one.kind for one in graph.variable_kinds], _VARIABLES)
        self._factors = _coloured([one.kind for one in graph.factor_kinds], _FACTORS)

    def variable_colour(self, kind: str) -> str:
        """Of a kind of variable."""
        return self._variables[kind]

    def factor_colour(self, kind: str) -> str:
        """Of a kind of factor."""
        return self._factors[kind]

    def variable(self, kind: str, at: Point, radius: float = RADIUS) -> None:
        """A circle."""
        colour = self.variable_colour(kind)
        self.svg.circle(at, radius, tinted(colour, 0.68), colour, 1.8 if radius > 6 else 1.3)

    def factor(self, kind: str, at: Point, count: int = 1, side: float = SIDE) -> None:
        """A square, with the number of factors it stands for if they are several."""
        side = side if count < 10 else max(side, 18.0)
        self.svg.box((at[0] - side / 2, at[1] - side / 2), (side, side), self.factor_colour(kind), "#ffffff", 2.5)
        if count > 1:
            self.svg.text((at[0], at[1] + 3.6), str(count), 10, "#ffffff", "middle", bold=True)

    def ring(self, kind: str, at: Point, radius: float) -> None:
        """A ring around a variable: one of many that the factors of a kind see."""
        self.svg.circle(at, radius, "none", self.factor_colour(kind), 2.0)


def _coloured(kinds: list[str], palette: tuple[str, ...]) -> dict[str, str]:
    return {kind: palette[number % len(palette)] for number, kind in enumerate(kinds)}


LEGEND_WIDTH = 400.0
LEGEND_ROW = 26.0
SEES_X, REACH_X, COUNT_X, RUNS_X = 192.0, 262.0, 328.0, 342.0
SEES_WIDTH = 55.0  # from the first circle of what a factor sees to the last
NOTES = (
    "Circles are variables, squares are factors; a number in a",
    "square says how many factors of a kind it stands for.",
    "",
    "A factor on a bone sees every joint above it too, along",
    "the grey body to the pelvis, and the root if it asks where",
    "the bone is: only the last joint is joined to it.",
    "",
    "The strip beside a kind of factor says in which of the",
    "frames there are some.",
)


def draw_legend(svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> float:
    """Draw the legend, ``LEGEND_WIDTH`` wide, down from a corner; returns the y where it ends."""
    legend = _Legend(svg, symbols, graph, corner)
    legend.variables()
    legend.factors()
    legend.notes()
    return legend.y


class _Legend:
    """Written line by line: ``y`` is where the next one goes."""

    def __init__(self, svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> None:
        self.svg, self.symbols, self.graph = svg, symbols, graph
        self.left, self.y = corner

    def _title(self, title: str, columns: tuple[tuple[float, str, str], ...]) -> None:
        self.svg.text((self.left, self.y), title, 15, INK, bold=True)
        for x, name, anchor in columns:
            self.svg.text((self.left + x, self.y), name, 10.5, FAINT, anchor)
        self.svg.line((self.left, self.y + 8), (self.left + LEGEND_WIDTH, self.y + 8), RULE)
        self.y += 8 + LEGEND_ROW

    def variables(self) -> None:
        """One row for each kind."""
        self._title("Variables", ((COUNT_X, "number", "end"), (SEES_X - 6, "of", "start")))
        for one in self.graph.variable_kinds:
            self.symbols.variable(one.kind, (self.left + 9, self.y - 4), 7)
            self.svg.text((self.left + 26, self.y), one.kind, 12.5)
            self.svg.text((self.left + SEES_X - 6, self.y), "all frames" if one.shared else "each frame", 11, MUTED)
            self.svg.text((self.left + COUNT_X, self.y), _grouped(one.count), 12, INK, "end")
            self.y += LEGEND_ROW
        self.y += 18

    def factors(self) -> None:
        """One row for each kind: what it sees, how many frames, how many there are, and when."""
        columns = (
            (SEES_X - 6, "sees", "start"), (REACH_X, "frames", "middle"), (COUNT_X, "number", "end"),
            (LEGEND_WIDTH, "when", "end"),
        )  # fmt: skip
        self._title("Factors", columns)
        for one in self.graph.factor_kinds:
            self.symbols.factor(one.kind, (self.left + 9, self.y - 4))
            self.svg.text((self.left + 26, self.y), one.kind, 12.5)
            step = min(13.0, SEES_WIDTH / max(len(one.sees) - 1, 1))
            for place, kind in enumerate(one.sees):
                self.symbols.variable(kind, (self.left + SEES_X + step * place, self.y - 4), 4.5)
            self.svg.text((self.left + REACH_X, self.y), str(one.reach or "\N{EN DASH}"), 11, MUTED, "middle")
            self.svg.text((self.left + COUNT_X, self.y), _grouped(one.count), 12, INK, "end")
            self._runs(one)
            self.y += LEGEND_ROW
        self.y += 12

    def _runs(self, one: FactorKind) -> None:
        """A strip as long as the recording, coloured where factors of a kind are."""
        if not one.runs:
            return
        width, left = LEGEND_WIDTH - RUNS_X, self.left + RUNS_X
        self.svg.box((left, self.y - 7), (width, 6), "#edf0f3", radius=1)
        for first, last in one.runs:
            begin, end = first / self.graph.frames, min((last + max(one.reach, 1)) / self.graph.frames, 1.0)
            length = max((end - begin) * width, 1.5)
            x = min(left + begin * width, left + width - length)
            self.svg.box((x, self.y - 7), (length, 6), self.symbols.factor_colour(one.kind), radius=1)

    def notes(self) -> None:
        """How to read the drawing."""
        for line in NOTES:
            self.svg.text((self.left, self.y), line, 12.5, MUTED)
            self.y += 19 if line else 8


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", " ")
