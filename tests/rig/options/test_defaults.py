"""Defaults of the user's own: what is in force, what wins, and what is refused in one sentence."""

from pathlib import Path

import pytest
import typer

from imaging.errors import InputError
from rig.cli import COMMANDS, app
from rig.options.defaults import config_file, read_defaults


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "defaults.toml"
    monkeypatch.setenv("RIG_CONFIG", str(path))
    return path


def test_a_default_holds_and_what_is_typed_wins(rig, config: Path, toy: Path, tmp_path: Path) -> None:
    config.write_text('[merge]\nframe = 1\ncamera = "cam1"\n')
    code, _, err = rig("merge", str(toy), str(tmp_path / "one"))
    assert (code, err) == (0, "")
    assert [path.relative_to(tmp_path / "one").as_posix() for path in (tmp_path / "one").rglob("*.exr")] == [
        "0001/cam1.exr"
    ]
    code, _, err = rig("merge", str(toy), str(tmp_path / "two"), "--camera", "cam0")
    assert (code, err) == (0, "")
    assert [path.relative_to(tmp_path / "two").as_posix() for path in (tmp_path / "two").rglob("*.exr")] == [
        "0001/cam0.exr"
    ]


@pytest.mark.parametrize(
    ("defaults", "arguments"),
    [
        ("[merge]\nwidth = 512\nsun = 1000", ("merge", "nosuch", "out")),
        ("[render]\nstart-frame = 5", ("render", "nosuch")),
        ('[render]\npath-in = "scene.usd"\npath-camera = "one"', ("render", "nosuch")),
        (
            '[render]\npath = "orbit"\nlayers = "depth"\nraw = "cam0"\nstart-frame = 5',
            ("render", "nosuch", "--probe", "0,0,0"),
        ),
        ('[render]\nprobe = "0,0,0"', ("render", "nosuch", "--probe-view", "0000/cam0")),
        ('[render]\nprobe-view = "0000/cam0"', ("render", "nosuch", "--path", "orbit")),
        ('[export]\nformat = "ply"\nfor = "nuke"', ("export", "nosuch", "--vfx", "out")),
        ('[export]\nout = "scene.ply"', ("export", "nosuch", "--vfx", "out")),
        ('[export]\nvfx = "out"', ("export", "nosuch", "--out", "scene.ply")),
    ],
)
def test_a_default_that_does_not_go_with_what_is_typed_gives_way(
    rig, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, defaults: str, arguments
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rig.commands.render.find_reconstruction", Path)
    config.write_text(defaults)
    code, _, err = rig(*arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert "nosuch" in err  # the options are agreed, and the scene is what is looked for
    assert "--" not in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("merge", "nosuch", "out", "--width", "512"),
        ("render", "nosuch", "--start-frame", "5"),
        ("render", "nosuch", "--probe", "0,0,0", "--path", "orbit"),
        ("export", "nosuch", "--vfx", "out", "--format", "ply"),
    ],
)
def test_what_is_typed_has_to_go_together(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rig.commands.render.find_reconstruction", Path)
    code, _, err = rig(*arguments)
    assert (code, "--" in err) == (2, True)


def test_cameras_of_ones_own_give_way_to_a_simulated_rig(rig, config: Path, tmp_path: Path) -> None:
    config.write_text('[init]\ncamera = ["gige:192.0.2.1"]\n[cameras]\nsim = "toy"\n')
    path = tmp_path / "RIG.toml"
    code, _, err = rig("init", str(path), "--sim", "toy")
    assert (code, err) == (0, "")
    assert "192.0.2.1" not in path.read_text()
    code, _, err = rig("cameras", "--camera", "nonsense")
    assert (code, "--camera 'nonsense' has to be" in err) == (2, True)
    config.write_text("")
    code, _, err = rig("init", str(tmp_path / "new.toml"), "--sim", "toy", "--camera", "gige:192.0.2.1")
    assert (code, "leave out --sim, or --camera" in err) == (2, True)


def test_values_are_as_typed_whatever_toml_calls_them(config: Path) -> None:
    config.write_text('[reconstruct]\nseed = 3\nbudget = "5m"\nset = ["iterations=10"]\n')
    read = read_defaults(config, typer.main.get_command(app))
    assert read == {"reconstruct": {"seed": "3", "budget": "5m", "overrides": ["iterations=10"]}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[chek]\n", "there is no command 'chek'"),
        ("check = 1\n", "check is not a table"),
        ('[reconstruct]\nqualty = "best"\n', "[reconstruct] has no 'qualty' that takes a value: set one of"),
        ("[reconstruct]\nreplace = true\n", "[reconstruct] has no 'replace' that takes a value"),
        ("[reconstruct]\nseed = true\n", "[reconstruct] seed is neither text nor a number"),
        ("[reconstruct]\nseed = [1, 2]\n", "[reconstruct] seed takes one value"),
        ('[reconstruct]\nquality = "fine"\n', "[reconstruct] quality: 'fine' is not one of"),
        ('[reconstruct]\nbudget = "5 parsecs"\n', "write a time as 90s, 5m or 1h"),
        ("[reconstruct]\nseed = -1\n", "[reconstruct] seed:"),
        ("[reconstruct\n", "is not valid TOML"),
        ('[reconstruct]\nname = "\ud800"\n', "is not valid TOML"),
        (None, "cannot be read (no such file or directory)"),
    ],
)
def test_what_cannot_be_is_one_sentence_that_names_the_file(rig, config: Path, text, words: str) -> None:
    if text is not None:
        config.write_bytes(text.encode("utf-8", "surrogatepass"))
    code, out, err = rig("reconstruct", "nosuch")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert str(config) in err
    assert words in err


def test_a_wrong_file_hinders_neither_help_nor_doctor(rig, config: Path) -> None:
    config.write_text("[chek]\n")
    assert rig("check", "--help")[0] == 0
    assert rig("--help")[0] == 0
    code, out, _ = rig("doctor")
    assert code == 0
    assert f"{config}: there is no command 'chek'" in out


def test_doctor_says_which_file_is_in_force(rig, config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config.write_text('[reconstruct]\nquality = "draft"\n')
    assert f"those of {config}" in rig("doctor")[1]
    monkeypatch.setenv("RIG_CONFIG", "")
    assert "rig's own" in rig("doctor")[1]


def test_the_file_is_where_base_directories_have_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RIG_CONFIG")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert config_file() is None
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "config.toml").write_text("")
    assert config_file() == tmp_path / "rig" / "config.toml"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home" / ".config" / "rig").mkdir(parents=True)
    (tmp_path / "home" / ".config" / "rig" / "config.toml").write_text("")
    assert config_file() == tmp_path / "home" / ".config" / "rig" / "config.toml"


def test_every_option_with_a_value_can_be_set(config: Path) -> None:
    """Set it by its name on the command line; the example of each is refused or taken for what it is."""
    group = typer.main.get_command(app)
    for command in COMMANDS:
        for parameter in group.commands[command].params:
            for option in parameter.opts:
                if not option.startswith("--"):
                    continue
                config.write_text(f"[{command}]\n{option[2:]} = 1\n")
                if parameter.is_flag:
                    with pytest.raises(InputError, match="that takes a value"):
                        read_defaults(config, group, "none")
                else:
                    assert list(read_defaults(config, group, "none")[command]) == [parameter.name]
