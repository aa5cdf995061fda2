"""A factor graph as an SVG picture: one frame in full, the chain of frames in outline, and a legend with counts."""

from vip_factors.viz import graph_chain, graph_legend, graph_places
from vip_factors.viz.graph_description import GraphDescription
from vip_factors.viz.graph_frame import draw_frame
from vip_factors.viz.graph_symbols import Symbols
from vip_factors.viz.svg import INK, MUTED, RULE, Svg

WIDTH, MARGIN = 1600.0, 40.0
TOP, GAP = 120.0, 54.0  # of the first panel; between panels, with room for a title


def graph_picture(graph: GraphDescription) -> str:
    """The picture as SVG text, 1600 pixels wide."""
    svg = Svg(WIDTH, 0)
    symbols = Symbols(svg, graph)
    _head(svg, graph)
    left = WIDTH - MARGIN - graph_legend.WIDTH
    end = graph_legend.draw_legend(svg, symbols, graph, (left, TOP))
    _title(svg, TOP, f"One frame in full: t = {graph.frame}", _which(graph))
    draw_frame(svg, symbols, graph, (MARGIN, TOP))
    top = max(end, TOP + graph_places.HEIGHT) + GAP
    svg.line((MARGIN, top - 34), (WIDTH - MARGIN, top - 34), RULE)
    _title(
        svg,
        top,
        "The chain in outline",
        "below a frame the factors that see it alone, between two those that see both, above those that see more",
    )
    graph_chain.draw_chain(svg, symbols, graph, (MARGIN, top + 20))
    svg.height = top + 20 + graph_chain.HEIGHT
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
    svg.line((MARGIN, 90), (WIDTH - MARGIN, 90), RULE)


def _which(graph: GraphDescription) -> str:
    more = len(graph.wearers) - 1
    told = f"at {graph.frame_seconds:.2f} s, {graph.wearers[0]}"
    return told if not more else f"{told}, and {more} more wearer{'s' if more > 1 else ''} alike"


def _title(svg: Svg, y: float, title: str, remark: str) -> None:
    svg.text((MARGIN, y), title, 15, INK, bold=True)
    svg.text((MARGIN + 9.0 * len(title), y), remark, 12, MUTED)
