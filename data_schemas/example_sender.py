"""A sender of live messages as JSON over WebSocket: ``python example_sender.py ws://127.0.0.1:5005 [SECONDS]``.

It needs only the package websockets. Replace ``reading`` by your sensors' driver: here somebody stands with hanging
arms for a second, then bends elbows and knees in turn, nods, and turns about a little.
"""

import json
import math
import os
import random
import sys
import time

from websockets.sync.client import connect

# Each sensor is fixed to a limb that swings about the axis to the wearer's left.
# Largest angle in radians (positive: the lower end moves backwards), swings a second, metres below the joint above.
SENSORS = {
    "head": (0.3, 0.3, -0.15),
    "pelvis": (0.04, 0.2, 0.0),
    "left_forearm": (-1.2, 0.45, 0.2),
    "right_forearm": (-1.0, 0.6, 0.2),
    "left_shank": (0.9, 0.4, 0.15),
    "right_shank": (0.7, 0.5, 0.15),
}


def swing(sensor: str, seconds: float) -> float:
    """The angle of a limb, radians: 0 in the first second."""
    most, frequency, _ = SENSORS[sensor]
    return most * math.sin(math.pi * frequency * max(0.0, seconds - 1.0)) ** 2


def reading(sensor: str, seconds: float) -> dict:
    """Orientation and specific force (m/s², gravity included) of a sensor whose x axis is left, y up along the limb."""
    step, metres = 0.01, SENSORS[sensor][2]
    before, angle, after = (swing(sensor, seconds + offset) for offset in (-step, 0.0, step))
    speed, acceleration = (after - before) / (2 * step), (after - 2 * angle + before) / step**2
    force_y = 9.81 * math.cos(angle) + metres * speed**2
    force_z = -9.81 * math.sin(angle) - metres * acceleration
    force = [value + random.gauss(0.0, 0.05) for value in (0.0, force_y, force_z)]
    tilt, heading = (math.pi / 2 + angle) / 2, 0.2 * math.sin(0.5 * max(0.0, seconds - 1.0))  # half angles
    w, x = math.cos(heading) * math.cos(tilt), math.cos(heading) * math.sin(tilt)
    y, z = math.sin(heading) * math.sin(tilt), math.sin(heading) * math.cos(tilt)
    return {
        "orientation_wxyz": {"w": w, "x": x, "y": y, "z": z},
        "specific_force": dict(zip("xyz", force, strict=True)),
    }


def main(address: str, duration: float = 10.0) -> None:
    """Send the header, then a message a sensor, 60 times a second."""
    token = {"Authorization": f"Bearer {os.environ.get('VIP_FACTORS_TOKEN', '')}"}
    with connect(address, additional_headers=token) as connection:
        subject, placement = {"name": "Ada", "stature_m": 1.75}, {"preset": "sip6"}
        wearer = {"subject": subject, "placement": placement, "initial_pose": "n-pose"}
        connection.send(json.dumps({"header": {"name": "session", "wearers": [wearer]}}))
        begin = time.monotonic()
        while (seconds := time.monotonic() - begin) < duration:
            for sensor in SENSORS:
                imu = {"sensor": sensor, "seconds": seconds, **reading(sensor, seconds)}
                connection.send(json.dumps({"imu": imu}))
            time.sleep(1 / 60)


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))
