"""What von Marcard's thesis (2019) reports, on TotalCapture and 3DPW: other data sets than ours.

``(MPJPE mm, MPJAE deg)`` by tracker and activity; tables 3.3–3.5 for six sensors, 4.1–4.9 with a camera.
"""

SECONDS_1000_FRAMES_20_ITERATIONS = 450.0  # 3.4.1: MATLAB, one core, six sensors

# By the names of the trackers in vip_variants.py; all over TotalCapture's test sequences.
VARIANTS: dict[str, tuple[float, float]] = {
    "IT": (55.0, 17.5),  # table 4.1; its text says 16.9 deg
    "VIP": (26.0, 12.3),  # table 4.1
    "VIP-IT": (28.2, 12.2),  # table 4.4
    "VIP-vanilla": (45.8, 18.0),
    "VIP-noHeadParam": (25.9, 12.3),  # table 4.5
    "VIP-gtip": (25.3, 12.4),  # table 4.6
    "VIP-gtip-noHeadParam": (26.5, 13.1),
    "VIP-gtip-25": (25.3, 12.4),
    "VIP-gtip-45": (25.2, 12.5),
    "VIP-gtip-25-noHeadParam": (34.5, 15.8),
    "VIP-gtip-45-noHeadParam": (50.3, 20.2),
    "VIP-2D": (15.1, 10.2),  # table 4.7
    "VIP-Cam": (25.3, 12.2),  # table 4.8
    "VIP-6": (35.8, 14.7),  # table 4.9
    "SIP": (52.2, 14.6),
    "SIP-zero": (68.7, 18.6),
    "SOP": (76.2, 19.7),  # table 3.3
}
BY_ACTIVITY: dict[str, dict[str, tuple[float, float]]] = {  # tables 4.2 and 4.3
    "IT": {"walking": (54.5, 15.6), "freestyle": (57.3, 20.5), "acting": (53.2, 16.8), "mean": (55.0, 17.5)},
    "VIP": {"walking": (21.9, 10.5), "freestyle": (32.2, 15.3), "acting": (24.2, 11.2), "mean": (26.0, 12.3)},
}
SPREAD: dict[str, tuple[float, float]] = {"IT": (36.9, 9.8), "VIP": (17.9, 7.9)}  # table 4.1, standard deviations

ASSOCIATION_3DPW = (99.3, 92.2)  # 4.4.3: precision and recall in percent
