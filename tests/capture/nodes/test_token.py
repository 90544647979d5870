"""The token of a cluster, and Ray's processes, which end with the node however that ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.nodes.token import ask_for_token, has_token, make_token, token_file
from imaging.errors import InputError, StorageError

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path / "ray" / "auth_token"))
    for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_MODE"):
        monkeypatch.delenv(name, raising=False)


def test_the_first_node_makes_a_token_that_its_owner_alone_can_read() -> None:
    assert not has_token()
    path = make_token()
    assert path == token_file()
    assert path.stat().st_mode & 0o777 == 0o600
    assert re.fullmatch(r"[0-9a-f]{64}", path.read_text())
    text = path.read_text()
    path.chmod(0o644)
    assert make_token() is None
    assert (path.read_text(), path.stat().st_mode & 0o777) == (text, 0o600)


def test_an_empty_file_is_no_token() -> None:
    token_file().parent.mkdir()
    token_file().write_text("\n")
    assert make_token() == token_file()
    assert has_token()


def test_a_token_in_the_environment_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN", "abc")
    assert make_token() is None
    assert not token_file().exists()


def test_a_token_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "ray").write_text("a file where the folder would be")
    with pytest.raises(StorageError, match="auth_token could not be written"):
        make_token()


def test_tokens_are_asked_for_unless_the_user_says_otherwise() -> None:
    environment: dict[str, str] = {}
    assert ask_for_token(environment)
    assert environment == {"RAY_AUTH_MODE": "token"}
    assert not ask_for_token({"RAY_AUTH_MODE": "disabled"})
    with pytest.raises(InputError, match="RAY_AUTH_MODE is 'off'"):
        ask_for_token({"RAY_AUTH_MODE": "off"})


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as there:
        return int(there.getsockname()[1])


@pytest.fixture
def head() -> Iterator[str]:
    """The address of a cluster that asks for tokens."""
    pytest.importorskip("ray")
    make_token()
    address = f"127.0.0.1:{free_port()}"
    start = [
        sys.executable,
        "-m",
        "ray.scripts.scripts",
        "start",
        "--head",
        "--block",
        "--disable-usage-stats",
    ]
    start += ["--node-ip-address", "127.0.0.1", "--port", address.rpartition(":")[2], "--num-cpus", "1"]
    start += ["--include-dashboard=false", "--object-store-memory", "80000000"]
    start += ["--ray-client-server-port", str(free_port())]
    environment = os.environ | {"RAY_AUTH_MODE": "token", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        start, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        try:
            assert any("Ray runtime started" in line for line in process.stdout)
            yield address
        finally:
            process.terminate()
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)


STRANGER = """
import sys, ray
try:
    ray.init(sys.argv[1], log_to_driver=False, logging_level="ERROR")
except ConnectionError as error:
    print("refused:", error)
else:
    print("let in")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="PR_SET_PDEATHSIG is Linux's")
def test_a_killed_node_leaves_nothing_behind_and_a_stranger_cannot_connect(head: str, tmp_path: Path) -> None:
    code = "import sys; from rig.__main__ import main; sys.exit(main())"
    node = [sys.executable, "-c", code, "node", "left", "--ray", head, "--sim", "toy"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [*node, "--disk", str(tmp_path / "disk")], env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        said: list[str] = []
        for line in process.stderr:
            said.append(line)
            if "Node left serves 2 cameras" in line:
                break
        else:
            pytest.fail(f"the node did not join: {said}")
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        (ray,) = [int(child) for child in children if os.getpgid(int(child)) == int(child)]
        asked = subprocess.run(
            [sys.executable, "-c", STRANGER, head],
            env=environment | {"RAY_AUTH_MODE": "disabled", "RAY_NUM_REDIS_GET_RETRIES": "1"},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert "refused: Failed to connect" in asked.stdout, asked
        process.kill()
    deadline, waiting = time.monotonic() + 30, threading.Event()
    while group_lives(ray):
        assert time.monotonic() < deadline, "Ray's processes outlive the node"
        waiting.wait(0.1)


def group_lives(group: int) -> bool:
    """Tell if a process of the group runs; what has ended and was not collected by its parent does not."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, process_group = stat.read_text().rsplit(")", 1)[1].split()[:3]
        except OSError:  # it has ended meanwhile
            continue
        if int(process_group) == group and state != "Z":
            return True
    return False
