"""What a stretch showed to be wrong with sensors, put right in all of a long recording."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings
from vip_factors.stages.sensor_checks import checked


@dataclass(frozen=True)
class SensorCorrections:
    """Of one wearer's sensors, by name; those that are not named are right.

    Attributes:
        seconds: to be added to times.
        scale: that specific force is to be multiplied by.
    """

    seconds: Mapping[str, float]
    scale: Mapping[str, float]

    @classmethod
    def between(cls, before: Recording, after: Recording) -> "SensorCorrections":
        """What was done to a recording where it was :func:`~vip_factors.stages.sensor_checks.checked`."""
        seconds, scale = dict[str, float](), dict[str, float]()
        for name, stream in after.imus.items():
            was = before.imus[name]
            if stream.time[0] != was.time[0]:
                seconds[name] = float(stream.time[0] - was.time[0])
            if stream.specific_force is not None and was.specific_force is not None:
                most = np.unravel_index(np.nanargmax(np.abs(was.specific_force)), was.specific_force.shape)
                if stream.specific_force[most] != was.specific_force[most]:
                    scale[name] = float(stream.specific_force[most] / was.specific_force[most])
        return cls(seconds, scale)

    def applied(self, recording: Recording, settings: Settings) -> tuple[Recording, tuple[str, ...]]:
        """Another stretch put right; in it accelerometers are looked over by themselves, and sentences say what for."""
        imus = {name: self._corrected(stream) for name, stream in recording.imus.items()}
        clocks = replace(settings.sensor_clocks, check=False)
        return checked(replace(recording, imus=imus), replace(settings, sensor_clocks=clocks))

    def _corrected(self, stream: ImuStream) -> ImuStream:
        stream = replace(stream, time=stream.time + self.seconds.get(stream.name, 0.0))
        if stream.specific_force is None or stream.name not in self.scale:
            return stream
        return replace(stream, specific_force=stream.specific_force * self.scale[stream.name])
