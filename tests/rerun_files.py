"""What Rerun's own command line reads back from its files."""

import subprocess
import sys
from pathlib import Path


def printed(rrd: Path, detail: str = "-v") -> str:
    """The chunks of a file, a line each, as far as it can be read; blanks in names are underscores."""
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([str(rerun), "rrd", "print", detail, str(rrd)], capture_output=True, text=True, check=False)
    return done.stdout.replace("\\ ", "_")
