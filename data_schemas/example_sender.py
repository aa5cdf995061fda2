"""A sender of live messages as JSON over WebSocket: ``python example_sender.py ws://127.0.0.1:5005 [SECONDS]``.

It needs the package websockets alone. Replace ``reading`` by your sensors' driver: the six here stand still, and turn.
"""

import json
import math
import os
import sys
import time

from websockets.sync.client import connect

SENSORS = ("head", "pelvis", "left_forearm", "right_forearm", "left_shank", "right_shank")


def reading(seconds: float) -> dict:
    """Orientation and specific force (m/s², gravity included) of a sensor that turns about the vertical, its z axis."""
    half = 0.25 * math.sin(seconds)
    turn = {"w": math.cos(half), "x": 0, "y": 0, "z": math.sin(half)}
    return {"orientation_wxyz": turn, "specific_force": {"x": 0, "y": 0, "z": 9.81}}


def main(address: str, duration: float = 10.0) -> None:
    """Send the header, then a message a sensor, 60 times a second."""
    token = {"Authorization": f"Bearer {os.environ.get('VIP_FACTORS_TOKEN', '')}"}
    with connect(address, additional_headers=token) as connection:
        wearer = {"subject": {"name": "Ada", "stature_m": 1.75}, "placement": {"preset": "sip6"}}
        connection.send(json.dumps({"header": {"name": "session", "wearers": [wearer]}}))
        begin = time.monotonic()
        while (seconds := time.monotonic() - begin) < duration:
            for sensor in SENSORS:
                connection.send(json.dumps({"imu": {"sensor": sensor, "seconds": seconds, **reading(seconds)}}))
            time.sleep(1 / 60)


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))
