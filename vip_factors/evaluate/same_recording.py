"""Is the truth that of the recording which an estimate was made from? Names, times and sensors tell."""

from collections.abc import Iterator

from vip_factors.estimate import SceneEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

LITTLE = 0.9  # of the estimate's time: a truth that begins late or ends early has more
SAME_START_S = 60.0  # clocks of computers that record together differ by less


def doubts(estimate: SceneEstimate, scene: Scene, start_ns: int = 0) -> str:
    """What speaks against it, as one sentence; empty if nothing does.

    Args:
        estimate: what was made.
        scene: the recording with the truth.
        start_ns: absolute time of the estimate's t = 0; 0 if not known.
    """
    found = [*_of_names(estimate, scene), *_of_starts(scene, start_ns)]
    for one, wearer in zip(estimate.wearers, scene.wearers, strict=False):
        who = f" of {wearer.subject.name}" if len(scene.wearers) > 1 else ""
        strange = sorted(set(one.sensors) - set(wearer.imus)) if wearer.imus else []
        if strange:
            found.append(
                f"{len(strange)} of the {len(one.sensors)} sensors{who} are none of the other's: {strange[0]} …"
            )
        if wearer.truth is not None and len(one.motion) and len(wearer.truth.motion):
            found += _of_times(one.motion.time, wearer)
    return f"is this the truth of the same recording? {'; '.join(found)}" if found else ""


def _of_names(estimate: SceneEstimate, scene: Scene) -> Iterator[str]:
    names = {scene.name, *(wearer.name for wearer in scene.wearers)}
    if not names & {estimate.name, *(one.name for one in estimate.wearers)}:
        yield f"the estimate is of '{estimate.name}', the truth of '{scene.name}'"


def _of_starts(scene: Scene, start_ns: int) -> Iterator[str]:
    begins = scene.wearers[0].start_ns
    apart = abs(start_ns - begins) / 1e9
    if start_ns and begins and apart > SAME_START_S:
        yield f"they begin {apart:.0f} s apart"


def _of_times(time: Array, wearer: Recording) -> Iterator[str]:
    assert wearer.truth is not None
    truth = wearer.truth.motion.time
    common, whole = min(time[-1], truth[-1]) - max(time[0], truth[0]), time[-1] - time[0]
    if common < LITTLE * whole:
        yield f"of {whole:.1f} s of the estimate the truth covers {max(common, 0.0):.1f} s"
