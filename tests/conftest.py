"""What all tests share: the folder of real recordings, repeatable property tests, single-threaded arithmetic."""

import gc
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # so begins what a shell runs in the background; tests interrupt
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before any test imports NumPy: two test workers with many threads each would only wait for one another.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

CHECKOUT = Path(__file__).resolve().parent.parent

# Compiling the libraries costs a program seconds: bytecode that may not be beside the sources is in pytest's cache.
if sys.dont_write_bytecode:
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = str(CHECKOUT / ".pytest_cache" / "bytecode")
    sys.dont_write_bytecode = False

# No deadline: a first call may compile or import. In CI the same examples every time, so that red means changed code.
settings.register_profile("default", deadline=None, max_examples=40, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", settings.get_profile("default"), derandomize=True, database=None, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


def real_recordings() -> Path:
    """Where the real recordings would be: ``VIP_FACTORS_DATA``, else ``../shared/data`` beside the checkout."""
    return Path(os.environ.get("VIP_FACTORS_DATA") or CHECKOUT.parent / "shared" / "data")


def missing_reason() -> str:
    return f"no folder of real recordings at {real_recordings()}; point VIP_FACTORS_DATA at one"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip everything marked ``data`` where the real recordings are not."""
    if real_recordings().is_dir():
        return
    for item in items:
        if "data" in item.keywords:
            item.add_marker(pytest.mark.skip(reason=missing_reason()))


def pytest_collection_finish() -> None:
    """Keep the garbage collector from walking over all imported modules again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """``pytest`` alone takes all cores; ``-n`` says another number, and named tests stay in one process."""
    is_whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    if is_whole and not hasattr(config, "workerinput") and config.getoption("numprocesses", 0) is None:
        config.option.numprocesses = "auto"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Tests of one file go to one worker: what they share is made once. Another ``--dist`` than -n's own is kept."""
    if config.getoption("dist") != "load":
        return None
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real recordings; tests that ask for it are skipped where it is absent."""
    folder = real_recordings()
    if not folder.is_dir():
        pytest.skip(missing_reason())
    return folder


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder that holds ``pyproject.toml``."""
    return CHECKOUT
