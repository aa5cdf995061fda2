"""A tracker that knows the answers, for tests of what stands around it; ``python stub_tracker.py FOLDER ARGUMENTS …``
runs the command line with it."""

import sys
from collections.abc import Iterator
from pathlib import Path

from live_answers import answers, live_scene

from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Scene


def tracker_class(scene: Scene) -> type:
    """A stand-in for ``FixedLagTracker``: the truth of a scene, frame by frame as its samples pass."""

    class FixedLagTracker:
        def __init__(self, head: Scene, settings: object, extra_factors: object, real_time: bool) -> None:
            assert [wearer.subject.name for wearer in head.wearers] == [wearer.subject.name for wearer in scene.wearers]
            self.settings = settings
            self._left: Iterator[LiveEstimate] = answers(scene)
            self._next: LiveEstimate | None = next(self._left)

        def push(self, sample: LiveSample) -> list[LiveEstimate]:
            ready = []
            while self._next is not None and self._next.time < sample.time - 1e-6:
                ready.append(self._next)
                self._next = next(self._left, None)
            return ready

        def finish(self) -> list[LiveEstimate]:
            return [self._next] if self._next is not None else []

        def give_up(self) -> None:
            pass

        def note_loss(self) -> None:
            pass

        def note_behind(self, seconds: float) -> None:
            pass

    return FixedLagTracker


def scene_file(folder: Path, seconds: float = 1.0) -> Path:
    write_recording(live_scene(seconds), folder / "scene.mcap")
    return folder / "scene.mcap"


if __name__ == "__main__":
    from vip_factors.cli.main import main
    from vip_factors.live import stream

    stream.FixedLagTracker = tracker_class(read_scene(Path(sys.argv[1])))  # type: ignore[misc]
    sys.exit(main(sys.argv[2:]))
