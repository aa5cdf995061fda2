"""The program ``vip-factors stream`` as a user runs it: a process of its own, samples over the loopback in real time,
lines of JSON read from its output."""

import json
import socket
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from threading import Thread
from typing import IO, Any

from vip_factors.errors import VipFactorsError
from vip_factors.io.live.messages import delimited, header_message, sample_message
from vip_factors.sensors.live import LiveSample, VideoFrame
from vip_factors.sensors.scene import Scene

COMMAND = (sys.executable, "-m", "vip_factors.cli.main")
SOURCE = "tcp://127.0.0.1:0"  # a free port, which the program tells
START_S = 120.0  # that it may take to listen
END_S = 600.0  # and to complete its files: Rerun's file has three minutes by itself
LAST_LINES = 200  # of what it says that are kept
Take = Callable[[dict[str, Any], float], None]


class StreamProgram:
    """Runs the program and feeds it; a context manager, which kills what is still there.

    Args:
        options: of ``vip-factors stream``, after its source.
        take: gets each line of JSON as an object, and its age: seconds since the newest sample that it answers was
            due to be sent. Called from another thread.
        command: that runs ``vip-factors``.

    Attributes:
        said: its last lines on stderr.
        latest_s: by how much the sender was behind its own schedule at most, seconds.
    """

    def __init__(self, options: Sequence[str], take: Take, command: Sequence[str] = COMMAND) -> None:
        self._arguments = [*command, "stream", SOURCE, *options, "--json", "--limits.next-client-wait", "0"]
        self._take = take
        self._begun = float("nan")
        self.said: deque[str] = deque(maxlen=LAST_LINES)
        self.latest_s = 0.0

    def __enter__(self) -> "StreamProgram":
        self._process = subprocess.Popen(
            self._arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL
        )
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        self._readers = [
            Thread(target=self._listen, args=(self._process.stderr,), daemon=True),
            Thread(target=self._read, args=(self._process.stdout,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def send(self, setup: Scene, samples: Iterable[LiveSample]) -> Iterator[float]:
        """Send the header, and each sample when it is due; yields its time."""
        frames: Counter[str] = Counter()
        try:
            with socket.create_connection(("127.0.0.1", self._port()), timeout=START_S) as connection:
                connection.sendall(delimited(header_message(setup).SerializeToString()))
                self._begun = time.monotonic()
                for sample in samples:
                    number = 0
                    if isinstance(sample, VideoFrame):
                        number = frames[sample.camera]
                        frames[sample.camera] += 1
                    data = delimited(sample_message(sample, setup.start_ns, number).SerializeToString())
                    late = time.monotonic() - self._begun - sample.time
                    if late < 0:
                        time.sleep(-late)
                    self.latest_s = max(self.latest_s, late)
                    connection.sendall(data)
                    yield sample.time
        except OSError as error:
            raise VipFactorsError(f"the stream has hung up: {error}; it said: {self._last}") from error

    def end(self) -> int:
        """Its exit code, once it has ended."""
        try:
            code = self._process.wait(END_S)
        except subprocess.TimeoutExpired as error:
            raise VipFactorsError(f"the stream did not end within {END_S:g} s; it said: {self._last}") from error
        for reader in self._readers:
            reader.join()
        return code

    @property
    def _last(self) -> str:
        return self.said[-1] if self.said else "nothing"

    def _port(self) -> int:
        until = time.monotonic() + START_S
        while time.monotonic() < until and self._process.poll() is None:
            for line in list(self.said):
                _, here, address = line.partition("listening at tcp://127.0.0.1:")
                if here:
                    return int(address.partition(",")[0])
            time.sleep(0.05)
        raise VipFactorsError(f"the stream did not begin to listen; it said: {self._last}")

    def _listen(self, stream: IO[bytes]) -> None:
        for line in stream:
            self.said.append(line.decode(errors="replace").rstrip())

    def _read(self, stream: IO[bytes]) -> None:
        for line in stream:
            now = time.monotonic()
            answer = json.loads(line)
            self._take(answer, now - self._begun - answer["time"])
