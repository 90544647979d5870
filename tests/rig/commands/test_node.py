"""`rig node`, and captures over nodes, where something is missing; what works is tested over Ray."""

import sys
from pathlib import Path

import pytest

from imaging.session.session import Session

RIG = """
frames = 1
[bracket]
exposures = [0]
time = "1/60"
[[camera]]
name = "cam0"
serial = "SIM-RAW-001"
node = "left"
[[camera]]
name = "cam1"
serial = "SIM-RAW-002"
node = "right"
"""
NOBODY = "127.0.0.1:9"


@pytest.fixture(autouse=True)
def _token_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path / "auth_token"))
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "RIG.toml"
    path.write_text(RIG)
    return path


def test_a_cluster_that_is_not_there_is_told(rig, tmp_path: Path, rig_file: Path) -> None:
    code, out, err = rig("node", "left", "--ray", NOBODY, "--sim", "toy", "--disk", str(tmp_path / "disk"))
    assert (code, out) == (2, "")
    lines = err.splitlines()
    assert lines[:2] == ["SIM-RAW-001  hdr-rig Simulated PTP", "SIM-RAW-002  hdr-rig Simulated PTP"]
    assert lines[2].startswith("A token was made, without which no host can connect: copy ")
    assert f" {tmp_path}/auth_token to the same place" in lines[2]
    assert (tmp_path / "auth_token").stat().st_mode & 0o777 == 0o600
    assert f"No Ray cluster answers at {NOBODY} (connection refused): begin one" in lines[-1]
    assert lines[-1].endswith("by RAY_AUTH_MODE=token ray start --head --port 9.")
    pytest.importorskip("ray")
    code, out, err = rig("capture", str(rig_file), str(tmp_path / "S"), "--ray", NOBODY)
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].startswith(f"No Ray cluster answers at {NOBODY}")
    assert not (tmp_path / "S").exists()


def test_without_ray_it_is_said_how_to_install_it(
    rig, tmp_path: Path, rig_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    node = ("node", "left", "--ray", NOBODY, "--sim", "toy", "--disk", str(tmp_path / "disk"))
    for command in (node, ("capture", str(rig_file), str(tmp_path / "S"))):
        code, out, err = rig(*command)
        assert (code, out) == (2, "")
        assert err.splitlines()[-1] == "Ray is not installed: pip install -e '.[cluster]'."


def test_a_name_that_is_none_is_refused(rig, tmp_path: Path) -> None:
    code, _, err = rig("node", "a b", "--ray", NOBODY, "--disk", str(tmp_path / "disk"))
    assert code == 2
    assert "name 'a b' cannot be used: a name is made of letters, digits" in err


def test_simulated_cameras_stand_in_for_those_of_all_nodes(rig, tmp_path: Path, rig_file: Path) -> None:
    assert rig("capture", str(rig_file), str(tmp_path / "S"), "--sim", "toy")[0] == 0
    assert [shot.node for shot in Session.open(tmp_path / "S").shots()] == [None, None]
