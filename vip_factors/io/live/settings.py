"""What is set of live sources and sinks. Apart from what uses it: the command line shows it without NumPy."""

from dataclasses import dataclass
from enum import StrEnum

from vip_factors.ranges import RangeError

MIB = 1024 * 1024
POSITIVE = (
    "header_wait",
    "message_wait",
    "largest_rate",
    "largest_message",
    "largest_chunk",
    "queue_limit",
    "growth_wait",
)


class SentPose(StrEnum):
    """Which pose is sent: that of the newest frame, or the one a lag earlier that changes no more."""

    NEWEST = "newest"
    SMOOTHED = "smoothed"


@dataclass(frozen=True)
class LiveSourceSettings:
    """Limits of a live source.

    Attributes:
        header_wait: seconds that a client may take for its header.
        message_wait: seconds from a message's first byte to its last, of senders over the network.
        largest_rate: messages a second that are read of a sender over the network, after the first second's; whoever
            sends more has to wait, and the tracker keeps its processor.
        largest_message: bytes.
        largest_chunk: bytes of one chunk of an MCAP file, packed or not.
        queue_limit: samples that wait for the tracker before some are dropped.
        growth_wait: seconds without growth after which a file counts as finished.
        next_client_wait: seconds that a server waits for another client after one that had sent its header has gone,
            or that a lost sender is tried again; infinite: until Ctrl-C.
    """

    header_wait: float = 10.0  # a program that has it ready sends it at once, ten seconds forgive a slow start
    message_wait: float = 10.0  # the largest in use crosses a bad radio link in one
    largest_rate: float = 10_000.0  # three wearers of 17 sensors at 100 Hz send 5,100
    # A header with the skeletons of ten wearers has 30 kB, a frame of fifty people 30 kB: more is a stray length.
    largest_message: int = 16 * MIB
    largest_chunk: int = 64 * MIB  # recorders close chunks at 1 to 4 MB, those with images in them at a few more
    # Two wearers of 13 sensors at 100 Hz send 2,600 a second: a start-up of a second and a half loses nothing.
    queue_limit: int = 4096
    # Recorders flush several times a second; a minute of slack for the operating system would only delay the end.
    growth_wait: float = 10.0
    next_client_wait: float = float("inf")

    def __post_init__(self) -> None:
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise RangeError(f"limits.{name}", f"is {getattr(self, name)}: expected a positive number")
        if not self.next_client_wait >= 0:
            raise RangeError("limits.next_client_wait", f"is {self.next_client_wait}: expected 0 seconds or more")


DEFAULT = LiveSourceSettings()
