"""Plans: what they mean, and what is wrong with them in one sentence with its line."""

from pathlib import Path

import pytest

from imaging.errors import InputError
from imaging.session.session import SESSION
from rig.batch.batch_plan import read_plan


def plan(folder: Path, text: str) -> Path:
    for name in ("scans/b", "scans/a", "other"):
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / SESSION).touch()
    (folder / "scans" / "notes").mkdir(exist_ok=True)
    path = folder / "PLAN.toml"
    path.write_text(text)
    return path


def test_patterns_find_sessions_once_and_in_order(tmp_path: Path) -> None:
    read = read_plan(plan(tmp_path, 'sessions = ["other", "scans/*", "*/a", "scans/../scans/b"]'))
    assert [str(session.relative_to(tmp_path)) for session in read.sessions] == [
        "other",
        "scans/a",
        "scans/b",
    ]
    (scene,) = read.scenes
    assert scene.words() == ["--method", "auto", "--quality", "standard", "--seed", "0"]


def test_patterns_may_be_absolute_and_names_may_have_brackets(tmp_path: Path) -> None:
    path = plan(tmp_path, f'sessions = ["{tmp_path}/scans/*", "{tmp_path}/other", "scans/b [1]"]')
    (tmp_path / "scans" / "b [1]").mkdir()
    (tmp_path / "scans" / "b [1]" / SESSION).touch()
    assert [str(session.relative_to(tmp_path)) for session in read_plan(path).sessions] == [
        *["scans/a", "scans/b", "scans/b [1]", "other"],
    ]
    path.write_text('sessions = ["scans/b [1]"]')
    assert read_plan(path).sessions == (tmp_path / "scans" / "b [1]",)


def test_a_scene_has_the_options_of_reconstruct(tmp_path: Path) -> None:
    text = """
sessions = ["other"]
[[scene]]
name = "small"
quality = "draft"
budget = "5m"
early_stop = true
all_views = true
set = { gaussians = 5000, environment = false, refine = "none" }
export = ["scene.usdc"]
[[scene]]
"""
    small, usual = read_plan(plan(tmp_path, text)).scenes
    assert small.words() == [
        *["--method", "auto", "--quality", "draft", "--seed", "0", "--early-stop"],
        *["--all-views", "--budget", "5m"],
        *["--name", "small", "--set", "gaussians=5000", "--set", "environment=0", "--set", "refine=none"],
    ]
    assert (small.called, usual.called) == ("small", "auto standard")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('sessions = ["nowhere"]', "line 1: 'nowhere' is not a session"),
        ('sessions = ["scans/notes"]', "line 1: 'scans/notes' is not a session"),
        ('sessions = ["**x"]', "line 1: '**x' is not a "),
        ("sessions = []", "line 1: sessions is empty: add one, such as sessions = "),
        ('sessions = ["other"]\nscene = []', "line 2: scene is empty: add a [[scene]], or leave it out."),
        ('sessions = ["/nowhere/*"]', "line 1: '/nowhere/*' is not a session"),
        ("[[scene]]", "sessions is missing"),
        ('sessions = ["other"]\nqualty = 1', "line 2: there is no setting 'qualty'"),
        ('sessions = ["other"]\n[[scene]]\nquality = "good"', "line 3: scene.0.quality"),
        (
            'sessions = ["other"]\n[[scene]]\nset = { gaussian = 3 }',
            "line 2: --set gaussian=3 is not a setting",
        ),
        ('sessions = ["other"]\n[[scene]]\nbudget = "soon"', "A budget of 'soon'"),
        ('sessions = ["other"]\n[[scene]]\nexport = ["../x.ply"]', "line 3: scene.0.export.0"),
        ('sessions = ["other"]\n[[scene]]\n[[scene]]', "2 scenes named 'auto standard'"),
        ('sessions = ["other"', "is not TOML"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError) as raised:
        read_plan(plan(tmp_path, text))
    assert says in str(raised.value)
    assert "PLAN.toml" in str(raised.value)


def test_a_plan_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_plan(tmp_path / "PLAN.toml")
    (tmp_path / "PLAN.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not TOML"):
        read_plan(tmp_path / "PLAN.toml")
