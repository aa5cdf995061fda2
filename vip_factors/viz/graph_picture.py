"""A factor graph as an SVG picture: one frame in full, the chain of frames in outline, and a legend with counts."""

from collections.abc import Sequence

from vip_factors.viz.graph_description import FactorKind, GraphDescription, VariableKind
from vip_factors.viz.graph_frame import HEIGHT, draw_frame
from vip_factors.viz.graph_symbols import LEGEND_WIDTH, Symbols, draw_legend
from vip_factors.viz.svg import FAINT, INK, MUTED, RULE, Point, Svg, text_width

PAGE_WIDTH, MARGIN = 1600.0, 40.0
TOP, PANEL_GAP = 120.0, 54.0  # of the first panel; between panels, with room for a title


def graph_picture(graph: GraphDescription) -> str:
    """The picture as SVG text, 1600 pixels wide."""
    svg = Svg(PAGE_WIDTH, 0)
    symbols = Symbols(svg, graph)
    _head(svg, graph)
    left = PAGE_WIDTH - MARGIN - LEGEND_WIDTH
    end = draw_legend(svg, symbols, graph, (left, TOP))
    _title(svg, TOP, f"One frame in full: t = {graph.frame}", _which(graph))
    draw_frame(svg, symbols, graph, (MARGIN, TOP))
    top = max(end, TOP + HEIGHT) + PANEL_GAP
    svg.line((MARGIN, top - 34), (PAGE_WIDTH - MARGIN, top - 34), RULE)
    _title(
        svg,
        top,
        "The chain in outline",
        "below a frame the factors that see it alone, between two those that see both, above those that see more",
    )
    draw_chain(svg, symbols, graph, (MARGIN, top + 20))
    svg.height = top + 20 + CHAIN_HEIGHT
    return str(svg)


def _head(svg: Svg, graph: GraphDescription) -> None:
    variables = sum(one.count for one in graph.variable_kinds)
    factors = sum(one.count for one in graph.factor_kinds)
    wearers = graph.wearers[0] if len(graph.wearers) == 1 else f"{len(graph.wearers)} wearers"
    svg.text((MARGIN, 50), f"Factor graph of “{graph.name}”", 24, INK, bold=True)
    told = (
        f"{wearers}  ·  {graph.frames} frames in {graph.seconds:.2f} s  ·  {variables} variables  ·  {factors} factors"
    )
    svg.text((MARGIN, 74), told, 13, MUTED)
    svg.line((MARGIN, 90), (PAGE_WIDTH - MARGIN, 90), RULE)


def _which(graph: GraphDescription) -> str:
    more = len(graph.wearers) - 1
    told = f"at {graph.frame_seconds:.2f} s, {graph.wearers[0]}"
    return told if not more else f"{told}, and {more} more wearer{'s' if more > 1 else ''} alike"


def _title(svg: Svg, y: float, title: str, remark: str) -> None:
    svg.text((MARGIN, y), title, 15, INK, bold=True)
    svg.text((MARGIN + 9.0 * len(title), y), remark, 12, MUTED)


CHAIN_WIDTH, CHAIN_HEIGHT = 1520.0, 440.0
SHOWN = 4  # frames
MINUS = "\N{MINUS SIGN}"
BOX, BOX_TOP, PITCH = (200.0, 118.0), 86.0, 380.0
ALONE_Y, CHAIN_SHARED_TOP, CHAIN_SHARED_HEIGHT, PRIOR_Y = 262.0, 318.0, 50.0, 400.0
BOX_FILL, SHARED_FILL = "#fbfcfd", "#f6f8fa"


def draw_chain(svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> None:
    """Draw some frames from the one before that drawn in full, into a panel of ``CHAIN_WIDTH`` by ``CHAIN_HEIGHT``."""
    chain = _Chain(svg, symbols, graph, corner)
    chain.shared()
    chain.of_one_frame()
    chain.of_two_frames()
    chain.of_more_frames()
    chain.frame_boxes()


class _Chain:
    """Factors are drawn in those frames only in which the graph has some of their kind."""

    def __init__(self, svg: Svg, symbols: Symbols, graph: GraphDescription, corner: Point) -> None:
        self.svg, self.symbols, self.graph, self.corner = svg, symbols, graph, corner
        self.shared_kinds = [one for one in graph.variable_kinds if one.shared]
        self.own_kinds = [one for one in graph.variable_kinds if not one.shared]
        first = max(0, min(graph.frame - 1, graph.frames - SHOWN))
        self.frames = range(first, min(first + SHOWN, graph.frames))

    def _on(self, point: Point) -> Point:
        return self.corner[0] + point[0], self.corner[1] + point[1]

    def _x(self, frame: int) -> float:
        """Middle of a frame's box."""
        return CHAIN_WIDTH / 2 + PITCH * (frame - self.frames.start - (len(self.frames) - 1) / 2)

    def _reaching(self, least: int, most: int) -> list[FactorKind]:
        """Kinds that span so many frames, and of which some are drawn."""
        return [one for one in self.graph.factor_kinds if least <= one.reach <= most and self._begins(one)]

    def _begins(self, one: FactorKind) -> list[int]:
        """The frames in which factors of a kind begin that end within the drawing."""
        last = self.frames.stop - one.reach
        return [t for t in self.frames if t <= last and any(a <= t <= b for a, b in one.runs)]

    def frame_boxes(self) -> None:
        """What each frame has of its own."""
        for frame in self.frames:
            left, after = self._x(frame) - BOX[0] / 2, frame - self.graph.frame
            name = f"t {'+' if after > 0 else MINUS} {abs(after)}" if after else "t"
            self.svg.box(self._on((left, BOX_TOP)), BOX, BOX_FILL, FAINT)
            self.svg.text(self._on((self._x(frame), BOX_TOP + 25)), f"frame {name}", 13, INK, "middle", bold=True)
            for place, one in enumerate(self.own_kinds):
                y = BOX_TOP + 51 + min(23.0, 54 / max(len(self.own_kinds) - 1, 1)) * place
                self.symbols.variable(one.kind, self._on((left + 26, y)), 7)
                self.svg.text(self._on((left + 42, y + 4)), _several(one, self.graph.frames), 11.5)
        for frame, outwards in ((self.frames[0], -1), (self.frames[-1], 1)):
            if frame in (0, self.graph.frames - 1):
                continue
            x = self._x(frame) + outwards * (BOX[0] / 2 + 16)
            for dot in range(3):
                self.svg.circle(self._on((x + outwards * 9 * dot, BOX_TOP + BOX[1] / 2)), 1.6, FAINT, FAINT, 0)

    def shared(self) -> None:
        """The box of what all frames share, and below it the factors on that alone."""
        left, right = self._x(self.frames[0]) - BOX[0] / 2, self._x(self.frames[-1]) + BOX[0] / 2
        middle = CHAIN_SHARED_TOP + CHAIN_SHARED_HEIGHT / 2
        if not self.shared_kinds:
            return
        priors = [one for one in self.graph.factor_kinds if one.reach == 0]
        for prior, x in zip(priors, self._draw_beside(priors, 0.0, 11), strict=True):
            colour = self.symbols.factor_colour(prior.kind)
            self.svg.line(self._on((x, CHAIN_SHARED_TOP + CHAIN_SHARED_HEIGHT)), self._on((x, PRIOR_Y)), colour, 1.4)
            self.symbols.factor(prior.kind, self._on((x, PRIOR_Y)))
            self.svg.text(self._on((x + 12, PRIOR_Y + 4)), _several(prior), 11, MUTED)
        self.svg.box(self._on((left, CHAIN_SHARED_TOP)), (right - left, CHAIN_SHARED_HEIGHT), SHARED_FILL, FAINT)
        self.svg.text(self._on((left + 18, middle + 4.5)), "shared by all frames", 13, INK, bold=True)
        size = 12.0
        while size > 8 and sum(_width(one, size) for one in self.shared_kinds) > right - left - 200:
            size -= 0.5
        for variable, x in zip(self.shared_kinds, self._draw_beside(self.shared_kinds, left + 190, size), strict=True):
            self.symbols.variable(variable.kind, self._on((x, middle)), 7)
            self.svg.text(self._on((x + 12, middle + 4)), _several(variable), size)

    def _draw_beside(self, kinds: Sequence[VariableKind | FactorKind], least: float, size: float) -> list[float]:
        """Where the symbols of kinds go that are written in a row, around the middle or from ``least`` on."""
        widths = [_width(one, size) for one in kinds]
        start = max(least, (CHAIN_WIDTH - sum(widths)) / 2) + 10
        return [start + sum(widths[:place]) for place in range(len(widths))]

    def of_one_frame(self) -> None:
        """Squares below each frame; those that also see what all frames share are joined to that."""
        kinds, shared = self._reaching(1, 1), {one.kind for one in self.shared_kinds}
        pitch = min(26.0, BOX[0] / max(len(kinds), 1))
        for place, one in enumerate(kinds):
            for frame in self._begins(one):
                x = self._x(frame) + pitch * (place - (len(kinds) - 1) / 2)
                bottom = CHAIN_SHARED_TOP if shared & set(one.sees) else ALONE_Y
                colour = self.symbols.factor_colour(one.kind)
                self.svg.line(self._on((x, BOX_TOP + BOX[1])), self._on((x, bottom)), colour, 1.4)
                self.symbols.factor(one.kind, self._on((x, ALONE_Y)))

    def of_two_frames(self) -> None:
        """Squares in the gaps between frames."""
        kinds, half = self._reaching(2, 2), (PITCH - BOX[0]) / 2
        for place, one in enumerate(kinds):
            y = BOX_TOP + BOX[1] * (place + 0.7) / (len(kinds) + 0.2)
            colour = self.symbols.factor_colour(one.kind)
            for frame in self._begins(one):
                x = self._x(frame) + PITCH / 2
                self.svg.line(self._on((x - half, y)), self._on((x + half, y)), colour, 1.4)
                self.symbols.factor(one.kind, self._on((x, y)))
                self.svg.text(self._on((x, y - 11)), one.kind, 11, MUTED, "middle", halo=True)

    def of_more_frames(self) -> None:
        """Squares above the frames, each over the middle of those that it spans."""
        kinds = self._reaching(3, SHOWN)
        pitch = min(130.0, PITCH / max(len(kinds), 1))
        for place, one in enumerate(kinds):
            for first in self._begins(one):
                self._above(one, first, pitch * (place - (len(kinds) - 1) / 2))

    def _above(self, one: FactorKind, first: int, shift: float) -> None:
        colour, seen = self.symbols.factor_colour(one.kind), [self._x(first + ahead) for ahead in range(one.reach)]
        x, y = sum(seen) / len(seen) + shift, 34.0
        for end in seen:
            near = abs(end - x) < PITCH / 2
            port = end + (0 if near else 60 if end < x else -60) + shift / 3
            # Upright down to the frame below, level towards the others.
            pulls = ((x, BOX_TOP - 20), (port, BOX_TOP - 20)) if near else ((port, y), (port, BOX_TOP - 20))
            self.svg.curve([self._on(at) for at in ((x, y), *pulls, (port, BOX_TOP))], colour, 1.4, 0.85)
        self.symbols.factor(one.kind, self._on((x, y)))
        self.svg.text(self._on((x, y - 12)), one.kind, 11, MUTED, "middle", halo=True)


def _width(one: VariableKind | FactorKind, size: float) -> float:
    return 34 + text_width(_several(one), size)


def _several(one: VariableKind | FactorKind, among: int = 1) -> str:
    """A kind with how many there are, or how many to each of some frames."""
    count = round(one.count / among)
    what, of, rest = one.kind.partition(" of ")
    return f"{count} {what}{'s' if count > 1 and not what.endswith('s') else ''}{of}{rest}"
