"""``vip-factors graph``: a recording or a scene in, a picture of its factor graph out."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import Output, WritingOptions, beside
from vip_factors.cli.terminal import progress_bar
from vip_factors.configurations import Configuration
from vip_factors.ranges import Range
from vip_factors.shown_settings import ShownSettings

if TYPE_CHECKING:
    from vip_factors.settings import Settings
    from vip_factors.viz.graph_picture import GraphDescription


@dataclass(frozen=True)
class GraphOptions(WritingOptions):
    """Draw the factor graph of a recording or scene: one frame in full, the chain of frames, and what there is.

    It is the graph in which headings, mountings and the camera are found, on every coarse-factor-th frame.

    Every setting of the pipeline is an option (--help-all tells them); --settings reads them from a file, and options
    win over it.
    """

    common: ClassVar = ("picture", "frame", "settings", "overwrite")
    settings_tree: ClassVar = (ShownSettings, "vip_factors.settings:Settings")
    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files."""
    picture: Annotated[Path | None, Output(".svg")] = None
    """Picture (.svg) to write; RECORDING.graph.svg if absent."""
    frame: Annotated[int | None, Range(least=0)] = None
    """Frame of the graph to draw in full, from 0; the middle one if absent."""
    configuration: Configuration = Configuration.OWN
    """Settings to start from: this package's own, or those that stand for the estimators of Kaichi et al. 2020."""
    settings: Path | None = None
    """TOML file with settings; a table for each group, such as [solve]."""


def main(options: GraphOptions, settings: "Settings") -> None:
    """Run the command."""
    from vip_factors.io.mcap_recording import read_scene

    picture = options.picture or beside(options.recording, ".graph.svg")
    check_target(picture, options.overwrite)
    scene = read_scene(options.recording)
    from vip_factors.factor_graph.outline import graph_description
    from vip_factors.pipeline import factor_graph
    from vip_factors.viz.graph_picture import graph_picture

    with progress_bar() as progress:
        graph = factor_graph(scene, settings, progress)
    names = scene.names
    description = graph_description(graph, scene.name, names, options.frame)
    with atomic_open(picture, overwrite=options.overwrite) as file:
        file.write(graph_picture(description))
    print(_table(description))
    print(picture)


def _table(graph: "GraphDescription") -> str:
    lines = [f"{graph.frames} frames in {graph.seconds:.2f} s, of {', '.join(graph.wearers)}"]
    variables = {one.kind: one.count for one in graph.variable_kinds}
    factors = {one.kind: one.count for one in graph.factor_kinds}
    width = max(map(len, (*variables, *factors)))
    for title, counts in (("variables", variables), ("factors", factors)):
        lines += ["", f"{title:<{width + 2}}  {sum(counts.values()):>8}"]
        lines += [f"  {kind:<{width}}  {count:>8}" for kind, count in counts.items()]
    return "\n".join([*lines, ""])
