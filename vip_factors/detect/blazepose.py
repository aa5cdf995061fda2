"""BlazePose, put together: its files, its two models, and the tracker that uses them."""

import os

from vip_factors.detect.interpreter import LiteModel
from vip_factors.detect.landmarks import LandmarkModel
from vip_factors.detect.model_files import BlazePoseFiles
from vip_factors.detect.person_detector import PersonDetector
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.tracks import Tracker

MOST_THREADS = 4  # more gain nothing on models of this size


def usual_threads() -> int:
    """As many as there are processors for us, up to four."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(MOST_THREADS, there)


def blazepose_tracker(files: BlazePoseFiles, settings: DetectSettings, threads: int) -> Tracker:
    """A tracker that finds and follows people with BlazePose.

    Raises:
        InputError: if the library that runs the models is not installed.
        FileFormatError: if a file is no model.
    """
    detector = PersonDetector(LiteModel(files.detector, threads), settings.least_score, settings.box_overlap)
    return Tracker(detector, LandmarkModel(LiteModel(files.landmarks, threads)), settings)
