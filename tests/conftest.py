"""Settings of all tests: their order, the threads of a process, and what processes make only once."""

import fcntl
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import hypothesis
import pytest
from hypothesis.internal.conjecture import providers

# Torch and BLAS would have as many threads in each of pytest's processes as there are cores, which spin while
# they wait for each other: with two processes on two cores matching features takes three times the processor
# time. They read this when they are first imported. The threads of `imaging.compute.threads` stay.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Ray's daemons start within its own half minute on an idle machine only.
os.environ.setdefault("RAY_raylet_start_wait_time_s", "240")
os.environ.setdefault("RAY_agent_register_timeout_ms", "240000")
# Whoever runs the tests may have defaults of their own.
os.environ["RIG_CONFIG"] = ""
# No test pulls the plug: nobody waits until what is written is on the disk. Tests of refusing disks have an
# `os.fsync` of their own.
os.fsync = lambda descriptor: None
# Byte code is kept, whatever else Python is told: the tests are rewritten and compiled once and not in every
# process, and so is rig, which tests start in some hundred.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Hypothesis would read every module of this project for constants that it draws now and then: seconds a
# process, and other examples of the same seed wherever other tests were imported before.
providers._get_local_constants = lambda: providers._local_constants
# The same examples in every run, however busy the machine is.
hypothesis.settings.register_profile("suite", deadline=None, derandomize=True)
hypothesis.settings.load_profile("suite")

LONGEST = (
    "foreign/test_room.py",
    "recon/splat/test_gpu_compile.py",
    "calib/test_calibrate.py",
    "rig/test_readme.py",
    "rig/test_turntable.py",
    "rig/test_panorama.py",
    "recon/methods/test_extreme_light.py",
    "foreign/test_objects.py",
    "calib/boards/test_rig.py",
    "calib/test_stopped_calibration.py",
    "rig/test_stability.py",
    "calib/survey/test_placing.py",
    "calib/light/curves/test_response.py",
    "recon/methods/test_mixed_rigs.py",
    "recon/methods/test_faulty_frames.py",
    "recon/decide/cost/test_probe.py",
    "calib/poses/test_sfm.py",
    "calib/poses/rigs/test_known_rig.py",
    "foreign/test_single.py",
    "rig/commands/test_batch.py",
    "rig/commands/test_trade.py",
    "rig/view/pages/test_follow.py",
    "rig/batch/test_ray.py",
    "calib/survey/test_onto.py",
    "foreign/test_alike.py",
    "rig/test_wheel.py",
)
"""Files whose tests take longest. They go first: one that came last, as those of the last folder would, would
keep one process at work and the others idle. (pytest-xdist by itself takes files of many tests first;
pyproject.toml says not to.) The first compiles the kernels of the CPU, which are kept on disk; those next to
it need none of them, or all processes would compile them. The third makes the demo and calibrates it, once:
a process that needs it meanwhile waits."""


TESTS = Path(__file__).parent


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None]:
    """Freeze what is imported and collected: no garbage collection visits it, now or later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_configure() -> None:
    """Let Ctrl-C reach the commands under test: a suite that a shell began in the background ignores it."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    """Libraries want all that is theirs freed at the end."""
    gc.unfreeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, pytest.CollectReport]:
    """Each process begins elsewhere in a folder, so that they do not all rewrite the same file at a time."""
    report = yield
    if isinstance(collector, pytest.Directory):
        number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        count = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
        first = number * len(report.result) // count
        report.result = report.result[first:] + report.result[:first]
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, the others in the order of their names."""
    place = {TESTS / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (place.get(item.path, len(place)), item.path))


@pytest.fixture(autouse=True)
def no_broadcasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test looks for cameras on the network that this machine is in."""
    monkeypatch.setattr("drivers.gige.network.interfaces", tuple)


MadeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> MadeOnce:
    """A folder of this name, made by the first process of the run that asks for it; not to be changed."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # that of the process which gave this one its tests

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        with (base / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return made


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    """Headless Chromium, one for all tests of a process: Playwright runs no second one beside it."""
    from tests.chromium import chromium

    with chromium() as running:
        yield running


@contextmanager
def fewer_rays(rig: str = "demo") -> Iterator[None]:
    """A simulated rig with 2x2 rays a pixel instead of 4x4, which are most of what simulating it takes."""
    from drivers.sim.rig_settings import RIGS

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(RIGS, rig, replace(RIGS[rig], samples=2))
        yield


@contextmanager
def fewer_features() -> Iterator[None]:
    """Calibration finds half as many features in small pictures, without looking closer for them.

    Of the demo's rig it finds poses that are as good in two thirds of the time.
    """
    from calib.data import features

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(features, "PIXELS_EACH", 2 * features.PIXELS_EACH)
        yield


@pytest.fixture(scope="session")
def demo_capture(made_once: MadeOnce) -> Path:
    """Three frames of the demo's four cameras, twelve brackets, not calibrated; not to be changed."""

    def make(folder: Path) -> None:
        from capture.simulated import capture_simulated

        with fewer_rays():
            capture_simulated("demo", folder, seed=1, frames=3)

    return made_once("demo-capture", make)
