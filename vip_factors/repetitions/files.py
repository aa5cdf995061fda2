"""Repetitions as a table for people, as files (CSV, JSON), and as a picture of their signals (PNG)."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.mannequin import Side
from vip_factors.body.skeleton import SIDES
from vip_factors.display import table_cell
from vip_factors.errors import InputError
from vip_factors.repetitions.repetition import Measured, Repetition, WearerRepetitions
from vip_factors.tables import Quantity, Row, Table, json_text
from vip_factors.viz.charts import GRID, INK, SOFT_INK, Figure, page, panel, save, seconds_axis, write
from vip_factors.viz.colours import SIDE_COLOURS

NAMES = ("repetitions.csv", "repetitions.json", "repetitions.png")
KIND_COLOURS = {"squat": "#3e6ebe", "lunge": "#965abe", "jump": "#e27828", "curl": "#289650"}
WIDTH, ROW_HEIGHT, MARGIN = 1400.0, 210.0, 90.0


def repetition_table(wearer: WearerRepetitions) -> Table:
    """Table for people, a row each; every kind is numbered for itself."""
    head = (
        "",
        "kind",
        "side",
        "from s",
        "to s",
        "down / hold / up s",
        "depth cm",
        "flexed °",
        "left less right °",
        "flight s",
        "height cm by flight",
        "by rise",
    )
    rows: list[Row] = []
    for number, repetition in numbered(wearer.repetitions):
        tempo = (repetition.down_s, repetition.hold_s, repetition.up_s)
        rows.append(
            (
                str(number),
                repetition.kind,
                repetition.side,
                Quantity(repetition.start, decimals=1),
                Quantity(repetition.end, decimals=1),
                " / ".join(str(Quantity(seconds, decimals=1)) for seconds in tempo),
                _rounded(repetition.depth_m, 100),
                _rounded(repetition.depth_deg),
                _rounded(repetition.left_less_right_deg),
                Quantity(repetition.flight_s, decimals=2),
                _rounded(repetition.flight_height_m, 100),
                _rounded(repetition.rise_m, 100),
            )
        )
    return Table(head, rows, f"{wearer.name or 'wearer'}: {wearer.counts}", words=3)


def _rounded(measured: Measured, scale: int = 1) -> Quantity:
    return Quantity(scale * measured.value, scale * measured.sigma)


def numbered(repetitions: Sequence[Repetition]) -> Iterator[tuple[int, Repetition]]:
    """Each with its number among those of its kind, from 1."""
    for position, repetition in enumerate(repetitions):
        yield sum(previous.kind == repetition.kind for previous in repetitions[: position + 1]), repetition


def write_repetitions(wearers: Sequence[WearerRepetitions], folder: Path, overwrite: bool = False) -> list[Path]:
    """Write table, JSON and picture of all wearers into a folder, made if need be; each complete or not at all.

    Raises:
        InputError: if a file is there already and may not be replaced, the folder is a file, or two wearers have one
            name.
    """
    names = [wearer.name for wearer in wearers]
    if len(set(names)) < len(names):
        raise InputError(f"wearers {', '.join(names)}: expected different names, one for each wearer")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: expected a folder for the tables")
    folder.mkdir(parents=True, exist_ok=True)
    numbers, json_file, picture = paths = [folder / name for name in NAMES]
    for path in paths:
        check_target(path, overwrite)
    lines = [
        {"wearer": table_cell(wearer.name), **repetition.columns()}
        for wearer in wearers
        for repetition in wearer.repetitions
    ]
    with atomic_open(numbers, "w", overwrite) as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(["wearer", *(name for line in lines for name in line)])))
        writer.writeheader()
        writer.writerows(lines)
    with atomic_open(json_file, "w", overwrite) as file:
        repetitions = {wearer.name: [asdict(repetition) for repetition in wearer.repetitions] for wearer in wearers}
        file.write(json_text(repetitions, decimals=5))
    height = 60 + 3 * ROW_HEIGHT
    figure = page(WIDTH, height * len(wearers) + 30)
    for number, wearer in enumerate(wearers):
        _draw_wearer(figure, number * height, wearer)
    save(figure, picture, overwrite)
    return paths


def _draw_wearer(figure: Figure, top: float, wearer: WearerRepetitions) -> None:
    """How high hips and mass are and how far knees and elbows bend, repetitions shaded and numbered."""
    signals, time = wearer.signals, wearer.signals.time
    write(figure, (30, top + 36), wearer.summary()[0], 22, weight="bold")
    floor = float(np.median(signals.lower_foot))
    panels = (
        (
            "pelvis above the lower foot, and centre of mass above the floor (dark), m",
            [(signals.reach, SIDE_COLOURS[Side.LEFT]), (signals.mass_height - floor, INK)],
        ),
        ("knee flexion, °", [(signals.flexion(side, "knee"), SIDE_COLOURS[Side(side)]) for side in SIDES]),
        ("elbow flexion, °", [(signals.flexion(side, "elbow"), SIDE_COLOURS[Side(side)]) for side in SIDES]),
    )
    for row, (title, curves) in enumerate(panels):
        begin = top + 60 + row * ROW_HEIGHT
        axes = panel(figure, (MARGIN, begin + 30, WIDTH - 30, begin + ROW_HEIGHT - 32))
        axes.set_title(title, loc="left", size=14, color=SOFT_INK)
        axes.tick_params(labelsize=12)
        axes.grid(color=GRID)
        for values, colour in curves:
            axes.plot(time, values, color=colour, linewidth=1.6)
        seconds_axis(axes, float(time[0]), float(time[-1]))
        for number, repetition in numbered(wearer.repetitions):
            if (repetition.kind == "curl") != (row == 2):
                continue
            colour = KIND_COLOURS[repetition.kind]
            axes.axvspan(repetition.start, repetition.end, color=colour, alpha=0.18, linewidth=0)
            axes.axvline(repetition.turn, color=colour, linewidth=1)
            if row != 1:
                place, units = (repetition.turn, 0.98), ("data", "axes fraction")
                label = f" {repetition.kind} {number}"
                axes.annotate(label, place, xycoords=units, ha="left", va="top", size=12, color=colour)
