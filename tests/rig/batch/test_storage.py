"""Sessions in storage: hashes are checked on the way here, and nothing half-stored counts as done."""

import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path

import pytest

from imaging.compute.workers import Task
from imaging.errors import InputError
from imaging.files import store
from imaging.session.session import Session
from rig.batch import estimates, forecasts, storage
from rig.batch.batch_plan import BatchPlan, read_plan
from rig.batch.command_processes import Ended
from rig.batch.result import BatchResult
from rig.batch.run import carry_out

fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: pip install -e '.[cloud]'")


class Writer:
    """Writes what each command would make, and keeps the commands."""

    def __init__(self) -> None:
        self.commands = list[tuple[str, str]]()

    def submit(self, task: Task, function: Callable[..., Ended], words: Sequence[str]) -> "Future[Ended]":
        step, path = words[0], Path(words[1])
        self.commands.append((step, path.name))
        data = {}
        if step == "calibrate":
            store.write_bytes(path / "calibration" / "calibration.json", b"{}")
        elif step == "reconstruct":
            scene = path / "reconstructions" / words[words.index("--name") + 1]
            data = {"reconstruction": str(scene), "report": str(scene / "report.html"), "held_out_db": 30.0}
            for name in ("model.json", "report.html", ".model.json.part"):
                store.write_bytes(scene / name, f"{scene.name} {name}".encode())
        else:
            store.write_bytes(Path(words[words.index("--out") + 1]), b"splats")
        future: Future[Ended] = Future()
        future.set_result(Ended(0, data, "", 1.0))
        return future


@pytest.fixture(autouse=True)
def _forecast(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("calibration", "training", "export"):
        monkeypatch.setattr(forecasts, name, lambda *given: Task(1))


@pytest.fixture
def scans(toy_template: Path, tmp_path: Path) -> Path:
    """Two sessions that are not calibrated, in the folder that is uploaded."""
    for name in ("a", "b"):
        without = shutil.ignore_patterns("calibration", "truth")
        shutil.copytree(toy_template, tmp_path / "up" / name, ignore=without)
    return tmp_path / "up"


@pytest.fixture(scope="session")
def server() -> Iterator[str]:
    """URL of a server on the loopback that speaks S3."""
    pytest.importorskip("s3fs", reason="s3fs is not installed: pip install -e '.[cloud]'")
    moto = pytest.importorskip("moto.server", reason="moto is not installed: pip install -e '.[test]'")
    running = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    yield f"http://{host}:{port}"
    running.stop()


@pytest.fixture(params=["memory", "file", "s3"])
def bucket(
    request: pytest.FixtureRequest, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> str:
    """URL of storage of each kind that holds the sessions in `scans`."""
    if request.param == "file":
        shutil.copytree(scans, tmp_path / "bucket" / "scans")
        return f"file://{tmp_path}/bucket"
    if request.param == "s3":
        monkeypatch.setenv("AWS_ENDPOINT_URL", request.getfixturevalue("server"))
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_DEFAULT_REGION"):
            monkeypatch.setenv(name, "us-east-1")
    name = "".join(letter for letter in tmp_path.name if letter.isalnum())
    system = fsspec.filesystem(request.param)
    system.mkdir(f"/{name}")
    system.put(f"{scans}/", f"/{name}/scans/", recursive=True)
    return f"{request.param}://{name}"


SCENES = '[[scene]]\nname = "one"\nexport = ["scene.ply"]\n'


def planned(folder: Path, bucket: str, scenes: str = SCENES) -> BatchPlan:
    store.make_folder(folder)
    text = f'sessions = ["{bucket}/scans/*"]\noutput = "{bucket}/scenes"\n{scenes}'
    (folder / "PLAN.toml").write_text(text)
    return read_plan(folder / "PLAN.toml")


def outcomes(result: BatchResult) -> list[tuple[str, str, str | None]]:
    return [(row.session.name, row.scene, row.failed) for row in result.rows]


def check_stored(bucket: str, name: str, scans: Path) -> None:
    """What is stored is what the manifest names, with its hashes, and no photograph."""
    system, root = fsspec.core.url_to_fs(f"{bucket}/scenes/{name}")
    files = json.loads(system.cat_file(f"{root}/manifest.json"))["files"]
    stored = {path[len(root) + 1 :]: system.cat_file(path) for path in system.find(root)}
    assert files == {path: hashlib.sha256(stored[path]).hexdigest() for path in files}
    assert {"session.json", "calibration/calibration.json", "reconstructions/one/model.json"} <= files.keys()
    assert "exports/one/scene.ply" in files
    photographs = {shot.file for shot in Session.open(scans / name).shots()}
    assert not any(path.endswith(".part") or path in photographs for path in stored)


def test_sessions_are_made_stored_and_left_alone_by_the_next_run(
    bucket: str, scans: Path, tmp_path: Path
) -> None:
    plan = planned(tmp_path / "first", bucket)
    result = carry_out(plan, Writer())
    assert outcomes(result) == [("a", "one", None), ("b", "one", None)]
    for row in result.rows:
        check_stored(bucket, row.session.name, scans)
        assert row.stored == f"{bucket}/scenes/{row.session.name}"
        assert (row.reconstruction, row.exports) == (
            Path("reconstructions/one"),
            (Path("exports/one/scene.ply"),),
        )
    assert not any(plan.path.with_suffix(".work").iterdir())  # the disk has room for the next ones
    writer = Writer()
    again = carry_out(planned(tmp_path / "another-machine", bucket), writer)
    assert writer.commands == []
    assert all(row.already_there and row.db == 30.0 for row in again.rows)


def test_a_new_scene_is_made_of_the_stored_calibration(bucket: str, scans: Path, tmp_path: Path) -> None:
    carry_out(planned(tmp_path, bucket), Writer())
    writer = Writer()
    plan = planned(tmp_path, bucket, '[[scene]]\nname = "two"\n')
    result = carry_out(plan, writer)
    assert not any(step == "calibrate" for step, _ in writer.commands)
    place = plan.place(plan.sessions[0])
    assert place is not None
    assert [row.scene for row in place.manifest().rows] == ["one", "two"]
    assert outcomes(result) == [("a", "two", None), ("b", "two", None)]
    check_stored(bucket, "b", scans)


@pytest.mark.parametrize("bucket", ["memory"], indirect=True)
def test_a_scene_with_other_options_is_not_the_stored_one_of_its_name(bucket: str, tmp_path: Path) -> None:
    carry_out(planned(tmp_path, bucket), Writer())
    plan = planned(tmp_path, bucket, f"{SCENES}seed = 7\nset = {{ gaussians = 500 }}\n")
    assert all(row.processor_seconds > 0 for row in estimates.estimates(plan))
    writer = Writer()
    assert not any(row.already_there for row in carry_out(plan, writer).rows)
    assert [name for step, name in writer.commands if step == "reconstruct"] == ["a", "b"]
    writer = Writer()
    assert all(row.already_there for row in carry_out(plan, writer).rows)
    assert writer.commands == []


def test_a_damaged_photograph_fails_its_session_alone(bucket: str, tmp_path: Path) -> None:
    system, root = fsspec.core.url_to_fs(f"{bucket}/scans/a")
    name = json.loads(system.cat_file(f"{root}/shots.jsonl").splitlines()[0])["file"]
    data = bytearray(system.cat_file(f"{root}/{name}"))
    data[len(data) // 2] ^= 1
    system.pipe_file(f"{root}/{name}", bytes(data))
    plan = planned(tmp_path, bucket)
    result = carry_out(plan, Writer())
    assert outcomes(result) == [("a", "one", "fetch"), ("b", "one", None)]
    url = f"{bucket}/scans/a/{name}".replace("memory://", "memory:///")
    assert result.rows[0].says == f"{url} differs from its recorded SHA-256: upload it again."
    assert not (plan.sessions[0] / name).exists()
    data[len(data) // 2] ^= 1
    system.pipe_file(f"{root}/{name}", bytes(data))
    assert outcomes(carry_out(plan, Writer()))[0] == ("a", "one", None)


@pytest.mark.parametrize("bucket", ["memory"], indirect=True)
def test_scenes_of_other_photographs_are_not_those_that_are_there(bucket: str, tmp_path: Path) -> None:
    """A shot of `a` has another hash than when its scenes were made, as `rig check --repair` writes it."""
    carry_out(planned(tmp_path, bucket), Writer())
    system, root = fsspec.core.url_to_fs(f"{bucket}/scans/a")
    lines = system.cat_file(f"{root}/shots.jsonl").splitlines()
    shot = json.loads(lines[0])
    data = system.cat_file(f"{root}/{shot['file']}") + b"\0"
    system.pipe_file(f"{root}/{shot['file']}", data)
    lines[0] = json.dumps(shot | {"sha256": hashlib.sha256(data).hexdigest()}).encode()
    system.pipe_file(f"{root}/shots.jsonl", b"\n".join(lines) + b"\n")
    writer = Writer()
    other = planned(tmp_path, bucket, '[[scene]]\nname = "two"\n')
    carry_out(other, Writer())  # scene one is not of the photographs that this one is made of
    carry_out(planned(tmp_path, bucket), writer)
    assert writer.commands == [("reconstruct", "a"), ("export", "one")]
    writer = Writer()
    assert all(row.already_there for row in carry_out(planned(tmp_path, bucket), writer).rows)
    assert writer.commands == []


def test_a_damaged_result_is_named_and_never_built_on(bucket: str, tmp_path: Path) -> None:
    carry_out(planned(tmp_path, bucket), Writer())
    system, _ = storage._opened(bucket)
    system.pipe_file(f"{bucket}/scenes/a/calibration/calibration.json", b"[]")
    result = carry_out(planned(tmp_path, bucket, '[[scene]]\nname = "two"\n'), Writer())
    assert outcomes(result) == [("a", "two", "fetch"), ("b", "two", None)]
    assert result.rows[0].says == (
        f"{bucket}/scenes/a/calibration/calibration.json differs from its recorded SHA-256: "
        "delete manifest.json there, and its scenes are made again."
    )


def test_a_photograph_that_is_missing_is_named(bucket: str, tmp_path: Path) -> None:
    system, root = fsspec.core.url_to_fs(f"{bucket}/scans/b")
    name = json.loads(system.cat_file(f"{root}/shots.jsonl").splitlines()[0])["file"]
    system.rm_file(f"{root}/{name}")
    row = carry_out(planned(tmp_path, bucket), Writer()).rows[1]
    assert row.failed == "fetch"
    assert f"/scans/b lacks {name}, which shots.jsonl lists" in row.says


class Killed(BaseException):
    """Ends the process as far as the batch can see."""


@pytest.mark.parametrize("uploads", [0, 2])
@pytest.mark.parametrize("before", ["nothing", "another scene", "other records"])
def test_a_killed_upload_never_counts_as_done(
    bucket: str, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, uploads: int, before: str
) -> None:
    """An earlier scene stays done, unless files that its manifest names are being replaced."""
    if before != "nothing":
        carry_out(planned(tmp_path, bucket, '[[scene]]\nname = "zero"\n'), Writer())
    system, _ = storage._opened(bucket)
    if before == "other records":
        path = f"{bucket}/scans/a/plans.jsonl"
        system.pipe_file(path, system.cat_file(path) * 2)
    plan = planned(tmp_path, bucket)
    with monkeypatch.context() as patch:
        put, count = system.put_file, iter(range(uploads))

        def killed(*given: object, **more: object) -> None:
            if next(count, None) is None:
                raise Killed
            put(*given, **more)

        patch.setattr(system, "put_file", killed)
        with pytest.raises(Killed):
            carry_out(plan, Writer())
    place = plan.place(plan.sessions[0])
    assert place is not None
    assert [row.scene for row in place.manifest().rows] == (["zero"] if before == "another scene" else [])
    shutil.rmtree(plan.path.with_suffix(".work"))  # the next run is on another machine
    writer = Writer()
    assert outcomes(carry_out(plan, writer)) == [("a", "one", None), ("b", "one", None)]
    assert ("reconstruct", "a") in writer.commands
    assert (("calibrate", "a") in writer.commands) == (before != "another scene")
    check_stored(bucket, "a", scans)


def test_storage_that_refuses_fails_the_session_and_keeps_it_here(
    bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planned(tmp_path, bucket)
    system, _ = storage._opened(bucket)

    def refused(*given: object, **more: object) -> None:
        raise PermissionError("Access Denied\nRequest 12")

    with monkeypatch.context() as patch:
        patch.setattr(system, "put_file", refused)
        result = carry_out(plan, Writer())
    assert outcomes(result) == [("a", "one", "store"), ("b", "one", "store")]
    assert result.rows[0].says == (
        f"{bucket}/scenes/a cannot be used (Access Denied): check its name, your credentials and the network."
    )
    assert (plan.sessions[0] / "reconstructions" / "one" / "model.json").is_file()


def test_estimates_need_the_records_alone(bucket: str, tmp_path: Path) -> None:
    plan = planned(tmp_path, bucket)
    here = estimates.estimates(BatchPlan(tmp_path / "P.toml", (tmp_path / "up" / "a",), plan.scenes))
    there = estimates.estimates(plan)
    assert [row.processor_seconds for row in there] == [here[0].processor_seconds] * 2
    assert not plan.path.with_suffix(".work").exists()
    carry_out(plan, Writer())
    assert [row.processor_seconds for row in estimates.estimates(plan)] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('sessions = ["memory://nowhere/*"]', "line 1: sessions in storage need an output: add one"),
        ('sessions = ["a"]\noutput = "memory://b"', "line 2: output and all sessions must be in storage"),
        ('sessions = ["memory://nowhere/*"]\noutput = "memory://b"', "there is no session at"),
        ('sessions = ["moon://nowhere/*"]\noutput = "memory://b"', "is not storage that fsspec knows"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "PLAN.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_plan(tmp_path / "PLAN.toml")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_sessions_of_one_name_are_refused(scans: Path, tmp_path: Path) -> None:
    shutil.copytree(scans / "a", tmp_path / "more" / "a")
    text = f'sessions = ["file://{scans}/*", "file://{tmp_path}/more/*"]\noutput = "memory://b"'
    (tmp_path / "PLAN.toml").write_text(text)
    with pytest.raises(InputError, match="would both be stored as a: put one of them in another plan"):
        read_plan(tmp_path / "PLAN.toml")


@pytest.mark.parametrize("bucket", ["file"], indirect=True)
def test_a_session_of_the_same_name_elsewhere_never_gets_the_stored_scenes(
    bucket: str, tmp_path: Path
) -> None:
    carry_out(planned(tmp_path, bucket), Writer())
    shutil.move(tmp_path / "bucket" / "scans", tmp_path / "bucket" / "tuesday")
    plan = tmp_path / "PLAN.toml"
    plan.write_text(plan.read_text().replace("/scans/", "/tuesday/"))
    writer = Writer()
    result = carry_out(read_plan(plan), writer)
    assert (outcomes(result), writer.commands) == ([("a", "one", "fetch"), ("b", "one", "fetch")], [])
    assert result.rows[0].says == (
        f"{bucket}/scenes/a holds what was made of {bucket}/scans/a: give this plan an output of its own."
    )
    assert result.rows[0].says == estimates.estimates(read_plan(plan))[0].says


@pytest.mark.parametrize("package", ["s3fs", "fsspec"])
def test_a_package_that_is_missing_is_named_with_the_fix(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3", raising=False)
    for name in list(sys.modules):
        if name.split(".")[0] == package:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "PLAN.toml").write_text('sessions = ["s3://b/scans/*"]\noutput = "s3://b/scenes"')
    with pytest.raises(InputError, match=rf"{package}.*pip install -e '\.\[cloud\]'\.$"):
        read_plan(tmp_path / "PLAN.toml")
