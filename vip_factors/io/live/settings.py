"""What is set of live sources and sinks. Apart from what uses it: the command line shows it without NumPy."""

from dataclasses import dataclass
from enum import StrEnum

from vip_factors.ranges import RangeError

MIB = 1024 * 1024
POSITIVE = (
    "header_wait", "message_wait", "largest_rate", "clients", "largest_message", "largest_chunk", "queue_limit",
    "growth_wait",
)  # fmt: skip


class VmcPose(StrEnum):
    """Which pose is sent: that of the newest frame, or the one a lag earlier that changes no more."""

    NEWEST = "newest"
    SMOOTHED = "smoothed"


@dataclass(frozen=True)
class LiveSourceSettings:
    """Limits of a live source.

    Attributes:
        header_wait: seconds that a client may take for its header: a program that has it ready sends it at once, ten
            seconds forgive a slow start.
        message_wait: seconds from a message's first byte to its last, of senders over the network: the largest in use
            crosses a bad radio link in one.
        largest_rate: messages a second that are read of a sender over the network, after the first second's; whoever
            sends more has to wait, and the tracker keeps its processor. Three wearers of 17 sensors at 100 Hz send
            5,100.
        clients: that may be connected over WebSocket at once, the one that is heard among them; over TCP the others
            wait unheard until it has gone.
        largest_message: bytes; a header with the skeletons of ten wearers has 30 kB, a frame of fifty people 30 kB, so
            16 MiB is a stray length, not a message.
        largest_chunk: bytes of one chunk of an MCAP file, packed or not; recorders close chunks at 1 to 4 MB, those
            with images in them at a few more.
        queue_limit: samples that wait for the tracker before some are dropped; two wearers of 13 sensors at 100 Hz
            send 2,600 a second, so that a start-up of a second and a half loses nothing.
        growth_wait: seconds without growth after which a file counts as finished; recorders flush several times a
            second, a minute of slack for the operating system would only delay the end.
        next_client_wait: seconds that a server waits for another client after one that had sent its header has gone,
            or that a lost sender is tried again; infinite: until Ctrl-C.
    """

    header_wait: float = 10.0
    message_wait: float = 10.0
    largest_rate: float = 10_000.0
    clients: int = 8
    largest_message: int = 16 * MIB
    largest_chunk: int = 64 * MIB
    queue_limit: int = 4096
    growth_wait: float = 10.0
    next_client_wait: float = float("inf")

    def __post_init__(self) -> None:
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise RangeError(f"limits.{name}", f"is {getattr(self, name)}: expected a positive number")
        if not self.next_client_wait >= 0:
            raise RangeError("limits.next_client_wait", f"is {self.next_client_wait}: expected 0 seconds or more")


DEFAULT = LiveSourceSettings()
