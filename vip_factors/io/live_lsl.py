"""A fixed-lag tracker's poses as an outlet of the Lab Streaming Layer, beside EEG or force plates.

https://labstreaminglayer.org. Channels are described as XDF's meta-data for motion capture have it.
"""

import os
from collections.abc import Iterator, Mapping

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.io.live_json import ANGLE_NAMES, LiveJsonEncoder, PoseAnswer
from vip_factors.io.settings import SentPose
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.scene import Scene

try:
    import pylsl
except (ImportError, RuntimeError) as error:  # the second: pylsl without the library in C that it calls
    raise InputError(f"the Lab Streaming Layer needs pylsl: pip install 'vip-factors[lsl]' ({error})") from error

CONFIGURATION = "[multicast]\nResolveScope = machine\n[log]\nlevel = -1\n"  # for programs on this machine; warnings
FORGET_S = 60.0  # in which clocks drift by a few milliseconds, and some answer is quick


class LiveLslSink:
    """An outlet for all wearers; samples have the time at which a pose was, on the layer's clock.

    The two clocks are taken to differ by the least that was seen in the last minutes: what is more is delay.

    Args:
        name: of the outlet.
        setup: of the stream.
        rate: frames per second of the tracker.
        pose: which of the poses to send.
    """

    def __init__(self, name: str, setup: Scene, rate: float, pose: SentPose = SentPose.NEWEST) -> None:
        if "LSLAPICFG" not in os.environ:
            pylsl.set_config_content(CONFIGURATION)
        channels = [channel for wearer in setup.wearers for channel in _channels(wearer.subject.name)]
        info = pylsl.StreamInfo(name, "MoCap", len(channels), rate, pylsl.cf_float32, f"{setup.name} {name}")
        description = info.desc().append_child("channels")
        for keys in channels:
            channel = description.append_child("channel")
            for key, value in keys.items():
                channel.append_child_value(key, value)
        self._outlet, self._clock, self._encoder = pylsl.StreamOutlet(info), pylsl.local_clock, LiveJsonEncoder(setup)
        self._pose = pose
        # Seconds from the stream's clock to the layer's: the least so far, of a minute and of the one before it.
        self._least, self._least_before, self._minute = float("inf"), float("inf"), -float("inf")

    def write(self, estimate: LiveEstimate) -> None:
        """Send one sample; none before the first smoothed pose, if that is the one to be sent."""
        if estimate.time - self._minute >= FORGET_S:
            self._least, self._least_before, self._minute = float("inf"), self._least, estimate.time
        self._least = min(self._least, self._clock() - estimate.time)
        poses = [getattr(wearer, self._pose.value) for wearer in self._encoder.answer(estimate).wearers]
        if times := [pose.time for pose in poses if pose is not None]:
            time = times[-1] + min(self._least, self._least_before)
            self._outlet.push_sample([value for pose in poses for value in _values(pose)], time)


def _channels(wearer: str) -> Iterator[Mapping[str, str]]:
    for joint in JOINT_NAMES:
        for kind, axes, unit in (("Position", "XYZ", "meters"), ("Orientation", "WXYZ", "quaternion")):
            for axis in axes:
                label = f"{wearer} {joint} {kind.lower()} {axis.lower()}"
                yield {"label": label, "object": wearer, "marker": joint, "type": kind + axis, "unit": unit}
    for angle in ANGLE_NAMES:
        yield {"label": f"{wearer} {angle}", "object": wearer, "marker": angle, "type": "Angle", "unit": "degrees"}


def _values(pose: PoseAnswer | None) -> list[float]:
    """One wearer's values in the order of the channels; NaN where they are not known."""
    if pose is None:
        return [np.nan] * (7 * len(JOINT_NAMES) + len(ANGLE_NAMES))
    values = [value for joint in pose.joints.values() for value in (*joint.position, *joint.orientation_wxyz)]
    return [np.nan if value is None else value for value in (*values, *pose.angles_deg.values())]
