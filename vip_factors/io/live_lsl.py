"""A fixed-lag tracker's answers as a Lab Streaming Layer stream, for labs that record them beside EEG or force plates.

Protocol and library: https://labstreaminglayer.org. One outlet for all wearers; channels are named, and described as
XDF's meta-data for motion capture have it (type, unit, object, marker).
"""

import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.io.live.settings import SentPose
from vip_factors.io.live_json import ANGLE_NAMES, LiveJsonEncoder, PoseAnswer
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.scene import Scene

OWN_CONFIGURATION = "LSLAPICFG"  # environment variable by which somebody sets up the library otherwise
# Found by programs on this machine alone; warnings, and what is worse, on stderr.
CONFIGURATION = "[multicast]\nResolveScope = machine\n[log]\nlevel = -1\n"

FORGET_S = 60.0  # in which clocks drift apart by a few milliseconds, and some answer is quick


class LiveLslSink:
    """An outlet; samples have the time at which a pose was, on the layer's clock.

    That clock and the stream's are taken to differ by the least that was seen between them in the last minutes: what is
    more is delay, and clocks drift.

    Args:
        name: of the outlet.
        setup: of the stream.
        rate: frames per second of the tracker.
        pose: which of the poses to send.

    Raises:
        InputError: without the library.
    """

    def __init__(self, name: str, setup: Scene, rate: float, pose: SentPose = SentPose.NEWEST) -> None:
        lsl = checked_lsl()
        if OWN_CONFIGURATION not in os.environ:
            lsl.set_config_content(CONFIGURATION)
        channels = [one for wearer in setup.wearers for one in _channels(wearer.subject.name)]
        info = lsl.StreamInfo(name, "MoCap", len(channels), rate, lsl.cf_float32, f"vip_factors {setup.name} {name}")
        described = info.desc().append_child("channels")
        for keys in channels:
            channel = described.append_child("channel")
            for key, value in keys.items():
                channel.append_child_value(key, value)
        self._outlet = lsl.StreamOutlet(info)
        self._clock: Callable[[], float] = lsl.local_clock
        self._encoder, self._pose = LiveJsonEncoder(setup), pose
        # Seconds from the stream's clock to the layer's: the least so far, of a minute and of the one before it.
        self._least, self._least_before, self._minute = float("inf"), float("inf"), -float("inf")

    def write(self, estimate: LiveEstimate) -> None:
        """Send one sample; none before the first smoothed pose, if that is the one to be sent."""
        if estimate.time - self._minute >= FORGET_S:
            self._least, self._least_before, self._minute = float("inf"), self._least, estimate.time
        self._least = min(self._least, self._clock() - estimate.time)
        sample, time = list[float](), None
        for wearer in self._encoder.encode(estimate)["wearers"]:
            pose = wearer["newest"] if self._pose is SentPose.NEWEST else wearer["smoothed"]
            time = pose["time"] if pose is not None else time
            sample += _values(pose)
        if time is not None:
            self._outlet.push_sample(sample, time + min(self._least, self._least_before))


def checked_lsl() -> Any:
    """The library.

    Raises:
        InputError: if it is not there.
    """
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # the second: pylsl without the library in C that it calls
        raise InputError(
            f"Lab Streaming Layer needs the package pylsl, and its liblsl: pip install 'vip-factors[lsl]' ({error})"
        ) from error
    return pylsl


def _channels(wearer: str) -> Iterator[Mapping[str, str]]:
    """Descriptions of one wearer's channels."""
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
    joints = pose["joints"].values()
    values = [value for joint in joints for value in (*joint["position"], *joint["orientation_wxyz"])]
    return [np.nan if value is None else value for value in (*values, *pose["angles_deg"].values())]
