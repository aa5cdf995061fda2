"""Refuses whatever leaves this machine, and notes it; a program of its own takes this file as its ``sitecustomize``.

An audit hook sees all that Python's sockets do, in libraries as well; native code that opens its own it does not see.
"""

import os
import sys
from collections.abc import Callable
from typing import Any

TO_ADDRESS = ("socket.connect", "socket.sendto", "socket.sendmsg")
TO_NAME = ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr")
NOTES = "VIP_FACTORS_TEST_NETWORK_NOTES"  # the file in which a program notes what it refused


def refuse(event: str, arguments: tuple[Any, ...], note: Callable[[str], None]) -> None:
    """For an audit hook: note and refuse what is meant for another machine.

    Raises:
        PermissionError: as a firewall would.
    """
    if event in TO_ADDRESS:
        # Other addresses are names of sockets in the file system.
        host = arguments[1][0] if isinstance(arguments[1], tuple) else None
    elif event in TO_NAME:
        host = arguments[0]
    else:
        return
    if host is None or os.fsdecode(host) in ("", "localhost", "::1") or os.fsdecode(host).startswith("127."):
        return
    note(f"{event} {host}")
    raise PermissionError(f"{event} {host}: refused by the test")


def _write(sentence: str) -> None:
    with open(os.environ[NOTES], "a", encoding="utf-8") as file:
        file.write(f"{sentence}\n")


if os.environ.get(NOTES) and __name__ == "sitecustomize":
    sys.addaudithook(lambda event, arguments: refuse(event, arguments, _write))
