"""The symbols of a factor graph: circles are variables, squares are factors, each kind has its colour."""

from vip_factors.viz.graph_description import GraphDescription
from vip_factors.viz.svg import Point, Svg, tinted

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
