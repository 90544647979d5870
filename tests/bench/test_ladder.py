"""The verdict of bench/recon/parts/ladder.py on rows that are made up, and what its scenes need."""

from collections.abc import Mapping
from typing import Any

from bench.recon.parts import ladder
from imaging.session.records import Rung


def made(scene: str, chosen: Mapping[str, bool], db: float = 0.0, smaller: float = 4.0) -> dict[str, Any]:
    """A row whose ladder is `db` above everything on, as fast, and so many times smaller."""
    full = {"db": 30.0, "truth_db": 30.0, "seconds": 10.0, "size_bytes": 4000, "gaussians": 400}
    ladder = {
        "db": 30.0 + db,
        "truth_db": 30.0 + db,
        "seconds": 10.0,
        "size_bytes": 4000 / smaller,
        "gaussians": 400 / smaller,
    }
    return {"scene": scene, "chosen": dict(chosen), "load": 0.0, "ladder": ladder, "full": full}


def judged(rows: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    kinds = [verdict for kind in ladder.KINDS if (verdict := ladder.of_kind(kind, rows))]
    return kinds, ladder.verdict(kinds)


def test_what_is_taken_for_nothing_or_left_out_is_named() -> None:
    needs = {"vignetting": True, "distortion": False, "lens_fisheye": False}
    assert ladder.wrong(needs, {"vignetting": True, "distortion": False}) == []
    assert ladder.wrong(needs, {"distortion": True}) == ["no vignetting", "distortion"]


def test_rungs_of_the_calibration_stand_before_those_of_the_model() -> None:
    class Camera:
        response = type("Response", (), {"kind": "curve"})

    class Record:
        cameras = (Camera,)
        rungs = (Rung(name="vignetting", taken=True, reason=""),)

    model = [Rung(name=name, taken=False, reason="") for name in ("vignetting", "refine poses")]
    assert ladder.chosen(Record, model, 1) == {
        "vignetting": True, "refine poses": False, "response_curve": True, "exposures": False,
    }  # fmt: skip


def test_a_ladder_that_takes_just_what_is_needed_passes() -> None:
    kinds = {kind.name: kind.needs for kind in ladder.KINDS}
    rows = [made(f"{name} {seed}", needs, db=-0.1) for name, needs in kinds.items() for seed in range(2)]
    rows_of, verdict = judged(rows)
    assert (verdict["right"], verdict["misses"]) == (1.0, [])
    assert [one["scenes"] for one in rows_of] == [2] * len(kinds)
    table = ladder.report(
        {"machine": dict.fromkeys(("processor", "threads", "load", "python", "torch", "numba"), 1),
         "preset": {"iterations": 1, "gaussians": 1}, "scenes": len(rows), "rows": rows, "kinds": rows_of,
         "verdict": verdict}
    )  # fmt: skip
    assert table.count("| 2 |") == len(kinds)
    assert "All three hold." in table


def test_each_miss_is_said() -> None:
    (little,) = [kind for kind in ladder.KINDS if kind.name == "linear"]
    everything = dict.fromkeys(little.needs, True)
    _, verdict = judged([made("linear 0", everything, db=-0.3, smaller=2.0)])
    assert verdict["misses"] == [
        f"{100 / len(little.needs):.1f} % of the choices are right",
        "the worst scene is 0.30 dB below everything on",
        "a scene that needs little is only 2.0 times faster or smaller",
    ]
    # Where something is needed, as large as everything on is no fault.
    (hdr,) = [kind for kind in ladder.KINDS if kind.name == "HDR"]
    assert judged([made("HDR 0", hdr.needs, smaller=1.0)])[1]["misses"] == []


def test_there_are_sixty_scenes_and_some_of_them_need_each_rung() -> None:
    scenes = ladder.scenes()
    assert len(scenes) >= 60
    assert len({scene.name for scene in scenes}) == len(scenes)
    assert ladder.QUICK in {scene.name for scene in scenes}
    # A ladder that takes nothing has to fail; these four no camera of the simulator needs.
    needed = {name for kind in ladder.KINDS for name, need in kind.needs.items() if need}
    assert {name for name, need in ladder.KINDS[0].needs.items() if not need} - needed == {
        "sensor_linearity", "lens_principal_point", "lens_radial_2", "lens_tangential",
    }  # fmt: skip
