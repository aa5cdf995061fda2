"""Recordings of half a second that are damaged and yet solved: smoothed, tracked, drawn as a graph, synchronised."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.studies.fuzz.case import Case, Files, Run, command_case, files_below
from tests.studies.fuzz.corpus_scenes import simulated_scene

SECONDS, FILMED_SECONDS = 0.5, 2.5


def solved_cases(run: Run) -> list[Case]:
    """By the commands that solve; seldom, as each takes a second or so."""
    case, files = partial(command_case, run=run), _recordings()
    plain, scene = ({f"{name}.mcap": files[f"{name}.mcap"]} for name in ("plain", "scene"))
    filmed = {"filmed.mcap": files["filmed.mcap"]}
    return [
        case("smooth-plain", plain, ["smooth {}/plain.mcap --out {}/out.mcap --overwrite"], seldom=400),
        case("smooth-scene", scene, ["smooth {}/scene.mcap --out {}/out.mcap --overwrite"], seldom=400),
        case("stream-plain", plain, ["stream {}/plain.mcap --start-s 0.2 --lag-s 0.2 --out {}/out.mcap --overwrite"],
             seldom=300),
        case("graph-scene", scene, ["graph {}/scene.mcap --picture {}/out.svg --overwrite"], seldom=250),
        case("sync-clocks", filmed, ["sync {}/filmed.mcap --dry-run"], seldom=40),
    ]  # fmt: skip


def _recordings() -> Files:
    from vip_factors.io.mcap_recording import write_recording
    from vip_factors.io.mcap_scene_recording import write_scene

    scene, filmed = simulated_scene(SECONDS), simulated_scene(FILMED_SECONDS)
    wearer = filmed.wearers[0]
    few = {name: wearer.imus[name] for name in list(wearer.imus)[:3]}
    with TemporaryDirectory() as name:
        write_scene(scene, Path(name, "scene.mcap"))
        write_recording(scene.wearers[0], Path(name, "plain.mcap"))
        write_scene(replace(filmed, wearers=(replace(wearer, imus=few),)), Path(name, "filmed.mcap"))
        return files_below(Path(name))
