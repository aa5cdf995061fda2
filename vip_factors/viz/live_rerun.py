"""A stream in Rerun, drawn by a thread beside the tracker, which never waits for it: what cannot be drawn is dropped.

The thread draws what has come within a moment at once, which costs it some milliseconds however much it is. Rerun
itself waits for a viewer that hangs, in the end too; it does so without Python's lock.
"""

from collections import deque
from pathlib import Path
from threading import Event, Thread

import rerun as rr

from vip_factors.atomic import check_partial, partial_file, partial_path
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.viz.live_view import LiveView
from vip_factors.viz.viewer import APPLICATION, complete, open_viewer, write_out

QUEUE_ITEMS = 2400  # 20 s of answers and video frames that may wait


class LiveRerunSink:
    """Drawing of a stream; ``write`` returns at once, always.

    Args:
        setup: of the stream.
        rate: frames per second of the tracker.
        save: ``.rrd`` file, called ``NAME.partial.rrd`` until it is complete.
        connect: URL of a viewer that runs already (``rerun+http://host:9876/proxy``); without both a window is opened.
        overwrite: whether the file may be replaced.

    Attributes:
        dropped: answers that were not drawn.
        lost: one sentence if a file was wanted that was not written; empty until :meth:`close`.

    Raises:
        InputError: if the file exists, or what a killed stream left of one, and may not be overwritten; if there is no
            display for a window.
    """

    def __init__(
        self,
        setup: Scene,
        rate: float = 60.0,
        *,
        save: Path | None = None,
        connect: str | None = None,
        overwrite: bool = False,
    ) -> None:
        self.dropped, self.lost = 0, ""
        self._setup, self._rate, self._save, self._overwrite = setup, rate, save, overwrite
        self._items: deque[LiveEstimate | VideoFrame] = deque()
        self._is_over, self._is_complete = Event(), False
        self._sentences: list[str] = []
        # At the end of a program Rerun would wait for ever for a viewer that hangs: the thread hands over what it can.
        rr.unregister_shutdown()
        self._stream = rr.RecordingStream(APPLICATION)
        if save is not None:
            check_partial(save, overwrite)
        elif connect is not None:
            self._stream.connect_grpc(connect)
        else:
            open_viewer(self._stream, "save or connect", memory="25%")  # the tracker works beside it
        self._thread = Thread(target=self._draw, name="rerun", daemon=True)
        self._thread.start()

    def write(self, estimate: LiveEstimate) -> None:
        """Hand over the answer to one frame, or drop it."""
        if len(self._items) < QUEUE_ITEMS:
            self._items.append(estimate)
        else:
            self.dropped += 1

    def write_video(self, frame: VideoFrame) -> None:
        """Hand over what was seen in a video frame, before the answer to it; or drop it."""
        if len(self._items) < QUEUE_ITEMS:
            self._items.append(frame)

    def findings(self) -> tuple[str, ...]:
        """Sentences about the drawing since the last time."""
        sentences, self._sentences = self._sentences, []
        return tuple(sentences)

    def close(self) -> tuple[str, ...]:
        """Draw what is left, and end; returns the last sentences. A second call does nothing."""
        if self._is_over.is_set():
            return ()
        self._is_over.set()
        patience_s = 180.0 if self._save is not None else 10.0  # a file that is not finished is lost
        self._thread.join(patience_s)
        if self._thread.is_alive():
            self._sentences.append(f"Rerun took nothing for {patience_s:g} s: it has not shown everything")
        if self._save is not None and not self._is_complete:
            partial = partial_path(self._save)
            left = f"; what there is of it is in {partial}" if partial.exists() else ""
            self.lost = f"{self._save}: it was not written whole{left}"
        return self.findings()

    def _draw(self) -> None:
        try:
            if self._save is None:
                self._draw_until_over(None, 0.05)
                self._hand_over()
                return
            with partial_file(self._save, self._overwrite) as partial:
                self._stream.save(partial)
                self._draw_until_over(partial, 1.0)  # the file's index, in memory, has a row for each
                complete(self._stream, partial, self._save)
            self._is_complete = True
        except Exception as error:  # the tracker does not care, the user does
            reason = " ".join(str(error).split()) or type(error).__name__
            self._sentences.append(f"Rerun stopped, tracking goes on without it: {reason}")

    def _draw_until_over(self, partial: Path | None, period_s: float) -> None:
        """Draw what has come, again and again; a file is written out each time: a killed stream loses no more."""
        view, is_over = LiveView(self._stream, self._setup, self._rate), False
        while not is_over:
            is_over = self._is_over.wait(period_s)
            items = [self._items.popleft() for _ in range(len(self._items))]
            if items:
                view.log(items)
            if partial is not None and self._save is not None:
                write_out(self._stream, partial, self._save)

    def _hand_over(self) -> None:
        """Give the viewer what Rerun still holds."""
        try:
            self._stream.flush(timeout_sec=2.0)  # a viewer that was closed takes nothing
        except RuntimeError:
            self._sentences.append("Rerun's viewer was closed, or was never reached: it has not shown everything")
        self._stream.disconnect()
