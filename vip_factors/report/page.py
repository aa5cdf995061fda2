"""The page: all sections, the motion, the script and the style, in one file that asks nobody for anything.

Here too are the sections on how somebody walked and on squats, lunges, jumps and curls.

The page of a stream has the body as it moves, joint angles and findings; ``io/live_server.py`` serves it.
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
import numpy as np
from markupsafe import Markup

from vip_factors import __version__
from vip_factors.atomic import atomic_open
from vip_factors.body.joint_angles import is_measured
from vip_factors.body.skeleton import calibration_pose
from vip_factors.estimate import Estimate
from vip_factors.gait.analysis import Gait, gait_of
from vip_factors.gait.files import curves_figure
from vip_factors.gait.strides import QUANTITIES, Quantity
from vip_factors.io.live_json import VERSION
from vip_factors.io.video import with_video
from vip_factors.repetitions.files import HEAD, rows
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.repetitions.settings import RepetitionSettings
from vip_factors.report.angles import PAIRED, TRUNK, angles_section
from vip_factors.report.blocks import (
    UNKNOWN,
    Block,
    Heading,
    Image,
    Paragraph,
    Picture,
    Pictures,
    Section,
    Table,
    Tile,
    Tiles,
    capital,
    count,
    joint_words,
    listed,
    number,
    plus_minus,
)
from vip_factors.report.calibration import found_section, made_section, recorded_section
from vip_factors.report.fit import fit_section, moments_section, png, strip
from vip_factors.report.material import Material, material
from vip_factors.report.motion_data import body_data, corners, mesh_data, motion_data, poses_data
from vip_factors.report.settings import ReportSettings
from vip_factors.report.summary import summary_section
from vip_factors.sensors.scene import Scene
from vip_factors.viz.charts import pixels

EXTENT_M = 8.0  # of the ground that is drawn around who walks on it
CAPTION = (
    "Down, hold, up: the ways and the stay within a tenth of the lowest. Depth: how far the pelvis sinks. "
    "Flexed: knees, or elbows, at the turn. Height by flight: that free fall takes the centre of mass beyond take-off; "
    "by rise: above standing, which the heels add to. A left less right smaller than twice its ± says nothing."
)
FEWEST = 4  # strides: fewer are no walk
SIDES = ("left", "right", "both")
Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""
ROOM = "vip_factors.report"


@dataclass(frozen=True)
class ShownFilm:
    """A film beside a page: its file's name, the recording's second at which it begins, and seconds of the recording in
    one of the film.
    """

    name: str
    start: float
    pace: float


def write_report(
    estimate: Estimate,
    path: str | os.PathLike[str],
    scene: Scene | None = None,
    truth: Scene | None = None,
    settings: ReportSettings | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    video: bool | str | os.PathLike[str] = False,
) -> None:
    """Write an estimate as one HTML page, with a film beside it if one is wanted.

    Args:
        estimate: of one wearer or several.
        path: of the page.
        scene: what it was made from: then the page tells of sensors and video, and shows frames of it.
        truth: a scene whose truth counts, if it is not ``scene``'s own.
        settings: how much goes into the page.
        overwrite: whether an existing file may be replaced.
        progress: called with the name of the stage and the fraction of it done.
        video: a film of skeletons over the camera's pictures is to be beside the page: of the recording's own video,
            or of that in a file.

    Raises:
        InputError: if they do not belong together, a file may not be written, or a film cannot be made.
        FileFormatError: if the video is none.
    """
    if not isinstance(video, bool):
        scene = with_video(scene, Path(video))
    given, settings = material(estimate, scene, truth), settings or ReportSettings()
    film = write_film(given, Path(path).with_suffix(".mp4"), settings, overwrite, progress) if video else None
    text = report_page(given, settings, progress, film)
    with atomic_open(path, "w", overwrite) as file:
        file.write(text)


def write_film(
    given: Material, path: Path, settings: ReportSettings, overwrite: bool, progress: Progress | None
) -> ShownFilm:
    """Write the film of a page; see :func:`write_report`."""
    from vip_factors.viz.film import film

    times, rate = film(
        given.drawn, path, settings.video_height, settings.video_seconds, overwrite=overwrite,
        on_progress=progress or no_progress,
    )  # fmt: skip
    pace = float(times[-1] - times[0]) * rate / (len(times) - 1) if len(times) > 1 else 1.0
    return ShownFilm(path.name, float(times[0]), pace)


def no_progress(stage: str, fraction: float) -> None:
    """Tell nobody."""


def report_page(
    given: Material, settings: ReportSettings, progress: Progress | None = None, film: ShownFilm | None = None
) -> str:
    """The page as HTML, which links to the film beside it; see :func:`write_report`."""
    report_progress = progress or no_progress
    makers: tuple[Callable[[], Section | None], ...] = (
        lambda: summary_section(given), lambda: angles_section(given), lambda: gait_section(given),
        lambda: repetitions_section(given),
        lambda: moments_section(given, settings.moments), lambda: fit_section(given), lambda: found_section(given),
        lambda: recorded_section(given), lambda: made_section(given),
    )  # fmt: skip
    sections = []
    for done, make in enumerate(makers):
        report_progress("report", done / (len(makers) + 1))
        sections.append(make())
    summary, *rest = (one for one in sections if one is not None)
    data, names = motion_data(given, settings), listed([one.name for one in given.wearers])
    return environment().get_template("report.html").render(
        title=given.estimate.name, subtitle="" if names == given.estimate.name else names, before=(summary,),
        after=tuple(rest), motion=as_json(data), film=film, strip=png(strip(given)),
        shown_rate=float(str(data["rate"])), with_camera=data["camera"] is not None, with_truth=given.has_truth,
        version=__version__, style=packaged("templates/report.css"), script=packaged("viewer/viewer.min.js"),
    )  # fmt: skip


@cache  # templates are compiled once
def environment() -> jinja2.Environment:
    """What makes pages of the templates."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader(ROOM), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip


def packaged(name: str) -> Markup:
    """A file of ours that goes into the page as it is."""
    return Markup((files(ROOM) / name).read_text(encoding="utf-8"))


def as_json(data: object) -> Markup:
    """JSON that may stand in a page: nothing in it can end the element that holds it."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def gait_section(material: Material) -> Section | None:
    """Of the wearers who walk; None if nobody does."""
    blocks: list[Block] = []
    for wearer in material.wearers:
        gait = gait_of(wearer.estimate, wearer.recording, wearer.name, material.estimate.camera is not None)
        if len(gait.counted) < FEWEST:
            continue
        blocks += [Heading(wearer.name)] if len(material.wearers) > 1 else []
        blocks += _wearer(gait)
    return Section("gait", "Gait", tuple(blocks)) if blocks else None


def _wearer(gait: Gait) -> list[Block]:
    left_out = len(gait.strides) - len(gait.counted)
    tiles = [
        Tile(
            "Strides",
            str(len(gait.counted)),
            "all of them" if not left_out else f"{left_out} more are turns, pauses or no steps",
        )
    ]
    for name in ("speed", "cadence", "length", "time"):
        one = gait.figure(name)
        if one is not None:
            value = plus_minus(one.mean, one.sigma, _unit(one.quantity), 2 * (one.mean < 10), 2 * (one.mean < 10))
            tiles.append(Tile(capital(one.quantity.words), value, f"mean of {count(one.count, 'stride')}"))
    rows = [row for one in QUANTITIES if (row := _row(gait, one)) is not None]
    head = ("Quantity", "Left", "Right", "Left less right", "Both", "From stride to stride")
    caption = (
        "Means with one standard deviation: of the strides, and of what all of them share, such as how exactly strikes "
        "and toe-offs are timed and lengths are told. A difference smaller than twice its ± says nothing."
    )
    blocks: list[Block] = [Tiles(tuple(tiles)), Table(head, rows, caption)]
    figure = curves_figure(gait)
    if figure is not None:
        text = (
            "each side from its own foot strike (0 %) to its next (100 %). Dark bands are the mean's ±, pale ones how "
            "strides differ, grey ones healthy adults at a similar speed, where known."
        )
        picture = Image(png(pixels(figure)[..., ::-1]), "joint angles over the gait cycle", wide=True)
        blocks.append(Pictures((Picture((picture,), "Joint angles over the cycle", text, None),)))
    by = {one.by_sensor for one in gait.feet.values()}
    told = "the feet's own sensors" if by == {True} else "the motion of the legs" if by == {False} else "both"
    blocks += [Paragraph(f"{capital(str(one))}.") for one in gait.findings]
    return [*blocks, Paragraph(f"Foot strikes and toe-offs are told by {told}.", small=True)]


def _unit(quantity: Quantity) -> str:
    return {"deg": "°"}.get(quantity.unit, quantity.unit)


def _row(gait: Gait, quantity: Quantity) -> tuple[str, ...] | None:
    found = {side: gait.figure(quantity.name, side) for side in (*SIDES, "difference")}
    both = found["both"]
    if both is None:
        return None
    decimals = min(quantity.decimals, 2) if quantity.unit in ("s", "m", "m/s") else quantity.decimals
    told = {
        side: UNKNOWN if one is None else plus_minus(one.mean, one.sigma, "", decimals, decimals)
        for side, one in found.items()
    }
    name = f"{capital(quantity.words)}, {_unit(quantity)}"
    return name, told["left"], told["right"], told["difference"], told["both"], number(both.variability, decimals)


def repetitions_section(material: Material) -> Section | None:
    """Of the wearers who exercise; None if nobody does."""
    blocks: list[Block] = []
    for wearer in material.wearers:
        found = repetitions_of(wearer.estimate, RepetitionSettings())
        if not found.repetitions:
            continue
        blocks += [Heading(wearer.name)] if len(material.wearers) > 1 else []
        blocks += [Paragraph(f"{capital(found.counts)}."), Table(HEAD, rows(found.repetitions), CAPTION, words=3)]
    return Section("repetitions", "Repetitions", tuple(blocks)) if blocks else None


def live_page(setup: Scene) -> str:
    """The page as HTML; it asks nobody but its server for anything.

    Args:
        setup: of the stream.
    """
    camera, of = setup.camera, len(setup.wearers)
    bodies = [one.subject.body() for one in setup.wearers]
    waiting = poses_data(calibration_pose("n-pose")[None], np.zeros((1, 3)))
    data = {
        "version": VERSION,
        "frames": 1,  # the one that is shown, which the script overwrites
        "floor": 0.0,
        "centre": [0.0, 0.0],
        "extent": EXTENT_M,
        "apart": of > 1 and camera is None,  # where they stand beside each other is not known
        "bodies": [
            body_data(one.subject.name, body, (number, of)) | waiting | {"mesh": number}
            for number, (one, body) in enumerate(zip(setup.wearers, bodies, strict=True))
        ],
        "meshes": [mesh_data(one) for one in bodies],
        "camera": None
        if camera is None
        else {"corners": corners(camera.model)} | poses_data(np.eye(3)[None], np.zeros((1, 3))),
    }
    angles = []
    for one in setup.wearers:
        bones = {site.bone for site in one.placement.sites}
        measured = [name for name in (*TRUNK, *PAIRED) if is_measured(bones, name)]
        angles.append((one.subject.name, [(capital(joint_words(name)), name, name in PAIRED) for name in measured]))
    return environment().get_template("live.html").render(
        data=as_json(data), name=setup.name, angles=angles, version=__version__, style=packaged("templates/live.css"),
        script=packaged("viewer/viewer.min.js"), with_camera=camera is not None, apart=data["apart"],
    )  # fmt: skip
