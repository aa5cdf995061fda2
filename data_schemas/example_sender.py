"""A sender of live messages: a simulated wearer of six sensors, over WebSocket.

Run as ``python example_sender.py ws://127.0.0.1:5005``, with the receiver's token, if it has one, in VIP_FACTORS_TOKEN.
"""

import os
import sys
import time

from websockets.sync.client import connect

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.schemas.live_message_pb2 import LiveMessage
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import live_samples
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording


def main(address: str, seconds: float = 5.0) -> None:
    """Send the header, then every sample when it is due."""
    body = skeleton_from_stature(1.75)
    recording = simulate_recording(gestures(seconds, 60.0, body), preset("sip6", body))  # your sensors' driver
    token = {"Authorization": f"Bearer {os.environ.get('VIP_FACTORS_TOKEN', '')}"}
    with connect(address, additional_headers=token, compression=None) as connection:
        header = LiveMessage()
        header.header.name = "simulated"
        wearer = header.header.wearers.add(initial_pose="none")
        wearer.subject.name, wearer.subject.stature_m = "Ada", 1.75
        wearer.placement.preset = "sip6"  # sensors: head, pelvis, left_forearm, right_forearm, left_shank, right_shank
        connection.send(header.SerializeToString())
        begun = time.monotonic()
        for sample in live_samples(Scene("simulated", (recording,))):
            message = LiveMessage(carrier="Ada")
            message.imu.sensor, message.imu.seconds = sample.sensor, sample.time
            turn, force = message.imu.orientation_wxyz, message.imu.specific_force
            turn.w, turn.x, turn.y, turn.z = quaternion_from_matrix(sample.R_inertial_sensor, Order.WXYZ)
            force.x, force.y, force.z = sample.specific_force
            time.sleep(max(0.0, begun + sample.time - time.monotonic()))
            connection.send(message.SerializeToString())


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))
