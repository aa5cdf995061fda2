"""The legend of a factor graph: variables and factors by kind, with their counts, and how to read the drawing."""

from vip_factors.viz.graph_description import FactorKind, GraphDescription
from vip_factors.viz.graph_symbols import Symbols
from vip_factors.viz.svg import FAINT, INK, MUTED, RULE, Point, Svg

WIDTH = 400.0
ROW = 26.0
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
    """Draw the legend, ``WIDTH`` wide, down from a corner; returns the y where it ends."""
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
        self.svg.line((self.left, self.y + 8), (self.left + WIDTH, self.y + 8), RULE)
        self.y += 8 + ROW

    def variables(self) -> None:
        """One row for each kind."""
        self._title("Variables", ((COUNT_X, "number", "end"), (SEES_X - 6, "of", "start")))
        for one in self.graph.variable_kinds:
            self.symbols.variable(one.kind, (self.left + 9, self.y - 4), 7)
            self.svg.text((self.left + 26, self.y), one.kind, 12.5)
            self.svg.text((self.left + SEES_X - 6, self.y), "all frames" if one.shared else "each frame", 11, MUTED)
            self.svg.text((self.left + COUNT_X, self.y), _grouped(one.count), 12, INK, "end")
            self.y += ROW
        self.y += 18

    def factors(self) -> None:
        """One row for each kind: what it sees, how many frames, how many there are, and when."""
        columns = (
            (SEES_X - 6, "sees", "start"), (REACH_X, "frames", "middle"), (COUNT_X, "number", "end"),
            (WIDTH, "when", "end"),
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
            self.y += ROW
        self.y += 12

    def _runs(self, one: FactorKind) -> None:
        """A strip as long as the recording, coloured where factors of a kind are."""
        if not one.runs:
            return
        width, left = WIDTH - RUNS_X, self.left + RUNS_X
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
