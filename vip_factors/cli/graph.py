"""``vip-factors graph``: counts and a picture of the factor graph of a recording or scene."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import UNPREFIXED, Output, SettingsOptions, WritingOptions
from vip_factors.cli.terminal import note, print_tables, progress_bar, say
from vip_factors.ranges import Range
from vip_factors.settings import Settings


@dataclass(frozen=True)
class GraphOptions(SettingsOptions, WritingOptions):
    """Draw three frames of a recording's factor graph, and count its variables and factors.

    The graph is that of the calibration, at the calibration rate. Without Graphviz a .dot file is written.

    Every setting of the pipeline is an option; --settings reads them from a file, and options win over it.
    """

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files."""
    picture: Annotated[Path | None, Output(".svg")] = None
    """Picture (.svg) to write; default: RECORDING.graph.svg."""
    frame: Annotated[int | None, Range(least=0)] = None
    """First of the three frames, counted from 0; default: the middle of the recording."""
    settings: Annotated[Settings, UNPREFIXED] = field(default_factory=Settings)


def main(options: GraphOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.io.mcap_recording import read_scene

    picture = options.target(options.picture, options.recording, ".graph.svg")
    scene = read_scene(options.recording)
    from vip_factors.factor_graph.dot import dot, svg
    from vip_factors.pipeline import factor_graph
    from vip_factors.tables import Table

    with progress_bar() as progress:
        graph = factor_graph(scene, options.settings, progress)
    text = dot(graph, f"Factor graph of {scene.name}", options.frame)
    drawing = svg(text)
    if drawing is None:
        picture, drawing = picture.with_suffix(".dot"), text.encode()
    with atomic_open(picture, "wb", options.overwrite) as file:
        file.write(drawing)
    seconds = graph.time[-1] - graph.time[0]
    say(f"{len(graph.time)} frames in {seconds:.2f} s, of {', '.join(scene.names)}")
    kinds = (("variables", graph.variable_counts), ("factors", graph.factor_counts))
    print_tables(
        Table((name, str(sum(counts.values()))), [(kind, str(count)) for kind, count in counts.items()])
        for name, counts in kinds
    )
    say(picture)
    if picture.suffix == ".dot":
        note(f"Graphviz did not lay the picture out: install it, then dot -Tsvg -O {picture}")
