"""What is odd about a recording or its estimate, as data: a kind, whom it is about, and numbers.

Text is made where it is shown, from the one table of kinds: the sentence for whoever knows the method, and for
everybody what was found in a few words, what that means for the use of the results, and what to do.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

TEXT = "text"  # the kind of a bare sentence: from a file of an older version, or of a stream's source


class Severity(StrEnum):
    """How much a finding bears on the use of the results, the least first; GOOD is said of results alone."""

    GOOD = "good"
    NOTE = "note"
    CARE = "care"
    DOUBT = "doubt"

    def reaches(self, other: "Severity") -> bool:
        """Whether it bears as much on them as another."""
        order = list(Severity)
        return order.index(self) >= order.index(other)


@dataclass(frozen=True)
class Kind:
    """What all findings of a kind have in common.

    Attributes:
        severity: how much they bear on the results.
        sentence: with the names and numbers of a finding in braces; ``{each}`` is a list of its numbers.
        headline: what was found, in a few words.
        means: for the use of the results.
        advice: what to do.
        each: how one of the numbers is told in that list, by its ``name`` and ``value``.
    """

    severity: Severity
    sentence: str
    headline: str
    means: str
    advice: str
    each: str = "{name}"


@dataclass(frozen=True)
class Finding:
    """Something to be shown to the user; its text is the sentence.

    Attributes:
        kind: a name in :data:`KINDS`.
        wearer: name of the wearer it is about, if it is about one.
        camera: name of the camera in whose picture it was found, where there are several.
        subject: the sensor, joint, camera … it is about.
        numbers: by the names that the sentence has for them, or by what they were measured on; SI units, or as the
            names say.
        words: parts of the sentence that are no numbers.
        during: seconds of the window from which and until when it was found, in a recording solved in windows.
        more_windows: in which the same was found.
        text: the sentence itself, of one that was read from a file.
    """

    kind: str
    wearer: str = ""
    camera: str = ""
    subject: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    during: tuple[float, float] | None = None
    more_windows: int = 0
    text: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"'{self.kind}' is no kind of finding")

    @property
    def about(self) -> tuple[str, str, str, str]:
        """Kind and whom it is about: findings that agree in it are told once."""
        return self.kind, self.wearer, self.camera, self.subject or self.text

    def __hash__(self) -> int:
        return hash(self.about)

    @property
    def severity(self) -> Severity:
        """How much it bears on the results."""
        return KINDS[self.kind].severity

    def __str__(self) -> str:
        if self.text:
            return self.text
        kind = KINDS[self.kind]
        each = ", ".join(kind.each.format(name=name, value=value) for name, value in self.numbers.items())
        names = {"wearer": self.wearer, "subject": self.subject, "each": each, "count": len(self.numbers)}
        told = kind.sentence.format(**{**self.numbers, **self.words, **names})
        if self.camera:
            told = f"camera '{self.camera}': {told}"
        if self.during is not None:
            more = f", and in {self.more_windows} more windows" if self.more_windows else ""
            told += f" (from {self.during[0]:.0f} to {self.during[1]:.0f} s{more})"
        return told


def bare(sentence: str, kind: str = TEXT) -> Finding:
    """A finding of which only the sentence is known, and perhaps its kind; an unknown one is :data:`TEXT`."""
    return Finding(kind if sentence and kind in KINDS else TEXT, text=sentence)


def sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The findings as text."""
    return tuple(map(str, findings))


VERDICTS = {
    Severity.GOOD: "nothing speaks against these results",
    Severity.CARE: "usable with care",
    Severity.DOUBT: "do not rely on these results before this is settled",
}


@dataclass(frozen=True)
class Verdict:
    """Whether to rely on an estimate: the one that terminal, report, viewers, JSON and exit codes tell.

    Attributes:
        severity: GOOD, CARE or DOUBT.
        deciding: headlines of the findings that weigh as much.
    """

    severity: Severity
    deciding: tuple[str, ...] = ()

    def __str__(self) -> str:
        told = f"{self.severity.upper()}, {VERDICTS[self.severity]}"
        return f"{told}: {'; '.join(self.deciding)}" if self.deciding else told


def verdict(findings: Iterable[Finding]) -> Verdict:
    """The verdict on what has these findings: as its worst; notes do not speak against it."""
    weighty = [one for one in findings if one.severity.reaches(Severity.CARE)]
    worst = Severity.DOUBT if any(one.severity is Severity.DOUBT for one in weighty) else Severity.CARE
    deciding = dict.fromkeys(KINDS[one.kind].headline for one in weighty if one.severity is worst)
    return Verdict(worst, tuple(deciding)) if weighty else Verdict(Severity.GOOD)


class MergedFindings:
    """Findings of windows, each told once: as in the first window that has it, and in how many more there were.

    Args:
        known: what is told of the whole already: windows need not say it again.
    """

    def __init__(self, known: Sequence[Finding] = ()) -> None:
        self._known = {one.about: one for one in known}
        self._found: dict[tuple[str, ...], Finding] = {}
        self._more: dict[tuple[str, ...], int] = {}

    def add(self, findings: Sequence[Finding], start: float, end: float) -> None:
        """Those of a window from one instant to another, seconds."""
        for about, one in {one.about: one for one in reversed(findings)}.items():
            if about in self._found:
                self._more[about] += 1
            elif about not in self._known:
                self._found[about], self._more[about] = replace(one, during=(start, end)), 0

    def all(self) -> tuple[Finding, ...]:
        """What was known, then what was found."""
        return (
            *self._known.values(),
            *(replace(one, more_windows=self._more[about]) for about, one in self._found.items()),
        )


NOTE, CARE, DOUBT = Severity.NOTE, Severity.CARE, Severity.DOUBT
CHECK = "check which sensor sits where and, if one was declared, that the pose was held"
SENSORS_ALONE = "The video adds nothing: the result rests on the sensors alone."
FILM_WHOLE = "Place the camera so that the person is seen from head to foot."

SENSOR_KINDS = {
    "sensors exchanged": Kind(
        DOUBT,
        "wearer '{wearer}': the sensors {pair}{rivals} are in each other's places: bones that share a joint are "
        "accelerated alike there, and with these exchanged they are ({nats:.0f} nats likelier); {done}",
        "Two sensors are in each other's places",
        "If they were not exchanged in the reconstruction, the joints beside these sensors are wrong as a whole.",
        "Exchange the two in the list of sensors, or let the reconstruction do it (--assign).",
    ),
    "sensors put right": Kind(
        NOTE,
        "wearer '{wearer}': the sensors {pair} are in each other's places ({nats:.0f} nats likelier), and were taken "
        "for one another",
        "Two sensors were in each other's places",
        "They were exchanged in the reconstruction, so the results are usable.",
        "Exchange the two in the list of sensors before the next session.",
    ),
    "two on one bone": Kind(
        DOUBT,
        "wearer '{wearer}': the sensors {pair} turn together: against each other by {spread:.1f}° only, though both "
        "move; either both are on one bone, or the knee was held stiff all the time",
        "Two sensors seem to be on one segment",
        "The knee comes out stiff. If it was not, its angle and what hangs on it are wrong.",
        "Check on which segment each of the two sat, correct the list of sensors, or repeat the recording.",
    ),
    "sensor stuck": Kind(
        DOUBT,
        "wearer '{wearer}': sensor '{subject}' gives the very same values for {seconds:.1f} s: it hung, or its file "
        "was filled up",
        "A sensor got stuck",
        "While it hung, the bone that it is on is held where it was, and the joints beside it are wrong.",
        "Cut the recording to the time before or after, leave the sensor out, or leave such samples out of its file.",
    ),
    "accelerometer range": Kind(
        NOTE,
        "wearer '{wearer}': the accelerometer of '{subject}' stands at the end of its range ({largest:.0f} m/s²) in "
        "{samples:.0f} samples: those are left out; a wider range would help",
        "A sensor was shaken beyond its range",
        "In hard impacts this sensor could not measure how strong they were. Those instants were left out; the "
        "angles around them rest on the other sensors and are a little less certain.",
        "For running and jumping set the sensor to a wider range (±16 g).",
    ),
    "accelerometer scale": Kind(
        NOTE,
        "wearer '{wearer}': the accelerometer of '{subject}' measures gravity as {gravity:.2f} m/s², {percent:+.0f} %: "
        "scaled to 9.81; {advice}",
        "A sensor measures gravity wrongly",
        "Its accelerations were scaled to the right size, so the results are usable.",
        "Have the sensor calibrated before the next session.",
    ),
    "sensor clocks disagree": Kind(
        CARE,
        "wearer '{wearer}': sensor '{subject}' seems {off_ms:.0f} ± {sigma_ms:.0f} ms {late} '{rival}', and nothing "
        "tells which of the two is off: check their clocks",
        "Two sensors are not at the same time",
        "One of two sensors tells its movement too early or too late, and it is not known which. In quick movements "
        "the angles of the joints between them are wrong, in slow ones hardly.",
        "Synchronise the sensors again and repeat quick movements.",
    ),
    "sensor clock": Kind(
        NOTE,
        "wearer '{wearer}': sensor '{subject}' is {off_ms:.0f} ± {sigma_ms:.0f} ms {late} its fellows: {done}; check "
        "its clock",
        "A sensor's clock was off",
        "Unless the sentence says that it was left so, its times were shifted and the results are usable.",
        "Synchronise the sensors before the next session.",
    ),
    "heading drift": Kind(
        NOTE,
        "wearer '{wearer}': headings drifted: {each} from the start to the end; the estimate follows them",
        "Some sensors slowly turned about the vertical",
        "Magnetic disturbance or the sensors' gyroscopes made them lose their direction over time. The estimate "
        "follows it. Turning (rotation) about the vertical is less certain than bending, above all late in the "
        "recording.",
        "Keep away from iron and motors, and record shorter takes.",
        "{name} by {value:+.0f}°",
    ),
    "sensor turned": Kind(
        DOUBT,
        "wearer '{wearer}': from {time:.1f} s on sensor '{subject}' is turned otherwise than before, by {degrees:.0f}° "
        "against a body that gives way to it, and in truth by several times as much: {how}",
        "A sensor slipped, or lost its direction",
        "Both before and after, the joints beside this sensor are wrong.",
        "Cut the recording at this instant and reconstruct the pieces one by one; fix the sensor better.",
    ),
    "start not settled": Kind(
        DOUBT,
        "wearer '{wearer}': the recording does not settle how {sensors} sat and which way the inertial frames point: "
        "the start supposes that {supposition}, and another, turned by more than 60° (it supposes that {rival}), is "
        "only {times:.1f} times less likely: {better}, or the straps as they really sat, would tell",
        "How some sensors sat is not settled",
        "Another way of wearing the sensors explains the recording nearly as well. If the supposition is wrong, the "
        "joints beside these sensors are wrong by a large, constant angle.",
        "Compare the motion below with what was done. Repeat the recording with a T- or N-pose held at the start.",
    ),
    "impossible site": Kind(
        DOUBT,
        "wearer '{wearer}': {sensors} cannot sit as the placement says, whichever side up: their bones would not be "
        "upright on the whole. Declare a pose held at the start, or describe how they were strapped on",
        "A sensor cannot sit where it is said to",
        "The list of sensors does not fit what they measured. The joints beside them are not to be relied on.",
        "Check which sensor was on which segment and which way round, correct the list, and reconstruct again.",
    ),
    "turned on the body": Kind(
        DOUBT,
        "wearer '{wearer}': {count} of {of} sensors are found turned by more than {limit} against the placement "
        "({each}): if they were strapped on as it says, do not trust the pose; if not, describe how, or hold a pose at "
        "the start and declare it",
        "Many sensors sit otherwise than described",
        "Either they were strapped on differently from the description, or the reconstruction went wrong as a whole.",
        "If they were strapped on as described, do not use these angles: repeat with a pose held at the start.",
    ),
    "headings not determined": Kind(
        CARE,
        "wearer '{wearer}': the headings of {each} are not determined by the data (standard deviation above {limit}): "
        "keypoints beyond them (toes, hands) or longer motion would help",
        "The direction of some sensors is only known roughly",
        "Bending of the joints beside them is still known; rotation about the vertical may be off by 15° and more.",
        "Let the camera see hands and toes, or record longer and more varied movement.",
    ),
}

POSTURE_KINDS = {
    "knee backwards": Kind(
        DOUBT,
        "wearer '{wearer}': the {subject} bends backwards in {percent:.0f} % of the frames: are the sensors of thigh "
        "and shank where the placement has them, and was the declared pose held?",
        "A knee bends backwards",
        "Knees hardly do that. The angles of this leg are likely off by a constant amount.",
        "Check that thigh and shank sensors were not exchanged or turned. Compare ranges only, not absolute angles.",
    ),
    "lying": Kind(
        CARE,
        f"wearer '{{wearer}}' lies, or bends far over, in {{percent:.0f}} % of the frames: if not, {CHECK}",
        "The body lies or bends far over for most of the time",
        "Right for exercises on the floor. Otherwise the whole body is turned wrongly.",
        "If the person stood or walked, check the sensor on pelvis or trunk and repeat.",
    ),
    "legs crossed": Kind(
        DOUBT,
        f"wearer '{{wearer}}': the legs are crossed in {{percent:.0f}} % of the frames: if they were not, {CHECK}",
        "The legs are crossed for much of the time",
        "If they were not, left and right leg sensors may be exchanged, and hip angles are wrong.",
        "Check the left and right sensors.",
    ),
    "joint limit": Kind(
        CARE,
        "wearer '{wearer}': the {subject} is bent further than {joints} go in {percent:.0f} % of the frames: does the "
        "sensor below it sit as the placement has it, and was the declared pose held, if there was one?",
        "A joint bends further than joints do",
        "The zero of this joint is off. Its range is still of use, its absolute angle is not.",
        "Check how the sensor below it was fixed, and whether the declared pose was held.",
    ),
    "turned since the start": Kind(
        DOUBT,
        "wearer '{wearer}': the motion turns {each} on their bones against what {declared} told: was the pose held, do "
        "they sit where the placement says, and did they stay there? Do not trust how these bones are turned",
        "The motion contradicts how sensors were said to sit",
        "How these bones are turned about themselves is not to be trusted; where their ends are may be.",
        "Check the declared pose, the placement, and whether the sensors stayed where they were.",
        "{name} by {value:.0f}°",
    ),
    "two calibrations": Kind(
        DOUBT,
        "wearer '{wearer}': two calibrations explain the recording, this one only {times} times as well as another, "
        "which turns {each} on their bones: do not trust how these bones are turned; a pose held at the start, or more "
        "and brisker motion, would tell",
        "The recording does not settle how some sensors sat",
        "How these bones are turned about themselves may be the other way; where their ends are may be right.",
        "Declare a pose held at the start, or record more and brisker motion of these limbs.",
        "{name} by {value:.0f}°",
    ),
    "body size": Kind(
        CARE,
        "wearer '{wearer}': stature and pictures disagree: all lengths together ask for a body {percent:.0f} % "
        "{larger} than {usual}: check the stature, and the camera's calibration (another zoom?)",
        "The height given does not fit the video",
        "Distances (step lengths, positions) are off by this share. Angles suffer little.",
        "Measure the person's height, and check that the camera's zoom is that of its calibration.",
    ),
    "body lengths": Kind(
        CARE,
        "wearer '{wearer}': stature and pictures disagree about {lengths}: either the wearer is built so, or the "
        "sensors there sit elsewhere than the placement has them",
        "Some body segments came out unusually long or short",
        "Either this person is built so, or a sensor sits elsewhere on the segment than described.",
        "Measure the segment with a tape and give its length, or describe where the sensor sat.",
    ),
}

VIDEO_KINDS = {
    "floor uncertain": Kind(
        CARE,
        "the height of the floor is uncertain by {sigma_cm:.0f} cm: soles stand at different heights (stairs, jumps, "
        "a slope), or hardly stand",
        "The floor's height is only known roughly",
        "Heights over the floor are off by as much; angles and distances between joints are not.",
        "Let both feet stand on the floor for a second, or calibrate the camera's pose (calibrate-camera --floor).",
    ),
    "not in the video": Kind(
        CARE,
        "no wearer was found in the video: the estimate is of the IMUs alone, without a camera",
        "The video could not be used",
        "The motion rests on the sensors alone: where the person was, and which way the body faced, may drift.",
        "See what is said of the video; check that it belongs to this recording.",
    ),
    "apart": Kind(
        NOTE,
        "without a camera the wearers are not placed relative to one another",
        "Several people, but nothing ties them together",
        "Each person's angles are usable. Distances between the people are not known; the view sets them side by side.",
        "Film them if how they stand to each other matters.",
    ),
    "not determined": Kind(
        DOUBT,
        "the data do not determine all headings{also}: in part they are guesses",
        "Part of the result is a guess",
        "The recording holds too little movement to tell how all sensors and the camera stood.",
        "Record longer and more varied movement before using the numbers.",
    ),
    "camera left out": Kind(
        NOTE,
        "camera '{subject}' is left out: what it shows does not tell where it was",
        "A camera was not used",
        "The result rests on the other cameras and the sensors.",
        "Check this camera's file and its calibration.",
    ),
    "never seen": Kind(
        CARE,
        "wearer '{wearer}' is never seen: the pose is of the IMUs alone, and the place relative to the others unknown",
        "The camera never saw this person",
        "The angles rest on the sensors alone. Where the person stood among the others is not known.",
        FILM_WHOLE,
    ),
    "shortly seen": Kind(
        CARE,
        "wearer '{wearer}' is seen for {seconds:.1f} s only: whoever stood there likewise would do as well, so check "
        "that it is the wearer",
        "The camera saw this person only briefly",
        "It may be another person in the video who was taken for this one.",
        "Look at the pictures in this report: is it the right person?",
    ),
    "leap": Kind(
        DOUBT,
        "wearer '{wearer}' leaps in the picture at {times} s, faster than people and cameras move: a cut in the video, "
        "a change of zoom, or a stranger? Cut the recording there",
        "The person jumps in the video from one frame to the next",
        "A cut, a change of zoom, or a stranger in the picture. Around these times the result is not to be relied on.",
        "Cut the recording there and reconstruct the pieces one by one.",
    ),
    "scatter": Kind(
        DOUBT,
        "wearer '{wearer}': the keypoints scatter about the skeleton by {scatter:.2f} OKS sigmas, where 0.3 to 0.5 are "
        "usual: check the clock offset (vip-factors sync), the camera's calibration (another zoom?){pose}, the order "
        "of the keypoints and the wearer's stature",
        "The body does not fit the video well",
        "Body and picture are further apart than usual: positions, and rotations about the vertical, may be wrong.",
        "Check that sensors and video run at the same time, the camera's calibration, and the height given.",
    ),
    "image size": Kind(
        DOUBT,
        "the keypoints lie between x = {left:.0f} and {right:.0f}, y = {top:.0f} and {bottom:.0f} in an image that is "
        "calibrated as {width:.0f} by {height:.0f} pixels: if they were found at another resolution than the "
        "calibration's, give a camera file of theirs",
        "The points found do not belong to this image size",
        "The video was likely analysed at another resolution than the camera's calibration; positions are wrong.",
        "Give the calibration of the resolution that was analysed, and reconstruct again.",
    ),
    "video rate": Kind(
        DOUBT,
        "the video has about {better:.3g} frames a second, not {stated:.4g}: so its people move as their sensors say "
        "({nats:.0f} nats likelier): convert again with the rate that it was filmed at (--video-rate)",
        "The video's frame rate is wrong",
        "What the video shows is taken for other instants than it was filmed at: positions and turns are wrong.",
        "Convert again with the frame rate at which the video was filmed (--video-rate).",
    ),
    "another film": Kind(
        DOUBT,
        "the video seems to be of another session: at its best offset ({seconds:+.2f} s) the sensors explain "
        "{percent:.0f} % of how limbs move in the picture, where 35 to 60 are usual, and its halves do not agree: "
        "check the file, and which sensor sits where",
        "The video does not fit the sensors",
        "It is likely of another session or another person: nothing that rests on it is to be used.",
        "Check that video and sensor files belong together, and the list of sensors.",
    ),
    "video clock off": Kind(
        NOTE,
        "the video's clock is {off_ms:+.0f} ± {sigma_ms:.0f} ms off what the scene says, and was put right; if it is "
        "off by more than 100 ms, find its offset first (vip-factors sync)",
        "Video and sensors did not start together",
        "The shift was found and put right.",
        "Nothing, if it is small. If it is over 0.1 s, find it first with “vip-factors sync”.",
    ),
    "video clock drift": Kind(
        NOTE,
        "the video's clock drifts from the sensors' by {drifted_ms:+.0f} ms from its start to its end ({ppm:+.0f} ± "
        "{sigma_ppm:.0f} ppm); the estimate follows it",
        "Video and sensors run at slightly different speeds",
        "It was found, and the estimate follows it.",
        "Nothing.",
    ),
}

ASSOCIATION_KINDS = {
    "nobody visible": Kind(
        CARE,
        "nobody is visible in any of the {frames:.0f} video frames: the camera adds nothing, check the detections' "
        "file",
        "Nobody was found in the video",
        SENSORS_ALONE,
        "Check the file of the detections.",
    ),
    "no common time": Kind(
        CARE,
        "the video and the sensors do not overlap in time: nobody could be found, check the camera's time offset",
        "Video and sensors are not of the same time",
        SENSORS_ALONE,
        "Check the time offset of the camera.",
    ),
    "few keypoints": Kind(
        CARE,
        "people are visible with {shown:.0f} keypoints each (the detector gives {given}), and at least {least:.0f} at "
        "once are needed to tell who is who: add {missing}",
        "Too few body points in the video",
        "People in the video could not be told apart, so it was not used.",
        "Use a detector that gives hips, knees, ankles and shoulders.",
    ),
    "never whole": Kind(
        CARE,
        "no detection shows {least:.0f} keypoints at once while wearer '{wearer}' is measured: nobody can be compared "
        "with that wearer",
        "This person was never seen well enough",
        "Too little of the body is in the picture to recognise the person.",
        FILM_WHOLE,
    ),
    "too few to be sure": Kind(
        CARE,
        "people are visible, but none is surely wearer '{wearer}' by the {keypoints:.0f} keypoints that the detector "
        "gives ({given}): more of them (knees and ankles, elbows and wrists) would tell",
        "This person was not recognised in the video",
        "The few points that were found do not tell who it is; the result rests on the sensors alone.",
        "Use a detector that gives knees and ankles, elbows and wrists.",
    ),
    "not recognised": Kind(
        DOUBT,
        "people are visible, but none moves as the sensors of wearer '{wearer}' say: either that wearer is not in the "
        "picture, or the video's clock, its keypoints' order or the sensors' places are wrong",
        "Nobody in the video moves like this person",
        "The person may not be in the picture, or video and sensors do not fit together.",
        "Check the video, its time offset, and which sensor sat where.",
    ),
    "alike": Kind(
        CARE,
        "wearers '{wearer}' and '{subject}' move nearly alike (keypoints within {cm:.0f} cm): they cannot be told "
        "apart in the video",
        "Two people move alike",
        "They may have been exchanged in the video. Angles suffer little, positions would be exchanged.",
        "Look at the pictures: are the names right? Let one of them move differently at the start.",
    ),
    "keypoint order": Kind(
        DOUBT,
        "the keypoints fit the wearers much better in another order: expected '{given}', but '{better}' is what they "
        "look like; name the right keypoint set when reading the detections",
        "The body points seem to be named wrongly",
        "Left and right, or whole joints, may be exchanged: do not use the result.",
        "Name the right set of keypoints when converting, give the video unmirrored, and reconstruct again.",
    ),
}

OTHERS_CARRY = "Where this sensor does not measure, the others and the last motion tell how its bone is turned."
CLOCKS = "Synchronise the clocks of sensors and cameras, and do not set them while recording."
POSES_MISSING = "Of the time until tracking goes on there are no poses."
TOO_SLOW = "Use fewer frames per second (--frame-rate), fewer wearers, fewer cameras or a shorter lag."

SAMPLE_KINDS = {
    "samples unusable": Kind(
        CARE,
        "{amount} of {subject} skipped: {reason}",
        "Some measurements could not be used",
        OTHERS_CARRY,
        "Check what the sensor or the detector sends.",
    ),
    "samples late": Kind(
        CARE,
        "{amount} of {subject} came too late",
        "Some measurements came too late",
        OTHERS_CARRY,
        "Check the radio link or the network.",
    ),
    "all silent": Kind(
        CARE,
        "all sensors were silent for {seconds:.1f} s from {begin:.2f} s on: {then}",
        "All sensors were silent for a while",
        "Of this time there are no measurements.",
        "Check the radio link or the network.",
    ),
    "samples dropped": Kind(
        CARE,
        "no samples for {seconds:.1f} s from {begin:.2f} s on, as the tracker did not keep up and they were dropped: "
        "{then}",
        "The computer was too slow for the stream",
        "Of this time there are no measurements.",
        TOO_SLOW,
    ),
    "name unknown": Kind(
        CARE,
        "{subject} is not in the stream's set-up: ignored; check the name",
        "Somebody sends whom the set-up does not know",
        "What is sent under this name is not used.",
        "Check the name in the set-up.",
    ),
    "names unknown": Kind(
        CARE,
        "more than {most:.0f} names that nobody declared: the rest is ignored without a word",
        "Many send whom the set-up does not know",
        "What is sent under these names is not used.",
        "Check the names in the set-up.",
    ),
    "clock refused": Kind(
        CARE,
        "{subject}: its clock jumped from {before:.2f} s to {after:.2f} s: such samples are refused{others}",
        "A clock jumped",
        OTHERS_CARRY,
        CLOCKS,
    ),
    "clock jumped": Kind(
        NOTE,
        "{subject}: its clock jumped from {before:.2f} s to {after:.2f} s and goes on from there: its {stamp:.2f} s "
        "are taken for {taken:.2f} s{others}",
        "A clock jumped",
        "Its times were shifted; a shift that is off by a little shows in quick movements.",
        CLOCKS,
    ),
    "sensor missing": Kind(
        CARE,
        "{subject} has sent nothing yet: going on without it",
        "A sensor does not send",
        "The bone that it is worn on is estimated from the others.",
        "Check that it is switched on, and its name.",
    ),
    "sensor silent": Kind(
        CARE,
        "{subject} {what} for {seconds:.1f} s{why}: going on without it",
        "A sensor does not send any more",
        OTHERS_CARRY,
        "Check its battery and the radio link.",
    ),
    "sensor back": Kind(NOTE, "{subject} {what}", "A sensor sends again", "It is used from here on.", "Nothing."),
}

TRACKING_KINDS = {
    "stream paused": Kind(
        CARE, "the stream has paused: tracking starts again", "The stream has paused", POSES_MISSING, "Nothing."
    ),
    "tracking lost": Kind(
        CARE,
        "tracking was lost at {time:.1f} s ({reason}): tracking starts again",
        "Tracking was lost",
        POSES_MISSING,
        "If it happens again, check the placement and the sensors.",
    ),
    "no start": Kind(
        CARE,
        "tracking cannot start at {time:.1f} s: {reason}",
        "Tracking could not start",
        POSES_MISSING,
        "Check what the sentence names.",
    ),
    "wearer found": Kind(
        NOTE,
        "a wearer was found in the video",
        "Somebody was recognised in the video",
        "The video is used from here on.",
        "Nothing.",
    ),
    "sensor used": Kind(
        NOTE, "another sensor is used from here on", "A sensor has come", "It is used from here on.", "Nothing."
    ),
    "sensor moved": Kind(
        CARE,
        "sensor '{subject}' of '{wearer}' no longer sits as it did: its heading and mounting are estimated anew",
        "A sensor has slipped",
        "For the seconds that this takes the bone below it may be turned wrongly.",
        "Check how this sensor is fixed.",
    ),
    "calibration corrected": Kind(
        CARE,
        "{seconds} s of data show what less could not: until now the bones of {each} were turned wrong",
        "The first seconds were wrong",
        "Before this instant these bones were turned wrongly.",
        "Smooth the recording afterwards, or hold a declared pose at the start.",
        "'{name}' by {value:.0f}°",
    ),
    "calibration not renewed": Kind(
        CARE,
        "the calibration was not found anew: {reason}",
        "The calibration could not be improved",
        "The stream goes on with the calibration that it has.",
        "Check what the sentence names.",
    ),
    "frames missing": Kind(
        CARE,
        "{wearer}: {frames:.0f} frames are missing before {until:.2f} s; the last pose is held there",
        "Some frames have no pose",
        "There the last pose is repeated.",
        "Nothing.",
    ),
}

KINDS: dict[str, Kind] = {
    TEXT: Kind(
        CARE, "", "Something else was noticed", "See the sentence below.", "If in doubt, ask who made the recording."
    ),
    "not converged": Kind(
        CARE,
        "the computation stopped before it had settled ({subject})",
        "The computation stopped before it had settled",
        "The result may still change with more steps.",
        "Reconstruct again with more iterations (--solve.max-iterations).",
    ),
    **SENSOR_KINDS,
    **POSTURE_KINDS,
    **VIDEO_KINDS,
    **ASSOCIATION_KINDS,
    **SAMPLE_KINDS,
    **TRACKING_KINDS,
}
