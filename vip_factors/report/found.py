"""What was found beside the motion: body, headings, mountings, the camera's path, the clock; and how sure each is."""

import numpy as np

from vip_factors.body.mannequin import Side
from vip_factors.estimate import CameraEstimate, StartChoice
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.report.blocks import Block, Charts, Heading, Paragraph, Section, Table
from vip_factors.report.charts import SIDE_COLOURS, Line, time_chart
from vip_factors.report.material import Material, Wearer
from vip_factors.report.words import UNKNOWN, bone_words, joint_words, number, plus_minus, with_unit
from vip_factors.terms.heading_prior import HeadingPriorSettings

HELD = 1.5 * HeadingPriorSettings().gauge_sigma  # a heading as sure as this is the one that defines the world's
MM = 1e3


def found_section(material: Material) -> Section:
    """Per wearer, then the camera."""
    blocks: list[Block] = [
        Paragraph(
            "Each value comes with one standard deviation (±) where it is known; “by convention” marks what was "
            "chosen, not measured: sensors alone cannot tell where north is, nor where on the floor somebody stands."
        )
    ]
    for wearer in material.wearers:
        if len(material.wearers) > 1:
            blocks.append(Heading(wearer.name))
        blocks += [*_body(wearer), *_sensors(wearer), *_places(wearer)]
    if material.estimate.camera is not None:
        blocks += _camera(material.estimate.camera)
    detector = material.estimate.detector
    if detector is not None:
        rows = [
            (name, *(plus_minus(MM * found[axis], MM * sigma[axis]) for axis in (2, 1, 0)))
            for name, found, sigma in zip(detector.keypoints, detector.posterior, detector.sigma, strict=True)
        ]
        head = ("Point", "Forward, mm", "Up, mm", "Outward, mm")
        blocks.append(Table(head, rows, "Where the detector puts its points, against the joint centres", folded=True))
    return Section("found", "What was found", tuple(blocks))


def _body(wearer: Wearer) -> list[Block]:
    body, skeleton = wearer.estimate.body, wearer.estimate.motion.skeleton
    blocks: list[Block] = []
    if body is None or not body.names:
        taken = [
            (name, with_unit(MM * skeleton.bone_length(end), "mm", 0))
            for name, end in (
                ("thigh", "left_knee"), ("shank", "left_ankle"), ("upper arm", "left_elbow"), ("forearm", "left_wrist")
            )
        ]  # fmt: skip
        blocks.append(Paragraph(f"Body: {skeleton.source}. Its lengths were taken as likely, not measured here."))
        blocks.append(Table(("Length", "Taken"), taken))
    else:
        rows = [
            (
                name, plus_minus(MM * prior, MM * prior_sigma), plus_minus(MM * found, MM * sigma),
                number(MM * (found - prior), 0), "keeps what was likely" if keeps else "measured",
            )
            for name, prior, prior_sigma, found, sigma, keeps in zip(
                body.names, body.prior, body.prior_sigma, body.posterior, body.sigma, body.keeps_prior, strict=True
            )
        ]  # fmt: skip
        blocks.append(Paragraph(f"Body: {skeleton.source}."))
        blocks.append(Table(("Length, mm", "Likely before", "Found", "Change", ""), rows))
    if body is not None and body.hinges:
        before = {one.joint: one for one in body.prior_hinges}
        found_hinges = []
        for hinge in body.hinges:
            prior = before.get(hinge.joint)
            likely = UNKNOWN if prior is None else _degrees(prior.carrying_angle, prior.carrying_sigma)
            found_hinges.append(
                (joint_words(hinge.joint), likely, _degrees(hinge.carrying_angle, hinge.carrying_sigma))
            )
        blocks.append(Table(("Carrying angle of hinges", "Likely before", "Found"), found_hinges))
    return blocks


def _degrees(value: float, sigma: float = float("nan")) -> str:
    return plus_minus(float(np.rad2deg(value)), float(np.rad2deg(sigma)), "°", 1, 1)


def _sensors(wearer: Wearer) -> list[Block]:
    """Headings and mountings, and how headings drifted."""
    calibration, recording = wearer.estimate.calibration, wearer.recording
    if not calibration:
        return []
    sites = {site.sensor: site for site in recording.placement.sites} if recording is not None else {}
    rows = []
    for name, one in calibration.items():
        held = np.isfinite(one.heading_sigma) and one.heading_sigma <= HELD
        heading = float(wrap_angle(one.heading))
        path = np.rad2deg(one.heading_path)
        site = sites.get(name)
        turned = _degrees(float(angle_between(site.R_bone_sensor, one.R_bone_sensor))) if site else UNKNOWN
        sigma = np.rad2deg(one.mounting_sigma)
        rows.append(
            (
                name, bone_words(site.bone) if site else UNKNOWN,
                f"{_degrees(heading)}, by convention" if held else _degrees(heading, one.heading_sigma),
                f"{path[-1] - path[0]:+z.1f}°" if len(path) else "none looked for",
                turned, f"± {sigma.max():.1f}°" if np.isfinite(sigma).all() else "unknown",
            )
        )  # fmt: skip
    head = ("Sensor", "On", "Direction (heading)", "Drift to the end", "Turned against its site", "Known to")
    blocks: list[Block] = [
        Table(head, rows, "How the sensors were turned: about the vertical, and on the body", words=2)
    ]
    if not np.isfinite([one.heading_sigma for one in calibration.values()]).any():
        blocks.append(
            Paragraph(
                "How sure headings are was not computed for this method. The direction of the whole body about the "
                "vertical is a convention here: only headings relative to each other are measured.",
                small=True,
            )
        )
    return [*blocks, *_drift(wearer), *_start(wearer.estimate.start)]


def _drift(wearer: Wearer) -> list[Block]:
    lines = [
        Line(name, one.heading_time, np.rad2deg(one.heading_path - one.heading_path[0]), _shade(index, wearer))
        for index, (name, one) in enumerate(wearer.estimate.calibration.items())
        if len(one.heading_path) > 1
    ]
    chart = time_chart("Drift of the headings", lines, "°", wide=True)
    return [Charts((chart,))] if chart is not None else []


def _shade(index: int, wearer: Wearer) -> str:
    """Colours by side where the sensor's site is known."""
    name = list(wearer.estimate.calibration)[index]
    for site in wearer.recording.placement.sites if wearer.recording is not None else ():
        if site.sensor == name:
            side = site.bone.partition("_")[0]
            return SIDE_COLOURS[Side(side)] if side in ("left", "right") else SIDE_COLOURS[Side.MIDDLE]
    return SIDE_COLOURS[Side.MIDDLE]


def _start(start: StartChoice | None) -> list[Block]:
    if start is None:
        return []
    text = f"The reconstruction began with the supposition that {start.supposition}."
    if start.rival:
        times = f"{np.exp(start.margin):.1f}" if start.margin < 7 else "over 1000"
        text += f" The likeliest other way to wear the sensors was {times} times less likely."
    if start.doubtful:
        text += f" Not settled: {', '.join(start.doubtful)}."
    return [Paragraph(text, small=True)]


def _places(wearer: Wearer) -> list[Block]:
    rows = [
        (
            one.sensor,
            bone_words(one.bone),
            *(_axis_words(one.posterior, one.prior, one.sigma, axis) for axis in (0, 1, 2)),
        )
        for one in wearer.estimate.sensor_places
    ]
    head = ("Sensor", "On", "To the left", "Up", "Forward")
    caption = "Where the sensors sat on their segments, in mm from the joint (in brackets: moved from where supposed)"
    return [Table(head, rows, caption, words=2, folded=True)] if rows else []


def _axis_words(posterior: np.ndarray, prior: np.ndarray, sigma: np.ndarray, axis: int) -> str:
    moved = MM * (posterior[axis] - prior[axis])
    return f"{plus_minus(MM * posterior[axis], MM * sigma[axis])} ({moved:+z.0f})"


def _camera(camera: CameraEstimate) -> list[Block]:
    path = camera.path
    blocks: list[Block] = [Heading(f"Camera “{camera.name}”")]
    rows = []
    if len(path) == 1:
        rows.append(("Place in the world", ", ".join(f"{value:.2f}" for value in path.p_world_camera[0]) + " m"))
    else:
        length = float(np.linalg.norm(np.diff(path.p_world_camera, axis=0), axis=1).sum())
        rows.append(("Path", f"{with_unit(length, 'm', 2)} in {len(path)} poses"))
    if camera.covariance is not None:
        variance = np.diagonal(camera.covariance, axis1=1, axis2=2)
        turn = np.rad2deg(np.sqrt(np.median(variance[:, :3].max(axis=1))))
        shift = 100 * np.sqrt(np.median(variance[:, 3:].max(axis=1)))
        rows.append(("Known to", f"± {turn:.1f}° and ± {shift:.0f} cm (median, worst axis)"))
    if camera.calibration is not None:
        one = camera.calibration
        held = np.isfinite(one.heading_sigma) and one.heading_sigma <= HELD
        words = ", by convention" if held else ""
        rows.append(("Heading of its sensor", _degrees(float(wrap_angle(one.heading)), one.heading_sigma) + words))
        sigma = np.rad2deg(one.mounting_sigma)
        if np.isfinite(sigma).all():
            rows.append(("Mounting of its sensor", f"known to ± {sigma.max():.1f}° (worst axis)"))
    offset = plus_minus(
        1e3 * camera.time_offset, 1e3 * camera.clock_sigma[0] if camera.clock_sigma else np.nan, "ms", 0, 1
    )
    rows.append(("Clock: video behind sensors by", offset + ("" if camera.clock_sigma else ", kept as told")))
    if camera.clock_sigma:
        rows.append(
            (
                "Clock: drift",
                plus_minus(60e3 * camera.time_drift, 60e3 * camera.clock_sigma[1], "ms", 1, 1) + " a minute",
            )
        )
    return [*blocks, Table(("Camera", ""), rows)]
