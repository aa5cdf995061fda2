"""The page: all sections, the motion, the script and the style, in one file that asks nobody for anything.

The page of a stream has the body as it moves, joint angles and findings; ``io/live_server.py`` serves it.
"""

import base64
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
import numpy as np
from markupsafe import Markup

from vip_factors import __version__
from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.joint_angles import is_measured
from vip_factors.body.skeleton import JOINT_NAMES, calibration_pose
from vip_factors.describe import estimates, recordings
from vip_factors.describe.estimates import limb_sigma, measured_limb_joints, mountings_are_held
from vip_factors.display import ProgressCallback, distinct_file_names, silent
from vip_factors.estimate import Estimate
from vip_factors.findings import KINDS, TEXT, VERDICTS, Finding, Severity, sentences
from vip_factors.gait import files as gait_files
from vip_factors.io.live_json import VERSION, guessed_angles
from vip_factors.io.video import with_videos
from vip_factors.repetitions.files import repetition_table
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.report import sections
from vip_factors.report.report_data import (
    ReportData,
    ReportWearer,
    body_data,
    corners,
    mesh_data,
    motion_data,
    poses_data,
    report_data,
)
from vip_factors.report.sections import PAIRED, TRUNK
from vip_factors.sensors.live import sensor_columns
from vip_factors.sensors.scene import Scene
from vip_factors.tables import degrees, joint_words
from vip_factors.viz import charts
from vip_factors.viz.film import png_bytes
from vip_factors.viz.picture import pose_picture


@dataclass(frozen=True)
class Remark:
    """A headline with its weight, what it means, what to do, and the method's own sentences."""

    weight: Severity
    headline: str
    meaning: str = ""
    advice: str = ""
    detail: str = ""


def finding_remarks(findings: Sequence[Finding]) -> list[Remark]:
    """A remark for every kind of finding there is, with the findings themselves as its detail."""
    kinds: dict[str, list[Finding]] = {}  # bare sentences each by itself
    for finding in findings:
        kinds.setdefault(finding.text if finding.kind == TEXT else finding.kind, []).append(finding)
    remarks = []
    for alike in kinds.values():
        kind = KINDS[alike[0].kind]
        remarks.append(Remark(kind.severity, kind.headline, kind.affects, kind.advice, "; ".join(sentences(alike))))
    return remarks


def remarks(data: ReportData) -> list[Remark]:
    """The verdict, then all remarks, the weightiest first."""
    severity, order = data.estimate.verdict.severity, list(Severity)
    other_remarks = [*finding_remarks(data.estimate.all_findings), *_sureness_remarks(data)]
    other_remarks.sort(key=lambda remark: order.index(remark.weight), reverse=True)
    return [Remark(severity, f"{VERDICTS[severity]}."), *other_remarks]


def _sureness_remarks(data: ReportData) -> list[Remark]:
    """Remarks on uncertainties, beside the findings."""
    sigma = limb_sigma(data.estimate.wearers)
    if not math.isfinite(sigma):
        return [
            Remark(
                Severity.NOTE,
                "How sure the angles are was not computed",
                "The file holds no uncertainties, so this report cannot say how far the angles may be off.",
                "Reconstruct without --no-covariance to know.",
            )
        ]
    meaning = (
        "One standard deviation, by the computation's own reckoning: about two of three values lie within. Differences "
        "smaller than twice that are within its uncertainty."
    )
    if mountings_are_held(data.estimate.wearers):
        meaning += (
            " How the sensors sit on the body is taken for known in this figure: a constant offset of some degrees, "
            "the same throughout, may come on top. Ranges and changes within the recording suffer little from it."
        )
    joints = [joint for wearer in data.wearers for joint in _least_certain_joint(wearer, len(data.wearers) > 1)]
    return [
        Remark(Severity.NOTE, f"Joint angles are known to about ± {degrees(sigma)}", meaning),
        *([Remark(Severity.NOTE, f"Least certain joint: {', '.join(joints)}")] if joints else []),
    ]


def _least_certain_joint(wearer: ReportWearer, with_name: bool) -> list[str]:
    covariance = wearer.estimate.covariance
    if covariance is None:
        return []
    limbs = measured_limb_joints(wearer.estimate)
    sigma = np.rad2deg(np.nanmedian(covariance.joint_sigma[:, limbs], axis=0))
    least_certain = int(np.nanargmax(sigma))
    joint = f"{joint_words(JOINT_NAMES[limbs[least_certain]])} (± {sigma[least_certain]:.0f}°)"
    return [f"{wearer.name}: {joint}" if with_name else joint] if np.isfinite(sigma[least_certain]) else []


ROOM = "vip_factors.report"


def write_report(
    estimate: Estimate,
    path: str | os.PathLike[str],
    scene: Scene | None = None,
    truth: Scene | None = None,
    overwrite: bool = False,
    progress: ProgressCallback | None = None,
    video: bool | str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = False,
    *,
    video_height: int = 480,
    video_seconds: tuple[float, float] | None = None,
) -> list[Path]:
    """Write an estimate as one HTML page, with a film of each camera beside it on request.

    Args:
        estimate: of one wearer or several.
        path: of the page.
        scene: what it was made from: then the page tells of sensors and video.
        truth: a scene whose truth counts, if it is not ``scene``'s own.
        overwrite: whether an existing file may be replaced.
        progress: called with the name of the stage and the fraction of it done.
        video: whether to write films of skeletons over the videos of the recording, or files of these videos, one for
            each camera in the recording's order. Films of several cameras have the camera's name in theirs.
        video_height: of the film, pixels; 480 fill the page's width, 720 take twice as long.
        video_seconds: first and last second of the recording that the film shows; all of it if None.

    Returns:
        Files of the films.

    Raises:
        InputError: if they do not belong together, a file may not be written, or a film cannot be made.
        FileFormatError: if the video is none.
    """
    if not isinstance(video, bool):
        scene = with_videos(scene, [video] if isinstance(video, str | os.PathLike) else video)
    data, films, paths = report_data(estimate, scene, truth), list[dict[str, object]](), list[Path]()
    if video:
        from vip_factors.viz.film import film

        cameras = [camera for camera, _, _ in data.drawn.films()]
        names = [f".{name}" for name in distinct_file_names(camera.name for camera in cameras)]
        paths = [Path(path).with_suffix(f"{name if len(cameras) > 1 else ''}.mp4") for name in names]
        for file_path in paths:
            check_target(file_path, overwrite)
        for number, (camera, file_path) in enumerate(zip(cameras, paths, strict=True)):
            times, rate = film(
                data.drawn,
                file_path,
                video_height,
                video_seconds,
                camera=number,
                overwrite=overwrite,
                on_progress=progress or silent,
            )
            pace = float(times[-1] - times[0]) * rate / (len(times) - 1) if len(times) > 1 else 1.0
            films.append({"name": file_path.name, "camera": camera.name, "start": float(times[0]), "pace": pace})
    text = report_page(data, progress, films)
    with atomic_open(path, "w", overwrite) as file:
        file.write(text)
    return paths


def report_page(
    data: ReportData, progress: ProgressCallback | None = None, films: Sequence[Mapping[str, object]] = ()
) -> str:
    """The page as HTML, which links to the films beside it; see :func:`write_report`.

    Args:
        data: what the page shows.
        progress: called with the name of the stage and the fraction of it done.
        films: file ``name``, ``camera``, second of the recording at which it has its ``start``, and ``pace``: seconds
            of the recording in one of the film.
    """
    report_progress, wearers, contents = progress or silent, data.wearers, dict[str, object]()
    with_camera = bool(data.estimate.cameras)
    makers: dict[str, Callable[[], object]] = {
        "angles": lambda: [sections.angle_section(wearer, with_camera) for wearer in wearers],
        "gait": lambda: [sections.gait_section(wearer, with_camera, str(data.estimate.verdict)) for wearer in wearers],
        "repetitions": lambda: [
            replace(repetition_table(exercises), title=exercises.counts)
            for exercises in map(repetitions_of, data.estimate.wearers)
        ],
        "fit_charts": lambda: sections.fit_charts(data),
        "truth": lambda: sections.truth_table(data),
        "truth_charts": lambda: sections.truth_charts(data),
        "drifts": lambda: [sections.drift_charts(wearer) for wearer in wearers],
        "strip": lambda: _strip(data),
        "motion": lambda: motion_data(data),
    }
    for number, (name, make) in enumerate(makers.items()):
        report_progress("report", number / len(makers))
        contents[name] = make()
    script = packaged("viewer/viewer.min.js")
    return _rendered("report", "report", data=data, **contents, remarks=remarks(data), films=films, script=script)


def _strip(data: ReportData) -> bytes:
    """PNG of a row of poses for each wearer, evenly over the time."""
    poses, size = 6, (180, 260)  # pixels of a pose
    rows = []
    for wearer in data.wearers:
        motion = wearer.estimate.motion
        frames = np.round(np.linspace(0.04, 0.96, poses) * (len(motion) - 1)).astype(int)
        rows.append(np.concatenate([pose_picture(motion, int(frame), size) for frame in frames], axis=1))
    return png_bytes(np.concatenate(rows, axis=0))


@cache  # templates are compiled once
def environment() -> jinja2.Environment:
    """The Jinja environment of the templates; they lay out the tables of ``describe/``."""
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader(ROOM),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.globals |= {"estimates": estimates, "recordings": recordings, "gait_files": gait_files}
    templates.filters |= {
        # Nothing in it can end the element that holds it.
        "as_json": lambda data: Markup(
            json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        ),
        "capital": lambda text: text[:1].upper() + text[1:],
        "listed": lambda words: " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))),
        "png": lambda content: f"data:image/png;base64,{base64.b64encode(content).decode()}",
        "drawn": charts.png,
    }
    return templates


def _rendered(template: str, style: str, **content: object) -> str:
    """A template with the style of a name."""
    css = packaged(f"templates/{style}.css")
    return environment().get_template(f"{template}.html").render(version=__version__, style=css, **content)


def packaged(name: str) -> Markup:
    """A file of the package that goes into the page as it is."""
    return Markup((files(ROOM) / name).read_text(encoding="utf-8"))


def waiting_page(awaits: str) -> str:
    """The page until a stream begins, which makes way for :func:`live_page` then.

    Args:
        awaits: the first thing that has to come, in words.
    """
    return _rendered("waiting", "live", awaits=awaits)


def live_page(setup: Scene) -> str:
    """The page as HTML; it asks nobody but its server for anything.

    Args:
        setup: of the stream.
    """
    extent = 8.0  # m of the ground that is drawn around who walks on it
    bodies = [wearer.subject.body() for wearer in setup.wearers]
    waiting = poses_data(calibration_pose("n-pose")[None], np.zeros((1, 3)))
    data = {
        "version": VERSION,
        "frames": 1,  # the one that is shown, which the script overwrites
        "floor": 0.0,
        "centre": [0.0, 0.0],
        "extent": extent,
        "apart": len(bodies) > 1 and not setup.cameras,  # where they stand beside each other is not known
        "bodies": [
            body_data(wearer.subject.name, body, (number, len(bodies))) | waiting | {"mesh": number}
            for number, (wearer, body) in enumerate(zip(setup.wearers, bodies, strict=True))
        ],
        "meshes": [mesh_data(body) for body in bodies],
        "cameras": [
            {"name": camera.name, "corners": corners(camera.model)} | poses_data(np.eye(3)[None], np.zeros((1, 3)))
            for camera in setup.cameras
        ],
    }
    angles = []
    for wearer in setup.wearers:
        bones = {site.bone for site in wearer.placement.sites}
        measured = [name for name in (*TRUNK, *PAIRED) if is_measured(bones, name)]
        rows = [(joint_words(name), name, name in PAIRED) for name in measured]
        why = {joint_words(joint): reason for joint, reason in guessed_angles(bones).items()}
        angles.append((wearer.subject.name, rows, why))
    return _rendered(
        "live",
        "live",
        data=data,
        name=setup.name,
        angles=angles,
        script=packaged("viewer/viewer.min.js"),
        with_camera=bool(setup.cameras),
        apart=data["apart"],
        sensors=[sensor for _, sensor in sensor_columns(setup)],
    )
