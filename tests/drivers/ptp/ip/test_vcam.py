"""Our PTP/IP against a responder that somebody else wrote: vcam, a Canon EOS Rebel T6 in software.

github.com/petabyt/vcam; it has one port, and serves one client. It sends no ObjectInfo's last string, and
calls itself Microsoft's: what it is made by, its name tells.
"""

import fcntl
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import CameraNotFound
from drivers.ptp.ip.connection import connect
from drivers.ptp.protocol.codes import FormatCode, PropertyCode
from drivers.ptp.protocol.connection import body_for
from drivers.ptp.protocol.session import Download, PtpSession
from drivers.ptp.vendors.canon import CanonBody

VCAM = shutil.which("vcam")
PICTURE = bytes(range(256)) * 10_000
CLOCK = SystemClock()


@pytest.fixture
def session(tmp_path: Path) -> Iterator[PtpSession]:
    if VCAM is None:
        pytest.skip("vcam is not installed: github.com/petabyt/vcam")
    (tmp_path / "DCIM" / "100RIGXX").mkdir(parents=True)
    (tmp_path / "DCIM" / "100RIGXX" / "IMG_0001.JPG").write_bytes(PICTURE)
    command = [VCAM, "canon_1300d", "tcp", "--fs", str(tmp_path)]
    lock = Path(tempfile.gettempdir()) / f"rig-ptpip-{os.getuid()}.lock"
    with lock.open("w") as held, tempfile.TemporaryFile() as said:
        fcntl.flock(held, fcntl.LOCK_EX)
        with subprocess.Popen(command, stdout=said, stderr=said) as camera:
            try:
                deadline = CLOCK.now() + 10.0
                while True:
                    try:
                        transport = connect("127.0.0.1", 15740, CLOCK)
                        break
                    except CameraNotFound:
                        assert CLOCK.now() < deadline, "it does not answer"
                yield PtpSession(transport, CLOCK)
            finally:
                camera.kill()


def test_open_info_properties_and_download(session: PtpSession) -> None:
    info = session.open()
    assert (info.manufacturer, info.model) == ("Canon Inc.", "Canon EOS Rebel T6")
    assert isinstance(body_for(session, None), CanonBody)
    battery = session.describe(PropertyCode.BATTERY_LEVEL)
    assert battery.current == 50
    assert "1024x768" in session.describe(PropertyCode.IMAGE_SIZE).form.values
    handles = {session.object_info(handle).filename: handle for handle in session.handles()}
    about = session.object_info(handles["IMG_0001.JPG"])
    assert (about.size, about.format) == (len(PICTURE), FormatCode.EXIF_JPEG)
    assert session.download(Download(handles["IMG_0001.JPG"], about, bytearray())) == PICTURE
    session.write_property(PropertyCode.IMAGE_SIZE, "2048x1536")
    assert session.describe(PropertyCode.IMAGE_SIZE).current == "2048x1536"
    session.close()
