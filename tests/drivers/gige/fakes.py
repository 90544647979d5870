"""GigE Vision cameras in software that others wrote, on loopback."""

import fcntl
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import SystemClock
from drivers.gige import GigeCamera, Network, find_cameras

ARAVIS = "127.0.0.1"
"""The only address of loopback that Aravis's fake camera knows as an interface."""


def own_address(number: int = 0) -> str:
    """An address of loopback that no other process of a test run uses: GVCP has one port."""
    process = os.getpid()
    return f"127.{64 + number}.{process >> 8 & 255}.{process & 255 or 1}"


def only_at(*addresses: str) -> Network:
    """A network without broadcasts."""
    return Network(addresses, [])


def camera_at(address: str) -> GigeCamera:
    (camera,) = find_cameras(only_at(address), SystemClock())
    return camera


@contextmanager
def port_of_aravis() -> Iterator[None]:
    """Wait until no other test process has a fake camera there."""
    with (Path(tempfile.gettempdir()) / f"rig-gvcp-{os.getuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def aravis_fake(*options: str) -> Iterator[str]:
    """Aravis's fake camera, from when it answers; its address."""
    fake = shutil.which("arv-fake-gv-camera-0.8") or shutil.which("arv-fake-gv-camera-0.10")
    if fake is None:
        pytest.skip("Aravis (arv-fake-gv-camera) is not installed")
    command = [fake, "-i", ARAVIS, "-s", "GV01", *options]
    with port_of_aravis(), subprocess.Popen(command, stdout=subprocess.DEVNULL) as served:
        try:
            deadline = time.monotonic() + 10
            while not only_at(ARAVIS).discover():
                assert time.monotonic() < deadline, "it does not answer"
            yield ARAVIS
        finally:
            served.terminate()


@contextmanager
def viva_fake(**options: Any) -> Iterator[Any]:
    """The fake camera of viva-genicam; it has an `ip`."""
    testing = pytest.importorskip("viva_genicam.testing", reason="the package viva-genicam is not installed")
    with testing.FakeGigeCamera(width=128, height=96, bind_ip=own_address(), **options) as fake:
        yield fake
