"""``python -m tests.studies NAME [options]``, from a clone: accuracy, speed and memory, measured again anywhere."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from tests.studies.study import Study, markdown, run
from vip_factors.cli.options import parse
from vip_factors.cli.terminal import progress_bar
from vip_factors.errors import InputError, VipFactorsError

PROGRAM = "python -m tests.studies"
# Name → module here and its study.
STUDIES = {
    "vip": "vip:Vip",
    "consistency": "consistency:Consistency",
    "kaichi": "kaichi:Kaichi",
    "stream-faults": "stream_faults:StreamFaults",
    "stream-hour": "stream_program:StreamHour",
    "stream-slow": "stream_program:StreamSlow",
    "stream-kill": "stream_ends:StreamKill",
    "disk-full": "stream_ends:DiskFull",
    "long": "long_stream:Long",
    "speed": "speed:Speed",
    "many": "many:ManyRecordings",
    "recordings": "recordings:Recordings",
    "golden": "golden:Golden",
    "publish": "publish:Publish",
    "population": "population:Population",
    "weights": "weights:Weights",
    "tune": "tune:Tune",
    "coverage": "coverage:Coverage",
    "real": "real:Real",
    "catalogue": "catalogue:Catalogue",
    "gait": "gait_study:GaitStudy",
    "repetitions": "repetitions_study:RepetitionStudy",
    "fuzz": "fuzz.run:Fuzz",
    "train-prior": "train_prior:TrainPrior",
    "train-body": "train_prior:TrainBody",
    "train-keypoints": "train_keypoints:TrainKeypoints",
    "train-gait": "gait_train:TrainGait",
    "train-gait-events": "gait_study:TrainGaitEvents",
    "train-association": "train_association:TrainAssociation",
}


def main(arguments: Sequence[str]) -> int:
    """Run a study; the exit code, 2 for what the user can mend."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_help())
        return 0 if arguments else 2
    name, *words = arguments
    found, code = list[Any](), 0
    try:
        study = parse(study_of(name), f"{PROGRAM} {name}", words)
        with progress_bar() as tell:
            run(study, tell, found)
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted after {len(found)} rows", file=sys.stderr)
        code = 130
    except (VipFactorsError, OSError) as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return 2
    except SystemExit as stop:  # how the parser of options ends, after help or a complaint
        return stop.code if isinstance(stop.code, int) else 2
    if found:  # what there is of a study that was interrupted, too
        print(markdown(study, found), end="")
    return code


def study_of(name: str) -> type[Study]:
    """A study by its name."""
    if name not in STUDIES:
        raise InputError(f"unknown study '{name}'; there are {', '.join(STUDIES)}")
    module, _, kind = STUDIES[name].partition(":")
    found: type[Study] = getattr(import_module(f"tests.studies.{module}"), kind)
    return found


def _help() -> str:
    width = max(map(len, STUDIES))
    lines = [f"  {name:<{width}}  {(study_of(name).__doc__ or '').splitlines()[0]}" for name in STUDIES]
    return "\n".join([f"usage: {PROGRAM} NAME [options], from the folder of the clone", "", *lines])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
