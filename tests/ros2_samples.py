"""Recordings of ROS 2 with sensor_msgs/msg/Imu, by mcap_ros2's own writer."""

from pathlib import Path
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer

LINE = "=" * 80
DEFINITION = f"""std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{LINE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{LINE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
START_NS = 1_700_000_000_000_000_001
STEP_NS = 10_000_000


def imu(i: int, frame_id: str = "pelvis", **changes: Any) -> dict[str, Any]:
    sec, nanosec = divmod(START_NS + i * STEP_NS, 1_000_000_000)
    return {
        "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id},
        "orientation": {"x": 0.0, "y": 0.0, "z": np.sin(0.05 * i), "w": np.cos(0.05 * i)},
        "orientation_covariance": [0.0] * 9,
        "angular_velocity": {"x": 1.0, "y": 2.0, "z": i},
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": {"x": 0.5, "y": 0.25 * i, "z": 9.81},
        "linear_acceleration_covariance": [0.0] * 9,
        **changes,
    }


def write_ros2(path: Path, topics: dict[str, list[dict[str, Any]]]) -> Path:
    with open(path, "wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", DEFINITION)
        for topic, messages in topics.items():
            for i, message in enumerate(messages):
                writer.write_message(topic, schema, message, log_time=START_NS + 5 + i * STEP_NS)
    return path
