"""Invalid websockets, and invalid messages of the viewer: the terminal stays as it is, and others are
served.
"""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import viser
import websockets.sync.client

BAD_BYTES = [
    b"\0\xff" * 40,
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET /" + b"a" * 9000,
    b"\x16\x03\x01\x02\0\x01",
    b"",
]
BAD_FRAMES = [
    b"\xff\xff\xff\xff\xff",  # reserved bits and an opcode that is none
    b"\x82\xff\xff\xff\xff\xff\xff\xff\xff\xff",  # 2**63 bytes
    b"\x81\x02\xc3\x28",  # not masked, and no UTF-8
    b"\x88\x81\0\0\0\0a",  # a close of one byte
]
BAD_MESSAGES = [b"", b"\xc1", b"\x93\x01\x02", os.urandom(64), b"\x81\xa4type\xa4Nope", "text"]

PROGRAM = """
import sys
from rig.view.serving.server import Viewer
with Viewer("toy", 0) as viewer:
    print(viewer.server.get_port(), flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def served(tmp_path: Path):
    """A viewer in a process of its own, whose standard error is looked at, and its port."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[4])},
    ) as process:
        yield process, int(process.stdout.readline())
        process.stdin.close()


def drain(client) -> None:
    while client.recv(timeout=5.0):
        pass


def test_what_makes_no_sense_leaves_no_traceback(served) -> None:
    process, port = served
    for data in BAD_BYTES:
        with socket.create_connection(("127.0.0.1", port)) as link:
            link.settimeout(5.0)
            link.sendall(data)
            link.shutdown(socket.SHUT_WR)
            while link.recv(4096):
                pass
    protocols = [websockets.Subprotocol(f"viser-v{viser.__version__}")]
    for frame in BAD_FRAMES:
        with websockets.sync.client.connect(f"ws://127.0.0.1:{port}", subprotocols=protocols) as client:
            client.socket.sendall(frame)
    for message in BAD_MESSAGES:
        with websockets.sync.client.connect(f"ws://127.0.0.1:{port}", subprotocols=protocols) as client:
            client.send(message)
            with pytest.raises(websockets.exceptions.ConnectionClosed):
                drain(client)
    with websockets.sync.client.connect(f"ws://127.0.0.1:{port}", subprotocols=protocols) as client:
        assert client.recv(timeout=10.0)
    process.stdin.close()
    assert process.stderr.read() == ""
