"""What was found beside the motion: body, headings, mountings, the camera's path, the clock; and how sure each is.

Then what was recorded (sensors, gaps, video, whom its detections were given to), and how the estimate was made.
"""

import numpy as np

from vip_factors import __version__
from vip_factors.body.mannequin import Side
from vip_factors.estimate import CameraEstimate, StartChoice
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.report.blocks import (
    SIDE_COLOURS,
    UNKNOWN,
    Block,
    Charts,
    Heading,
    Line,
    Paragraph,
    Section,
    Table,
    bone_words,
    count,
    joint_words,
    number,
    plus_minus,
    seconds_words,
    time_chart,
    with_unit,
)
from vip_factors.report.material import Material, Wearer
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera
from vip_factors.terms.heading_prior import HeadingPriorSettings

MEASURES = {"R_inertial_sensor": "orientation", "specific_force": "acceleration", "angular_rate": "turning rate"}
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


def recorded_section(material: Material) -> Section:
    """Of the recording if it is there, else what the estimate itself tells."""
    blocks: list[Block] = []
    if material.scene is None:
        blocks.append(
            Paragraph(
                "The recording was not given, so gaps, rates and sites of the sensors are not known here: name it with "
                "--recording to have them, and pictures of the video."
            )
        )
    for wearer in material.wearers:
        if len(material.wearers) > 1:
            blocks.append(Heading(wearer.name))
        blocks += _wearer(wearer)
    if material.scene is not None and material.scene.camera is not None:
        for camera in material.scene.cameras:
            blocks += [Heading(f"Camera “{camera.name}”"), Paragraph(_camera_words(camera))]
    blocks += _given(material)
    return Section("recorded", "What was recorded", tuple(blocks))


def _wearer(wearer: Wearer) -> list[Block]:
    recording = wearer.recording
    if recording is None:
        return [Paragraph(f"Sensors used: {', '.join(wearer.estimate.sensors) or 'none'}.")]
    blocks: list[Block] = [Paragraph(_subject_words(recording))]
    sites = {site.sensor: bone_words(site.bone) for site in recording.placement.sites}
    rows = [
        (name, sites.get(name, "not placed, not used"), *_stream_words(stream, recording.interval))
        for name, stream in recording.imus.items()
    ]
    blocks.append(Table(("Sensor", "Worn on", "Measures", "Samples", "Rate", "Gaps", "Missing"), rows, words=3))
    if recording.notes:
        blocks.append(Paragraph(recording.notes, small=True))
    return blocks


def _subject_words(recording: Recording) -> str:
    subject, (start, end) = recording.subject, recording.interval
    told = [f"{subject.stature_m:.2f} m tall" if subject.stature_m is not None else "stature not given"]
    told += [f"{subject.mass_kg:g} kg"] if subject.mass_kg is not None else []
    pose = {"none": "no pose was declared at the start"}.get(
        recording.initial_pose, f"declared to stand in {recording.initial_pose.replace('-pose', '').upper()}-pose first"
    )
    return (
        f"{subject.name}: {', '.join(told)}; {pose}; {seconds_words(end - start)} recorded. {subject.body_note}".strip()
    )


def _stream_words(stream: ImuStream, interval: tuple[float, float]) -> tuple[str, ...]:
    gives = ", ".join(word for field, word in MEASURES.items() if getattr(stream, field) is not None)
    gaps = stream.gaps
    lost = float((gaps[:, 1] - gaps[:, 0]).sum()) if len(gaps) else 0.0
    share = 100 * lost / max(interval[1] - interval[0], 1e-9)
    missing = f"{with_unit(lost, 's', 2)} ({share:.1f} %)" if len(gaps) else "none"
    return gives, str(len(stream)), with_unit(stream.rate, "Hz"), str(len(gaps)), missing


def _camera_words(camera: Camera) -> str:
    model, detections = camera.model, camera.detections
    stands = "moving" if camera.moving else "standing still"
    mount = "with a sensor on it" if camera.mount is not None else "without a sensor on it"
    video = "no picture of it is in the recording"
    if camera.video is not None and camera.video.images:
        video = f"{count(len(camera.video.images), 'frame')} of it are in the recording"
    elif camera.video is not None and camera.video.path is not None:
        there = "" if camera.video.path.is_file() else ", which is not there now"
        video = f"its file is {camera.video.path.name}{there}"
    frames = len(detections.time)
    seen = f"{100 * float(detections.seen.mean()):.0f} % of their points found" if len(detections) else "nobody found"
    return (
        f"{stands}, {mount}; {model.width} by {model.height} pixels; {count(frames, 'video frame')} at "
        f"{with_unit(detections.rate, 'Hz')}; {video}. A detector ({detections.keypoints.name}) found a person "
        f"{count(len(detections), 'time')}, {seen}."
    )


def _given(material: Material) -> list[Block]:
    given = material.estimate.wearer_of_detection
    if not len(given):
        return []
    rows = [(one.name, str(int(np.sum(given == one.index))), _share(given == one.index)) for one in material.wearers]
    rows.append(("nobody (strangers, false detections)", str(int(np.sum(given < 0))), _share(given < 0)))
    blocks: list[Block] = [Table(("Detections given to", "Count", "Share"), rows)]
    if material.estimate.association:
        blocks.append(Paragraph(". ".join(material.estimate.association) + ".", small=True))
    return blocks


def _share(which: np.ndarray) -> str:
    return f"{100 * float(np.mean(which)):.1f} %" if len(which) else UNKNOWN


def made_section(material: Material) -> Section:
    """Folded away, but for the method."""
    estimate = material.estimate
    reports = [*estimate.reports, *(report for one in material.wearers for report in one.estimate.reports)]
    blocks: list[Block] = [
        Paragraph(f"Method {estimate.method}; this page was made by vip_factors {__version__}."),
        Heading("Words"),
        Table(("Word", "Meaning"), GLOSSARY, words=2),
    ]
    if reports:
        rows = [(one.stage, "yes" if one.converged else "no", f"{one.seconds:.1f} s") for one in reports]
        blocks.append(Table(("Part", "Settled", "Time"), rows, "How the computation went", folded=True))
    settings = estimate.settings or (material.wearers[0].estimate.settings if material.wearers else {})
    if settings:
        blocks.append(Table(("Setting", "Value"), sorted(settings.items()), "Settings", words=2, folded=True))
    return Section("made", "How it was made", tuple(blocks))


GLOSSARY = (
    ("heading", "the direction about the vertical that a sensor takes for zero"),
    ("mounting", "how a sensor is turned on the segment that it is strapped to"),
    ("±", "one standard deviation: about two of three values lie within, nearly all within twice of it"),
    ("difference, what is unexplained", "what was measured less what the reconstructed motion would have measured"),
    ("95 % below", "only one value in twenty is larger"),
    ("px", "pixels of the video's image"),
)
