"""Live Rerun in a process of its own: the tracker holds the interpreter for whole updates, and must never wait.

Answers go through a bounded queue; when it is full they are dropped. Whatever happens to the viewer, the tracker goes
on. Nothing of Rerun is imported in the tracker's process.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, Full
from typing import TYPE_CHECKING, Any

from vip_factors.atomic import check_partial, partial_file, partial_path
from vip_factors.live_estimate import LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.scene import Scene
from vip_factors.viz.viewer import QUIET, complete, grpc_server, hand_over, rerun_command

if TYPE_CHECKING:
    import rerun as rr

APPLICATION = "vip_factors"
QUEUE_ITEMS = 240  # two seconds of answers and video frames: a viewer that starts slowly loses nothing that matters
# What comes within it is logged together, at a fraction of the cost and size: the eye does not see the one, and
# nobody waits for a file.
GATHER_S, GATHER_FOR_FILE_S = 0.03, 0.5
IN_FULL_EVERY = 6  # answers: calibrations and covariances in between are left out, they are most of the bytes
VIEWER_MEMORY = "25%"  # of the machine's: the tracker works beside it; then the viewer forgets the oldest
# Seconds that the process may take to draw what is left; a file that is not finished is lost.
END_S, END_FOR_FILE_S = 20.0, 180.0
FILE_ITEMS = 20_000  # that may wait for a process that writes a file: five minutes, which a viewer should never lag
KEEP_S = 1.0  # seconds of drawing after which a file is written out: what a killed stream may cost
FLUSH_S = 2.0  # seconds that Rerun may take to hand over the last: a viewer that was closed takes nothing
POLITE = 10  # of niceness: on a core that is shared the tracker comes first, and drawing waits
ENDING = (signal.SIGINT, signal.SIGTERM)
ENDED = "the viewer's process has ended; tracking goes on without it"


@dataclass(frozen=True)
class LiveTarget:
    """Where the drawing goes; one of them.

    Attributes:
        save: ``.rrd`` file, called ``NAME.partial.rrd`` until it is complete.
        overwrite: whether it may be replaced.
        connect: URL of a viewer that runs already (``rerun+http://host:9876/proxy``).
        serve: port on which viewers may connect.
        host: address to serve at.

    With none of them the viewer is started.
    """

    save: Path | None = None
    overwrite: bool = False
    connect: str | None = None
    serve: int | None = None
    host: str = "127.0.0.1"


class LiveRerunSink:
    """Shows a stream; ``write`` returns at once, always.

    Args:
        setup: of the stream.
        target: where to draw.
        rate: frames per second of the tracker.
        queue_items: that may wait before some are dropped; more by default if they go to a file.

    Attributes:
        dropped: answers that the viewer never got.
        lost: one sentence if a file was wanted that was not written; empty until :meth:`close`.

    Raises:
        InputError: if the file exists, or what a killed stream left of one, and may not be overwritten.
    """

    def __init__(
        self, setup: Scene, target: LiveTarget | None = None, rate: float = 60.0, queue_items: int | None = None
    ) -> None:
        # A new interpreter: a fork would take the tracker's threads and locks along.
        context = multiprocessing.get_context("spawn")
        self.dropped = 0
        self.lost = ""
        self._written = 0
        self._ended = False
        self._save = target.save if target is not None else None
        if self._save is not None and target is not None:
            check_partial(self._save, target.overwrite)
        to_file = self._save is not None
        self._end_s = END_FOR_FILE_S if to_file else END_S
        self._queue: Any = context.Queue(queue_items or (FILE_ITEMS if to_file else QUEUE_ITEMS))
        self._told, telling = context.Pipe(duplex=False)
        arguments = (self._queue, telling, setup, target or LiveTarget(), rate)
        self._process = context.Process(target=draw, args=arguments, name="viewer", daemon=True)
        with _signals_held():
            self._process.start()
        telling.close()

    def write(self, estimate: LiveEstimate) -> None:
        """Hand over the answer to one frame, or drop it."""
        if not self._put(estimate if self._written % IN_FULL_EVERY == 0 else _slim(estimate)):
            self.dropped += 1
        self._written += 1

    def write_video(self, frame: VideoFrame) -> None:
        """Hand over what was seen in a video frame, before the answer to it; or drop it."""
        self._put(frame)

    def findings(self) -> tuple[str, ...]:
        """What the viewer's process has to say since the last time."""
        sentences = []
        try:
            while self._told.poll():
                sentences.append(str(self._told.recv()))
        except (EOFError, OSError):  # the process has ended
            if not self._ended:
                self._ended = True
                sentences.append(ENDED)
        return tuple(sentences)

    def close(self) -> tuple[str, ...]:
        """Let the process draw what is left, and end it; returns what it had to say. A second call does nothing."""
        if self._queue is None:
            return ()
        try:
            if not self._ended:
                with suppress(Full):  # nobody takes anything out: it is ended below
                    self._queue.put(None, timeout=self._end_s / 4)
            self._process.join(self._end_s if not self._ended else 0.1)
        except BaseException:  # a second Ctrl-C
            self._process.kill()
            raise
        told = tuple(one for one in self.findings() if one != ENDED)  # tracking does not go on either
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
            told = (*told, f"the viewer's process did not end within {self._end_s:g} s and was stopped")
        if self._save is not None and self._process.exitcode != 0:
            self.lost = _lost(self._save)
        self._queue.cancel_join_thread()  # what nobody will take out must not hold up the program
        self._queue.close()
        self._queue, self._ended = None, True
        return told

    def _put(self, item: LiveEstimate | VideoFrame) -> bool:
        if self._ended or self._queue is None:
            return False
        try:
            self._queue.put_nowait(item)
        except Full:
            return False
        return True


@contextmanager
def _signals_held() -> Iterator[None]:
    """Ctrl-C and SIGTERM, which reach a whole group of processes, wait until they are ignored by the new one."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _lost(path: Path) -> str:
    partial = partial_path(path)
    left = f"; what there is of it is in {partial}" if partial.exists() else ""
    return f"{path}: it was not written whole, as the process that wrote it failed or was ended{left}"


def _slim(estimate: LiveEstimate) -> LiveEstimate:
    """Without what may be left out in most frames."""

    def bare(pose: LivePose) -> LivePose:
        return replace(pose, joint_covariance=None, root_covariance=None)

    def thin(wearer: LiveWearerEstimate) -> LiveWearerEstimate:
        smoothed = bare(wearer.smoothed) if wearer.smoothed is not None else None
        return replace(wearer, newest=bare(wearer.newest), smoothed=smoothed, calibration={})

    return replace(estimate, wearers=tuple(thin(one) for one in estimate.wearers))


def draw(queue: Any, telling: Connection, setup: Scene, target: LiveTarget, rate: float) -> None:
    """The other process: draws what comes until None comes, or the tracker's process is gone."""
    for one in ENDING:
        signal.signal(one, signal.SIG_IGN)  # for the tracker, which says when it is over
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    if hasattr(os, "nice"):
        os.nice(POLITE)
    os.environ.setdefault("RUST_LOG", "off")  # Rerun's complaints about a closed viewer, line after line
    os.environ.update(QUIET)
    queue._writer.close()  # the tracker's own is the only one: else half an item of a killed tracker would never end
    from vip_factors.viz.live_view import LiveView

    try:
        with ExitStack() as files:
            stream = _open(target, files, telling)
            view = LiveView(stream, setup, rate)
            gather = GATHER_S if target.save is None else GATHER_FOR_FILE_S
            kept = time.monotonic()
            for items in _gathered(queue, gather):
                view.log(items)
                if target.save is not None and time.monotonic() - kept >= KEEP_S:
                    hand_over(stream, partial_path(target.save), target.save)
                    kept = time.monotonic()
            _end(stream, target, telling)
    except OSError as error:  # of a full disk, most likely: Rerun's own threads would wait for ever
        telling.send(f"the viewer stopped: {error.filename}: {error.strerror}")
        os._exit(1)
    except Exception as error:  # told where the user looks; the tracker does not care
        telling.send(f"the viewer stopped: {type(error).__name__}: {' '.join(str(error).split())}")
        os._exit(1)
    finally:
        telling.close()


def _open(target: LiveTarget, files: ExitStack, telling: Connection) -> "rr.RecordingStream":
    import rerun as rr

    stream = rr.RecordingStream(APPLICATION)
    if target.save is not None:
        stream.save(files.enter_context(partial_file(target.save, target.overwrite)))
    elif target.connect is not None:
        stream.connect_grpc(target.connect)
    elif target.serve is not None:
        url = files.enter_context(grpc_server(target.host, target.serve))
        stream.connect_grpc(url)
        telling.send(f"viewers may connect: rerun {url}")
    else:
        rr.spawn(memory_limit=VIEWER_MEMORY, executable_path=rerun_command(), recording=stream)
    return stream


def _end(stream: "rr.RecordingStream", target: LiveTarget, telling: Connection) -> None:
    """What Rerun still holds."""
    if target.save is not None:
        complete(stream, partial_path(target.save), target.save)
        parent = multiprocessing.parent_process()
        if parent is not None and not parent.is_alive():
            os._exit(1)  # a killed stream's file keeps its partial name, whole as it is
        return
    try:
        stream.flush(timeout_sec=FLUSH_S)
    except RuntimeError:
        telling.send("Rerun's viewer was closed, or was never reached: it has not shown everything")
    stream.disconnect()


def _gathered(queue: Any, seconds: float) -> Iterator[list[LiveEstimate | VideoFrame]]:
    """What comes within some time of the first, until None comes or the tracker's process is gone."""
    is_over = False
    while not is_over:
        items: list[LiveEstimate | VideoFrame] = []
        until = None
        while not is_over and (until is None or time.monotonic() < until):
            try:
                # Taken out all the time, not at its end: what the pipe between the processes holds is 64 KiB.
                item = queue.get(timeout=until and max(until - time.monotonic(), 0.0))
            except Empty:
                break
            except (EOFError, OSError):  # killed, perhaps in the midst of an item
                item = None
                if (parent := multiprocessing.parent_process()) is not None:
                    parent.join(1.0)  # its pipes end one after the other
            if item is None:
                is_over = True
            else:
                items.append(item)
                until = until or time.monotonic() + seconds
        if items:
            yield items
