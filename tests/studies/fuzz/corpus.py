"""All formats that the commands read, each with small whole files of it, and what the commands make of them.

Out of it on purpose: BlazePose's two models (nothing here can write a small one; a wheel of them is damaged, and
refused by its sum), WebSocket's handshake and frames (the library's; what its messages hold is in), Rerun files
(written, never read), the published data sets that ``benchmark`` reads, SMPL pickles with chumpy inside, and messages
between the package's own processes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.studies.fuzz.case import Case, Run
from tests.studies.fuzz.corpus_estimates import estimate_cases
from tests.studies.fuzz.corpus_filmed import filmed_cases
from tests.studies.fuzz.corpus_logs import log_cases
from tests.studies.fuzz.corpus_models import model_cases
from tests.studies.fuzz.corpus_scenes import scene_cases
from tests.studies.fuzz.corpus_small import small_cases
from tests.studies.fuzz.corpus_solved import solved_cases
from vip_factors.body.motion import Motion
from vip_factors.sensors.recording import Recording


@dataclass(frozen=True)
class Commands:
    """What the command line does with what was read, which lies in rows below this room.

    Attributes:
        describe_file: what ``info`` does with a file.
        describe_recording, describe_motion: what it says of them.
        read_settings: of a file of settings.
        run: a command by its name and words; what a user can mend is raised.
        take_step: of a sequence of commands, of which the folder holds a record.
        settings: text of such a file, with all that are numbers.
    """

    describe_file: Callable[[Path], object]
    describe_recording: Callable[[Recording], object]
    describe_motion: Callable[[Motion], object]
    read_settings: Callable[[Path], object]
    settings: str
    run: Run
    take_step: Callable[[Path], object]


def all_cases(commands: Commands) -> list[Case]:
    """One of each format."""
    logs = log_cases(commands.describe_recording)
    log = next(dict(one.files) for one in logs if one.name == "xsens-txt")
    return [
        *logs,
        *scene_cases(commands.describe_file),
        *small_cases(commands.describe_motion, commands.read_settings, commands.settings),
        *model_cases(commands.take_step),
        *filmed_cases(commands.run, log),
        *estimate_cases(commands.run),
        *solved_cases(commands.run),
    ]
