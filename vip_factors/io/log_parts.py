"""Foreign logs of one session, one after another in time, as one log."""

from collections.abc import Sequence
from dataclasses import replace

from vip_factors.io.importers.shared import ImportedLog
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.parts import joined_in_memory
from vip_factors.sensors.recording import Recording, Subject


def log_in_parts(logs: Sequence[ImportedLog], sources: Sequence[str]) -> ImportedLog:
    """Logs with absolute starts by these, others by their own clock, which must have gone on; without truth.

    Raises:
        InputError: as :func:`~vip_factors.sensors.parts.in_parts`; ``sources`` say which log.
    """
    clocks = [0.0 if one.start_ns or one.clock_s is None else one.clock_s for one in logs]
    parts = []
    for log, clock, source in zip(logs, clocks, sources, strict=True):
        imus = {name: replace(one, time=one.time + (clock - min(clocks))) for name, one in log.imus.items()}
        parts.append(Recording(source, Subject(), imus, Placement(), start_ns=log.start_ns))
    whole = joined_in_memory(parts, sources)
    first = logs[[one.name for one in parts].index(whole.name)]
    notes = dict.fromkeys(note for log in logs for note in log.notes)
    return replace(first, imus=whole.imus, truth_motion=None, notes=(f"parts: {', '.join(sources)}", *notes))
