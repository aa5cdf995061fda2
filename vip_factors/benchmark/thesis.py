"""What von Marcard's thesis (2019) reports for six sensors, on TotalCapture: another data set than ours.

``(MPJPE mm, MPJAE deg)`` by tracker and activity; tables 3.3–3.5, and 4.9 for the start from a zero pose.
"""

TRUE_POSE: dict[str, dict[str, tuple[float, float]]] = {
    "SOP": {"walking": (55.3, 15.7), "freestyle": (104.1, 25.8), "acting": (71.3, 18.0), "mean": (76.2, 19.7)},
    "SIP": {"walking": (34.7, 11.1), "freestyle": (71.9, 19.2), "acting": (51.8, 14.0), "mean": (52.2, 14.6)},
}
ZERO_POSE: dict[str, dict[str, tuple[float, float]]] = {"SIP": {"mean": (68.7, 18.6)}}

SECONDS_1000_FRAMES_20_ITERATIONS = 450.0  # 3.4.1: MATLAB, one core, six sensors
