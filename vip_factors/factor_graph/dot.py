"""Drawing of three frames of a factor graph with Graphviz: DOT text and SVG."""

import itertools
import re
import subprocess
from collections import Counter
from collections.abc import Iterable

import gtsam

from vip_factors.errors import InputError
from vip_factors.factor_graph.graph import FactorGraph
from vip_factors.factor_graph.variables import Variable
from vip_factors.problem.layout import Owner

FRAMES = 3  # spanned by an acceleration
LAYOUT_SECONDS = 60.0
GRAPH = """rankdir=LR; ranksep=1; nodesep=0.1; fontname="Helvetica,Arial,sans-serif";
  node[fontname="Helvetica,Arial,sans-serif", fontsize=13, style=filled, fillcolor="#dbe6f5", color="#3f6fb5"];"""
FRAME = 'style=rounded; color="#b9c2cc"; fontsize=13'
FACTOR = 'shape=box, color=white, fontcolor=white, margin="0.08,0.04", width=0, height=0'
_COLOURS = (
    "#2f5fa8 #c93238 #b85f0b #2f7f36 #8f4f86 #6a42a3 #0f7a7a #8f6b08 #85573a #b03d72 #6b6b1c #2f78a6 #5a6473 "
    "#8a1f31 #a33c10 #3b3f8f #1f7a58"
)
COLOURS = tuple(_COLOURS.split())
Node = tuple[str, int | None]
"""Kind of variables and their frame; None for static variables."""


def dot(graph: FactorGraph, title: str, first_frame: int | None = None) -> str:
    """Draw three frames of a graph as DOT text: ellipses are kinds of variables, boxes kinds of factors, with counts.

    GTSAM writes the graph; colours, frames and the order of columns are added. Variables of a kind share a node, also
    those of several wearers; each camera has its own. The frames begin with ``first_frame``, by default in the
    recording's middle.

    Raises:
        InputError: if the graph has no such frame.
    """
    count = len(graph.time)
    first_frame = max(count - FRAMES, 0) // 2 if first_frame is None else first_frame
    if not 0 <= first_frame < count:
        raise InputError(f"frame {first_frame}: the graph has frames 0 to {count - 1}; choose one of them")
    window = range(first_frame, min(first_frame + FRAMES, count))
    variables = Counter(_node(graph, variable) for variable in graph.variables)
    nodes = [node for node in variables if node[1] is None or node[1] in window]
    keys = {node: key for key, node in enumerate(nodes)}
    connections: dict[tuple[str, tuple[int, ...]], dict[Node, None]] = {}
    factors: Counter[tuple[str, tuple[int, ...]]] = Counter()
    for factor in graph.factors:
        sees = dict.fromkeys(_node(graph, variable) for variable in factor.variables)
        if all(node in keys for node in sees):
            box = (
                _title(graph, factor.kind, factor.variables),
                tuple(sorted({frame for _, frame in sees if frame is not None})),
            )
            connections.setdefault(box, {}).update(sees)
            factors[box] += 1
    symbolic = gtsam.SymbolicFactorGraph()
    for sees in connections.values():
        symbolic.push_back(gtsam.SymbolicFactor.FromKeys([keys[node] for node in sees]))
    labels = [_label(node[0], variables[node], "\\n") for node in nodes]
    text = symbolic.dot(lambda key: labels[int(key)])
    colours = dict(zip(dict.fromkeys(kind for kind, _ in connections), itertools.cycle(COLOURS), strict=False))
    boxes = list(connections)

    def edge(match: re.Match[str]) -> str:
        """Draw an edge in its factor's colour; columns are frames, factors, static variables and their priors."""
        key, (kind, frames) = int(match[1]), boxes[int(match[2])]
        ends = (f"var{key}", f"factor{match[2]}")
        ends = ends[::-1] if frames and nodes[key][1] is None else ends
        return f'{"--".join(ends)}[color="{colours[kind]}"];'

    title = title.replace("\\", "\\\\").replace('"', '\\"')
    lines = [f'graph {{\n  label="{title}"; labelloc=t; fontsize=18; {GRAPH}']
    for frame in window:
        members = [f"var{key};" for node, key in keys.items() if node[1] == frame]
        members += [f"factor{number};" for number, (_, frames) in enumerate(boxes) if frames == (frame,)]
        lines.append(f'  subgraph cluster{frame} {{label="frame {frame}"; {FRAME}; {" ".join(members)}}}')
    shared = [f"var{key};" for node, key in keys.items() if node[1] is None]
    lines += [f"  {{rank=same; {' '.join(shared)}}}", re.sub(r"var(\d+)--factor(\d+);", edge, _body(text))]
    lines += [f'  {name[:-1]}[fillcolor="#eceff3"];' for name in shared]
    for number, (kind, frames) in enumerate(boxes):
        label = _label(kind, factors[kind, frames])
        lines.append(f'  factor{number}[{FACTOR}, fillcolor="{colours[kind]}", label="{label}"];')
    return "\n".join([*lines, "}\n"])


def _body(text: str) -> str:
    """Statements of GTSAM's DOT text, without the size of the drawing."""
    return text[text.index(";") + 1 : text.rindex("}")].strip("\n")


def _node(graph: FactorGraph, variable: Variable) -> Node:
    path = variable.is_of_the_camera_path and graph.problem.cameras[variable.wearer].moving
    return _title(graph, variable.kind, [variable]), variable.frame if variable.is_of_a_frame or path else None


def _title(graph: FactorGraph, kind: str, variables: Iterable[Variable]) -> str:
    """A kind of variables or factors, with the camera's number, from 1, if there are several."""
    numbers = [variable.wearer for variable in variables if variable.owner.kind is Owner.CAMERA]
    return f"{kind}, camera {numbers[0] + 1}" if numbers and len(graph.problem.cameras) > 1 else kind


def _label(kind: str, count: int, between: str = " ") -> str:
    return f"{kind}{between}\N{MULTIPLICATION SIGN} {count}" if count > 1 else kind


def svg(text: str) -> bytes | None:
    """Lay out DOT text with Graphviz; None without Graphviz, or if it fails or takes longer than a minute."""
    try:
        program = subprocess.run(
            ["dot", "-Tsvg"], input=text.encode(), capture_output=True, timeout=LAYOUT_SECONDS, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return program.stdout
