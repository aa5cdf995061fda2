"""What was recorded (sensors, gaps, video, whom its detections were given to), and how the estimate was made."""

import numpy as np

from vip_factors import __version__
from vip_factors.report.blocks import Block, Heading, Paragraph, Section, Table
from vip_factors.report.material import Material, Wearer
from vip_factors.report.words import UNKNOWN, bone_words, count, seconds_words, with_unit
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera

MEASURES = {"R_inertial_sensor": "orientation", "specific_force": "acceleration", "angular_rate": "turning rate"}


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
