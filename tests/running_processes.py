"""Processes that run, and which have begun which, where the system (Linux) shows them."""

from pathlib import Path

PROC = Path("/proc")


def begun_by(pid: int) -> list[int]:
    """Numbers of the processes below one; empty where the system does not say."""
    stats = {int(folder.name): process_status(int(folder.name)) for folder in PROC.glob("[0-9]*")}
    parents = {one: int(fields[1]) for one, fields in stats.items() if fields is not None}
    below = {pid}
    while more := {one for one, parent in parents.items() if parent in below} - below:
        below |= more
    return sorted(below - {pid})


def is_running(pid: int) -> bool:
    """Whether there is such a process, and it has not ended."""
    fields = process_status(pid)
    return fields is not None and fields[0] != "Z"


def process_status(pid: int) -> list[str] | None:
    """Fields of ``/proc/PID/stat`` from the state on; the name before it may hold anything."""
    try:
        return (PROC / str(pid) / "stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
