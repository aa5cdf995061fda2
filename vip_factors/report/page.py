"""The page: all sections, the motion, the script and the style, in one file that asks nobody for anything."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup

from vip_factors import __version__
from vip_factors.atomic import atomic_open
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.io.video import with_video
from vip_factors.report.angles import angles_section
from vip_factors.report.blocks import Section
from vip_factors.report.fit import fit_section
from vip_factors.report.found import found_section
from vip_factors.report.gait import gait_section
from vip_factors.report.material import Material, material
from vip_factors.report.moments import moments_section, png, strip
from vip_factors.report.motion_data import motion_data
from vip_factors.report.recorded import made_section, recorded_section
from vip_factors.report.repetitions import repetitions_section
from vip_factors.report.settings import ReportSettings
from vip_factors.report.summary import summary_section
from vip_factors.report.words import listed
from vip_factors.sensors.scene import Scene

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""
ROOM = "vip_factors.report"


@dataclass(frozen=True)
class Page:
    """What the template fills in.

    Attributes:
        title, subtitle: of the page.
        before, after: sections before and after the motion.
        motion: JSON for the script.
        film: beside the page, if there is one.
        strip: the motion as a picture, for print and where the script cannot draw.
        shown_rate: Hz, of the motion.
        with_camera, with_truth: whether a camera and ghosts are to be seen.
    """

    title: str
    subtitle: str
    before: tuple[Section, ...]
    after: tuple[Section, ...]
    motion: Markup
    film: "ShownFilm | None"
    strip: str
    shown_rate: float
    with_camera: bool
    with_truth: bool


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
        video: a film is to be beside the page, of skeletons over the camera's pictures and of the room: of the
            recording's own video, or of that in a file.

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

    if given.drawn.path is None or given.drawn.detections is None:
        raise InputError(f"{path}: no camera is known that filmed: expected a filmed recording, and its estimate")
    times, rate = film(given.drawn, path, settings.film, overwrite=overwrite, on_progress=progress or no_progress)
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
    for number, make in enumerate(makers):
        report_progress("report", number / (len(makers) + 1))
        sections.append(make())
    summary, *rest = (one for one in sections if one is not None)
    data, names = motion_data(given, settings), listed([one.name for one in given.wearers])
    page = Page(
        title=given.estimate.name,
        subtitle="" if names == given.estimate.name else names,
        before=(summary,),
        after=tuple(rest),
        motion=as_json(data),
        film=film,
        strip=png(strip(given)),
        shown_rate=float(str(data["rate"])),
        with_camera=data["camera"] is not None,
        with_truth=given.has_truth,
    )
    return environment().get_template("report.html").render(
        page=page, version=__version__, style=packaged("templates/report.css"),
        script=packaged("viewer/viewer.min.js"),
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
