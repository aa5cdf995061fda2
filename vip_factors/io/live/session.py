"""Messages of one or several senders, turned into the samples of one stream."""

import time
from collections.abc import Callable
from dataclasses import replace
from threading import Lock

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.findings import Finding, FindingLog, bare
from vip_factors.io.codec import NS_PER_S
from vip_factors.io.live.messages import header_message, imu_sample_of, setup_of, video_frame_of
from vip_factors.io.schemas.live_message_pb2 import LiveHeader, LiveMessage
from vip_factors.sensors.live import LiveFinding, LiveItem, LiveSample
from vip_factors.sensors.scene import Scene

REPORT_EVERY_S = 1.0  # seconds between findings of one kind about one sender
CLAIM_S = 1.0  # of samples, which the first answer needs anyway
MOST_HELD = 4096  # samples of a sender that has not claimed the stream
# A header with the skeletons of ten wearers has 30 kB, a frame of fifty people 30 kB: more is a stray length.
LARGEST_MESSAGE = 16 * 1024 * 1024  # bytes


class FindingReporter:
    """Reports problems of a source; sentences of one kind at most once a second, with their number.

    Args:
        put: gets the findings.
    """

    def __init__(self, put: Callable[[LiveItem], None]) -> None:
        self._put = put
        self._log = FindingLog(REPORT_EVERY_S)

    def report(self, kind: str, sentence: str) -> None:
        """Report a sentence, or count it if another of its kind was reported a moment ago."""

        def finding(count: int) -> Finding:
            return bare(f"{sentence} (and {count - 1} more of this kind)" if count > 1 else sentence)

        self._log.tally(kind, time.monotonic(), finding)
        self._put_findings()

    def close(self) -> None:
        """Report what was only counted."""
        self._log.close()
        self._put_findings()

    def _put_findings(self) -> None:
        for finding in self._log.take():
            self._put(LiveFinding(str(finding)))


class ClientError(Exception):
    """A client that cannot be received any longer; the message is one clause with the reason."""


class Session:
    """State shared by the clients of one source: the set-up of the stream, and the client that is received.

    Args:
        announce: gets the set-up, once.
        put: gets samples and findings.
        silence_s: seconds without a message after which a client gives way to the next.
        clock: monotonic seconds.

    Attributes:
        setup: of the stream; None until a client has claimed it.
    """

    def __init__(
        self,
        announce: Callable[[Scene], None],
        put: Callable[[LiveItem], None],
        silence_s: float = float("inf"),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._announce, self.put = announce, put
        self._silence_s, self._clock = silence_s, clock
        self.setup: Scene | None = None
        self._described = b""
        self._lock = Lock()
        self._sender: Client | None = None
        self._received_at = -float("inf")

    def check(self, described: bytes) -> None:
        """Check the description of a set-up.

        Raises:
            ClientError: if it differs from the stream's.
        """
        if self.setup is not None and described != self._described:
            raise ClientError(
                "its header describes other wearers, sensors or cameras than this stream's: start a new stream"
            )

    def claim(self, client: "Client", setup: Scene, described: bytes) -> None:
        """Make this the set-up of the stream and the client its sender, unless another one was first.

        Raises:
            ClientError: if the stream has another set-up.
        """
        with self._lock:
            self.check(described)
            if self.setup is None:
                self._described, self.setup = described, setup
                self._sender, self._received_at = client, self._clock()
                self._announce(setup)

    def admit(self, client: "Client") -> bool:
        """Return whether a client is received: no other sends, or that one has been silent for too long."""
        with self._lock:
            now = self._clock()
            if self._sender not in (None, client) and now - self._received_at < self._silence_s:
                return False
            self._sender, self._received_at = client, now
            return True

    def release(self, client: "Client") -> None:
        """Let the next client send."""
        with self._lock:
            if self._sender is client:
                self._sender = None


class Client:
    """One sender's messages, from its header on.

    Args:
        session: that it takes part in.
        name: for findings.
        claim_s: seconds of samples that it has to send before the stream becomes its own; 0: its header is enough.

    Attributes:
        messages: how many have come.
        takes_part: whether samples of it were used.
        received_at: monotonic seconds of the last one.
    """

    def __init__(self, session: Session, name: str, claim_s: float = 0.0) -> None:
        self._session, self._name, self._claim_s = session, name, claim_s
        self._reporter = FindingReporter(session.put)
        self._setup: Scene | None = None
        self._described = b""
        self._held: list[LiveSample] = []  # until the stream is claimed
        self._span = np.inf, -np.inf  # of their times
        self._shift = 0.0  # seconds from this client's clock to the stream's
        self.messages, self.takes_part = 0, False
        self.received_at = time.monotonic()

    @property
    def has_header(self) -> bool:
        """Is true once a valid header has come."""
        return self._setup is not None

    @property
    def is_to_wait(self) -> bool:
        """Is true while another client is received.

        Raises:
            ClientError: if this one can never be, as the stream has another set-up.
        """
        if self._setup is None or self._session.setup is None:
            return False
        self._session.check(self._described)
        return not self._session.admit(self)

    def take(self, data: bytes | str) -> None:
        """Take one LiveMessage, serialised or as JSON text; leave a sample that cannot be used out and report it.

        Raises:
            ClientError: if this client cannot be received any longer.
            FileFormatError: if it is no LiveMessage.
        """
        from google.protobuf.json_format import Parse, ParseError
        from google.protobuf.message import DecodeError

        try:
            message = Parse(data, LiveMessage()) if isinstance(data, str) else LiveMessage.FromString(data)
        except DecodeError as error:
            raise FileFormatError(f"{len(data)} bytes are no LiveMessage ({error})") from error
        except (ParseError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise FileFormatError(f"a text of {len(data)} characters is no LiveMessage as JSON ({reason})") from error
        content = message.WhichOneof("content")
        self.messages += 1
        self.received_at = time.monotonic()
        if content == "header":
            self._header(message.header)
        elif self._setup is None:
            raise ClientError("it sent something else before its header")
        elif content is None:
            self.report("empty", "a message has neither header nor sample: it is left out")
        else:
            try:
                self._put(self._sample(message, content, self._setup), self._setup)
            except FileFormatError as error:
                self.report(content, str(error))

    def report(self, kind: str, sentence: str) -> None:
        """A finding about this client; those of one kind at most once a second."""
        self._reporter.report(kind, f"{self._name}: {sentence}")

    def leave(self, sentence: str = "") -> None:
        """End the client, with a last sentence about it."""
        self._session.release(self)
        self._reporter.close()
        if sentence:
            self._session.put(LiveFinding(f"{self._name}: {sentence}"))

    def _header(self, header: LiveHeader) -> None:
        if self._setup is not None:
            self.report("header", "a second header was sent: it is left out; the first one counts")
            return
        try:
            setup = setup_of(header)
        except InputError as error:
            raise ClientError(f"its header cannot be used: {error}") from error
        self._described = _described(setup)
        self._session.check(self._described)
        self._setup = setup
        if not self._claim_s:
            self._claim(setup)

    def _put(self, sample: LiveSample, setup: Scene) -> None:
        if self.takes_part:
            self._session.put(replace(sample, time=sample.time + self._shift) if self._shift else sample)
            return
        self._held.append(sample)
        self._span = min(self._span[0], sample.time), max(self._span[1], sample.time)
        is_enough = self._span[1] - self._span[0] >= self._claim_s or len(self._held) >= MOST_HELD
        if is_enough or self._session.setup is not None:
            self._claim(setup)

    def _claim(self, setup: Scene) -> None:
        """Claim the stream, and put the samples that were held."""
        self._session.claim(self, setup, self._described)
        self.takes_part = True
        stream = self._session.setup
        if stream is not None and stream.start_ns and setup.start_ns:
            self._shift = (setup.start_ns - stream.start_ns) / NS_PER_S
        for sample in self._held:
            self._put(sample, setup)
        self._held.clear()

    def _sample(self, message: LiveMessage, content: str, setup: Scene) -> LiveSample:
        if content == "imu":
            carrier = message.carrier or setup.wearers[0].subject.name
            return imu_sample_of(message.imu, carrier, setup.start_ns)
        name = message.carrier or (setup.camera.name if setup.camera is not None else "")
        camera = next((camera for camera in setup.cameras if camera.name == name), None)
        keypoints = len(camera.keypoints) if camera is not None else None
        return video_frame_of(message.detections, name, setup.start_ns, keypoints)


def _described(setup: Scene) -> bytes:
    """Serialised set-up, without values that may differ between two connections of one session."""
    wearers = tuple(replace(wearer, start_ns=0) for wearer in setup.wearers)
    return header_message(replace(setup, name="", wearers=wearers)).SerializeToString(deterministic=True)
