"""What each kind of finding means for the use of the results, and what to do about it, in plain words.

Findings are sentences written for whoever knows the method. Their kinds are told by words that all sentences of a kind
share; a test looks for a kind for every sentence that the package can say.
"""

from dataclasses import dataclass

from vip_factors.report.blocks import Weight

CARE, DOUBT, NOTE = Weight.CARE, Weight.DOUBT, Weight.NOTE


@dataclass(frozen=True)
class Meaning:
    """A kind of finding.

    Attributes:
        kind: its name.
        words: that stand in every sentence of the kind and in no other's.
        weight: how much it bears on the results.
        headline: what was found, in a few words.
        means: for the use of the results.
        advice: what to do.
    """

    kind: str
    words: str
    weight: Weight
    headline: str
    means: str
    advice: str


SENSOR_MEANINGS = (
    Meaning(
        "accelerometer range",
        "stands at the end of its range",
        NOTE,
        "A sensor was shaken beyond its range",
        "In hard impacts this sensor could not measure how strong they were. Those instants were left out; the "
        "angles around them rest on the other sensors and are a little less certain.",
        "For running and jumping set the sensor to a wider range (±16 g).",
    ),
    Meaning(
        "accelerometer scale",
        "measures gravity as",
        NOTE,
        "A sensor measures gravity wrongly",
        "Its accelerations were scaled to the right size, so the results are usable.",
        "Have the sensor calibrated before the next session.",
    ),
    Meaning(
        "sensor clocks disagree",
        "and nothing tells which",
        CARE,
        "Two sensors are not at the same time",
        "One of two sensors tells its movement too early or too late, and it is not known which. In quick movements "
        "the angles of the joints between them are wrong, in slow ones hardly.",
        "Synchronise the sensors again and repeat quick movements.",
    ),
    Meaning(
        "sensor clock",
        "its fellows",
        NOTE,
        "A sensor's clock was off",
        "Unless the sentence says that it was left so, its times were shifted and the results are usable.",
        "Synchronise the sensors before the next session.",
    ),
    Meaning(
        "heading drift",
        "headings drifted",
        NOTE,
        "Some sensors slowly turned about the vertical",
        "Magnetic disturbance or the sensors' gyroscopes made them lose their direction over time. The estimate "
        "follows it. "
        "Turning (rotation) about the vertical is less certain than bending, above all late in the recording.",
        "Keep away from iron and motors, and record shorter takes.",
    ),
    Meaning(
        "start not settled",
        "the recording does not settle how",
        DOUBT,
        "How some sensors sat is not settled",
        "Another way of wearing the sensors explains the recording nearly as well. If the supposition is wrong, the "
        "joints beside these sensors are wrong by a large, constant angle.",
        "Compare the motion below with what was done. Repeat the recording with a T- or N-pose held at the start.",
    ),
    Meaning(
        "impossible site",
        "cannot sit as the placement says",
        DOUBT,
        "A sensor cannot sit where it is said to",
        "The list of sensors does not fit what they measured. The joints beside them are not to be relied on.",
        "Check which sensor was on which segment and which way round, correct the list, and reconstruct again.",
    ),
    Meaning(
        "turned on the body",
        "sensors are found turned by more than",
        DOUBT,
        "Many sensors sit otherwise than described",
        "Either they were strapped on differently from the description, or the reconstruction went wrong as a whole.",
        "If they were strapped on as described, do not use these angles: repeat with a pose held at the start.",
    ),
    Meaning(
        "headings not determined",
        "are not determined by the data (standard deviation",
        CARE,
        "The direction of some sensors is only known roughly",
        "Bending of the joints beside them is still known; rotation about the vertical may be off by 15° and more.",
        "Let the camera see hands and toes, or record longer and more varied movement.",
    ),
)

POSTURE_MEANINGS = (
    Meaning(
        "knee backwards",
        "knee bends backwards in",
        DOUBT,
        "A knee bends backwards",
        "Knees hardly do that. The angles of this leg are likely off by a constant amount.",
        "Check that thigh and shank sensors were not exchanged or turned. Compare ranges only, not absolute angles.",
    ),
    Meaning(
        "lying",
        "lies, or bends far over",
        CARE,
        "The body lies or bends far over for most of the time",
        "Right for exercises on the floor. Otherwise the whole body is turned wrongly.",
        "If the person stood or walked, check the sensor on pelvis or trunk and repeat.",
    ),
    Meaning(
        "legs crossed",
        "the legs are crossed in",
        DOUBT,
        "The legs are crossed for much of the time",
        "If they were not, left and right leg sensors may be exchanged, and hip angles are wrong.",
        "Check the left and right sensors.",
    ),
    Meaning(
        "joint limit",
        "does the sensor below it sit as the placement has it",
        CARE,
        "A joint bends further than joints do",
        "The zero of this joint is off. Its range is still of use, its absolute angle is not.",
        "Check how the sensor below it was fixed, and whether the declared pose was held.",
    ),
    Meaning(
        "turned since the start",
        "Do not trust how these bones are turned",
        DOUBT,
        "The motion contradicts how sensors were said to sit",
        "How these bones are turned about themselves is not to be trusted; where their ends are may be.",
        "Check the declared pose, the placement, and whether the sensors stayed where they were.",
    ),
    Meaning(
        "body size",
        "stature and pictures disagree: all lengths together",
        CARE,
        "The height given does not fit the video",
        "Distances (step lengths, positions) are off by this share. Angles suffer little.",
        "Measure the person's height, and check that the camera's zoom is that of its calibration.",
    ),
    Meaning(
        "body lengths",
        "stature and pictures disagree about",
        CARE,
        "Some body segments came out unusually long or short",
        "Either this person is built so, or a sensor sits elsewhere on the segment than described.",
        "Measure the segment with a tape and give its length, or describe where the sensor sat.",
    ),
)

VIDEO_MEANINGS = (
    Meaning(
        "not in the video",
        "no wearer was found in the video",
        CARE,
        "The video could not be used",
        "The motion rests on the sensors alone: where the person was, and which way the body faced, may drift.",
        "See what is said of the video; check that it belongs to this recording.",
    ),
    Meaning(
        "apart",
        "the wearers are not placed relative to one another",
        NOTE,
        "Several people, but nothing ties them together",
        "Each person's angles are usable. Distances between the people are not known; the view sets them side by side.",
        "Film them if how they stand to each other matters.",
    ),
    Meaning(
        "not determined",
        "the data do not determine all headings, mountings and the camera",
        DOUBT,
        "Part of the result is a guess",
        "The recording holds too little movement to tell how all sensors and the camera stood.",
        "Record longer and more varied movement before using the numbers.",
    ),
    Meaning(
        "camera left out",
        "is left out: what it shows does not tell where it was",
        NOTE,
        "A camera was not used",
        "The result rests on the other cameras and the sensors.",
        "Check this camera's file and its calibration.",
    ),
    Meaning(
        "never seen",
        "is never seen: the pose is of the IMUs alone",
        CARE,
        "The camera never saw this person",
        "The angles rest on the sensors alone. Where the person stood among the others is not known.",
        "Place the camera so that the person is seen from head to foot.",
    ),
    Meaning(
        "shortly seen",
        "whoever stood there likewise would do as well",
        CARE,
        "The camera saw this person only briefly",
        "It may be another person in the video who was taken for this one.",
        "Look at the pictures in this report: is it the right person?",
    ),
    Meaning(
        "leap",
        "leaps in the picture at",
        DOUBT,
        "The person jumps in the video from one frame to the next",
        "A cut, a change of zoom, or a stranger in the picture. Around these times the result is not to be relied on.",
        "Cut the recording there and reconstruct the pieces one by one.",
    ),
    Meaning(
        "scatter",
        "the keypoints scatter about the skeleton by",
        DOUBT,
        "The body does not fit the video well",
        "Body and picture are further apart than usual: positions, and rotations about the vertical, may be wrong.",
        "Check that sensors and video run at the same time, the camera's calibration, and the height given.",
    ),
    Meaning(
        "image size",
        "in an image that is calibrated as",
        DOUBT,
        "The points found do not belong to this image size",
        "The video was likely analysed at another resolution than the camera's calibration; positions are wrong.",
        "Give the calibration of the resolution that was analysed, and reconstruct again.",
    ),
    Meaning(
        "video clock off",
        "off what the scene says",
        NOTE,
        "Video and sensors did not start together",
        "The shift was found and put right.",
        "Nothing, if it is small. If it is over 0.1 s, find it first with “vip-factors sync”.",
    ),
    Meaning(
        "video clock drift",
        "drifts from the sensors' by",
        NOTE,
        "Video and sensors run at slightly different speeds",
        "It was found, and the estimate follows it.",
        "Nothing.",
    ),
    Meaning(
        "nobody visible",
        "nobody is visible in any of the",
        CARE,
        "Nobody was found in the video",
        "The video adds nothing: the result rests on the sensors alone.",
        "Check the file of the detections.",
    ),
    Meaning(
        "no common time",
        "the video and the sensors do not overlap in time",
        CARE,
        "Video and sensors are not of the same time",
        "The video adds nothing: the result rests on the sensors alone.",
        "Check the time offset of the camera.",
    ),
    Meaning(
        "few keypoints",
        "are needed to tell who is who",
        CARE,
        "Too few body points in the video",
        "People in the video could not be told apart, so it was not used.",
        "Use a detector that gives hips, knees, ankles and shoulders.",
    ),
    Meaning(
        "never whole",
        "nobody can be compared with that wearer",
        CARE,
        "This person was never seen well enough",
        "Too little of the body is in the picture to recognise the person.",
        "Place the camera so that the person is seen from head to foot.",
    ),
    Meaning(
        "too few to be sure",
        "of them (knees and ankles, elbows and wrists) would tell",
        CARE,
        "This person was not recognised in the video",
        "The few points that were found do not tell who it is; the result rests on the sensors alone.",
        "Use a detector that gives knees and ankles, elbows and wrists.",
    ),
    Meaning(
        "not recognised",
        "but none moves as the sensors of wearer",
        DOUBT,
        "Nobody in the video moves like this person",
        "The person may not be in the picture, or video and sensors do not fit together.",
        "Check the video, its time offset, and which sensor sat where.",
    ),
    Meaning(
        "alike",
        "they cannot be told apart in the video",
        CARE,
        "Two people move alike",
        "They may have been exchanged in the video. Angles suffer little, positions would be exchanged.",
        "Look at the pictures: are the names right? Let one of them move differently at the start.",
    ),
    Meaning(
        "keypoint order",
        "the keypoints fit the wearers much better in another order",
        DOUBT,
        "The body points seem to be named wrongly",
        "Left and right, or whole joints, may be exchanged: do not use the result.",
        "Name the right set of keypoints when converting, and reconstruct again.",
    ),
)

MEANINGS = SENSOR_MEANINGS + POSTURE_MEANINGS + VIDEO_MEANINGS
UNKNOWN = Meaning(
    "other",
    "",
    CARE,
    "Something else was noticed",
    "See the sentence below.",
    "If in doubt, ask who made the recording.",
)


def meaning_of(sentence: str) -> Meaning:
    """What a finding means; :data:`UNKNOWN` of a sentence that no kind knows."""
    return next((one for one in MEANINGS if one.words in sentence), UNKNOWN)
