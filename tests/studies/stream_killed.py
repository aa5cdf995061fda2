"""How much of an estimate file is left when the program that writes it is killed."""

import multiprocessing
import pickle
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

from vip_factors.io.live_mcap import LiveMcapSink, partial_path
from vip_factors.io.mcap_contents import McapWarning
from vip_factors.io.mcap_scene_estimate import read_scene_estimate
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSetup

PACED_S = 2.0  # before the end, in which answers are written as fast as they would come
PATIENCE_S = 60.0  # for a process to start and write


@dataclass(frozen=True)
class Killed:
    """What a killed program left.

    Attributes:
        written_s: time of the last smoothed pose that was handed to the file.
        left_s: time of the last one that can be read.
        readable: frames.
    """

    written_s: float
    left_s: float
    readable: int

    @property
    def lost_s(self) -> float:
        """What was lost."""
        return self.written_s - self.left_s


def kill_while_writing(answers: Sequence[LiveEstimate], setup: LiveSetup, rate: float, until: float) -> Killed | None:
    """Write answers up to a time in a process of their own, kill it without a warning, and read what it left.

    Args:
        answers: of a tracker.
        setup: of the stream.
        rate: frames per second.
        until: seconds of the stream.

    Returns:
        What was left; None if the process ended by itself.
    """
    first = [one for one in answers if one.time <= until]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "estimate.mcap"
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=_write, args=(pickle.dumps((first, setup, rate)), str(path), there))
        process.start()
        try:
            written = here.poll(PATIENCE_S) and here.recv()
        finally:
            process.kill()
            process.join()
        if not written:
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", McapWarning)  # that it was cut off: it was
            motion = read_scene_estimate(partial_path(path)).wearers[0].motion
    late = next(one.wearers[0].smoothed for one in reversed(first) if one.wearers[0].smoothed is not None)
    return Killed(late.time, float(motion.time[-1]), len(motion))


def _write(content: bytes, path: str, done: Connection) -> None:
    """In the other process: write all answers, the last ones at their own pace, say so, and wait for the end."""
    answers, setup, rate = pickle.loads(content)
    sink = LiveMcapSink(path, setup, rate)
    for answer in answers:
        if answer.time > answers[-1].time - PACED_S:
            time.sleep(1 / rate)
        sink.write(answer)
    done.send(True)
    time.sleep(PATIENCE_S)
