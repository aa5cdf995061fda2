"""From the messages of clients, one after the other, to the samples of one stream."""

import time
from collections.abc import Callable
from dataclasses import replace
from hmac import compare_digest

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.codec import NS_PER_S
from vip_factors.io.live.messages import header_message, imu_sample_of, setup_of, video_frame_of
from vip_factors.io.schemas.live_message_pb2 import LiveHeader, LiveMessage
from vip_factors.sensors.live import LiveFinding, LiveItem, LiveSample
from vip_factors.sensors.scene import Scene

TELL_EVERY = 1.0  # seconds: a person reads them


class Throttle:
    """Keeps one sender's endless mistake from flooding the terminal.

    Args:
        on_finding: gets the findings.
        clock: monotonic seconds.
    """

    def __init__(self, on_finding: Callable[[LiveFinding], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._on_finding = on_finding
        self._clock = clock
        self._reported: dict[str, float] = {}
        self._held: dict[str, tuple[str, int]] = {}

    def report(self, kind: str, sentence: str) -> None:
        """Tell a sentence, or hold it if one of its kind was told less than a second ago."""
        if self._clock() - self._reported.get(kind, -float("inf")) < TELL_EVERY:
            _, times = self._held.get(kind, ("", 0))
            self._held[kind] = (sentence, times + 1)
        else:
            self._say(kind, sentence, self._held.pop(kind, ("", 0))[1])

    def flush(self, every: bool = False) -> None:
        """Tell what has been held for a second, or (with ``every``) all that is held."""
        if not self._held:
            return
        now = self._clock()
        for kind in [kind for kind in self._held if every or now - self._reported[kind] >= TELL_EVERY]:
            sentence, times = self._held.pop(kind)
            self._say(kind, sentence, times - 1)

    def _say(self, kind: str, sentence: str, more: int) -> None:
        self._reported[kind] = self._clock()
        self._on_finding(LiveFinding(f"{sentence} (and {more} more of this kind)" if more else sentence))


LEAST_S = 0.02  # a shorter wait costs more than it spares


class Pace:
    """Counts messages against a rate; a second's worth may come at once.

    Args:
        rate: messages a second.
        clock: monotonic seconds.
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._due = -float("inf")  # when those until now would have come at that rate

    def take(self, messages: int = 1) -> float:
        """Count messages; the seconds to wait before the next are read, 0 if none."""
        now = self._clock()
        self._due = max(self._due, now - 1.0) + messages / self._rate
        return self._due - now if self._due - now >= LEAST_S else 0.0


WRONG_TOKEN_S = 0.5  # that a wrong guess costs


class ClientError(Exception):
    """A client that cannot be listened to any longer; the message is one clause that says why."""


class Session:
    """What the clients of one source share: the set-up of the first, which the others must repeat.

    Args:
        announce: gets the set-up, once.
        put: gets samples and findings.
        token: that every header must have; any if empty.
    """

    def __init__(self, announce: Callable[[Scene], None], put: Callable[[LiveItem], None], token: str = "") -> None:
        self._token = token.encode()
        self._announce = announce
        self.put = put
        self.setup: Scene | None = None
        self._described = b""

    def report(self, sentence: str) -> None:
        """A finding."""
        self.put(LiveFinding(sentence))

    def begin(self, header: LiveHeader) -> int:
        """Take the header of a client; nanoseconds to be taken as its t = 0.

        Raises:
            ClientError: if it has not the token, describes nothing that can be tracked, or something other than the
                first did.
        """
        # In a time that does not depend on how much of it is right; and guessing is slow.
        if self._token and not compare_digest(header.token.encode(), self._token):
            time.sleep(WRONG_TOKEN_S)
            raise ClientError("its header has not the token that is expected here")
        try:
            setup = setup_of(header)
        except InputError as error:
            raise ClientError(f"its header cannot be used: {error}") from error
        if self.setup is None:
            self.setup, self._described = setup, _described(setup)
            self._announce(setup)
        elif _described(setup) != self._described:
            raise ClientError(
                "its header describes other wearers, sensors or cameras than the first client's: start anew for them"
            )
        return setup.start_ns


class Client:
    """One sender's messages, from its header on.

    Args:
        session: that it takes part in.
        name: for findings.
    """

    def __init__(self, session: Session, name: str) -> None:
        self._session = session
        self._name = name
        self._throttle = Throttle(session.put)
        self._start_ns = 0
        self._shift = 0.0  # seconds from this client's clock to the first's
        self.has_header = False
        self.messages = 0

    def take(self, data: bytes) -> None:
        """One serialised LiveMessage; a sample that cannot be used is told and left out.

        Raises:
            FileFormatError: if it is no LiveMessage.
            ClientError: if this client cannot be listened to any longer.
        """
        from google.protobuf.message import DecodeError

        self.flush()
        try:
            message = LiveMessage.FromString(data)
        except DecodeError as error:
            raise FileFormatError(f"{len(data)} bytes are no LiveMessage ({error})") from error
        content = message.WhichOneof("content")
        self.messages += 1
        if content == "header":
            self._header(message.header)
        elif not self.has_header:
            raise ClientError("it sent something else before its header")
        elif content is None:
            self.report("empty", "a message has neither header nor sample: it is left out")
        else:
            try:
                self._session.put(self._sample(message, content))
            except FileFormatError as error:
                self.report(content, str(error))

    def flush(self) -> None:
        """Tell what has been held back for long enough."""
        self._throttle.flush()

    def report(self, kind: str, sentence: str) -> None:
        """A finding about this client; those of one kind at most once a second."""
        self._throttle.report(kind, f"{self._name}: {sentence}")

    def leave(self, sentence: str = "") -> None:
        """The last words about this client."""
        self._throttle.flush(every=True)
        if sentence:
            self._session.report(f"{self._name}: {sentence}")

    def _header(self, header: LiveHeader) -> None:
        if self.has_header:
            self.report("header", "a second header was sent: it is left out; the first one counts")
            return
        self._start_ns = self._session.begin(header)
        self.has_header = True
        setup = self._session.setup
        if setup is not None and setup.start_ns and self._start_ns:
            self._shift = (self._start_ns - setup.start_ns) / NS_PER_S

    def _sample(self, message: LiveMessage, content: str) -> LiveSample:
        setup = self._session.setup
        assert setup is not None  # has_header
        if content == "imu":
            carrier = message.carrier or setup.wearers[0].subject.name
            return _shifted(imu_sample_of(message.imu, carrier, self._start_ns), self._shift)
        name = message.carrier or (setup.camera.name if setup.camera is not None else "")
        camera = next((one for one in setup.cameras if one.name == name), None)
        keypoints = len(camera.keypoints) if camera is not None else None
        frame = video_frame_of(message.detections, name, self._start_ns, keypoints)
        return _shifted(frame, self._shift)


def _described(setup: Scene) -> bytes:
    """A set-up without what may differ between two connections of one session."""
    wearers = tuple(replace(one, start_ns=0) for one in setup.wearers)
    return header_message(replace(setup, name="", wearers=wearers)).SerializeToString(deterministic=True)


def _shifted(sample: LiveSample, seconds: float) -> LiveSample:
    return replace(sample, time=sample.time + seconds) if seconds else sample
