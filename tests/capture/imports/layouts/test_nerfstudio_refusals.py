"""Files of nerfstudio that cannot be: one sentence, and nothing is left behind."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.imports.layouts import nerfstudio
from imaging.errors import InputError

from .nerfstudio_scenes import CENTRES, LENS, TERMS, frames, imported, looking_at, scene


@pytest.mark.parametrize("extra", [{"is_fisheye": True, "camera_model": "OPENCV"}, {"is_fisheye": "yes"}])
def test_a_flag_that_contradicts_the_model_is_refused(tmp_path, extra):
    with pytest.raises(InputError, match=r"frame 0 of .* has is_fisheye .*: take one out\."):
        imported(scene(tmp_path / "n", LENS | extra | {"frames": frames()}))


def test_a_fisheye_needs_its_focal_length(tmp_path):
    angle = {key: value for key, value in LENS.items() if not key.startswith("fl")} | {"camera_angle_x": 2.0}
    with pytest.raises(InputError, match="has no focal length: write fl_x"):
        imported(scene(tmp_path / "n", angle | {"camera_model": "OPENCV_FISHEYE", "frames": frames()}))


@pytest.mark.parametrize(
    ("suffix", "fix"),
    [(".bmp", "convert it to JPEG, PNG or TIFF"), (".avif", "convert AVIF to JPEG or TIFF")],
)
def test_a_photograph_of_an_unread_kind_is_named_with_its_fix(tmp_path, suffix, fix):
    folder = scene(tmp_path / "n", LENS | {"frames": changed(file_path=f"images/1{suffix}")["frames"]})
    (folder / "images" / f"1{suffix}").write_bytes(b"BM")
    said = rf"images/1{suffix}, which the layout names, is no picture that rig reads: {fix}\.$"
    with pytest.raises(InputError, match=said):
        imported(folder)
    assert not (tmp_path / "s").exists()


def changed(**values):
    some = frames()
    some[1] |= values
    return LENS | {"frames": some}


def turned(change) -> list:
    motion = looking_at(CENTRES[1])
    return (motion @ np.array(change, float)).tolist()


BAD = {
    "not JSON": ("{", "cannot be read as JSON"),
    "a list": ([1, 2], "has no list of frames"),
    "frames of text": ({"frames": ["a"]}, "has no list of frames"),
    "deep": ("[" * 100_000, "cannot be read as JSON"),
    "no pose": (changed(transform_matrix=None), "frame 1 of .* has no transform_matrix"),
    "three rows": (changed(transform_matrix=np.eye(3).tolist()), "has no transform_matrix"),
    "ragged": (changed(transform_matrix=[[1, 0], [1]]), "has no transform_matrix"),
    "NaN": (changed(transform_matrix=turned(np.diag([1, 1, np.nan, 1]))), "frame 1 .* finite numbers"),
    "all zero": (changed(transform_matrix=np.zeros((4, 4)).tolist()), "frame 1 .* finite numbers"),
    "mirrored": (changed(transform_matrix=turned(np.diag([-1, 1, 1, 1]))), "scales, shears or mirrors"),
    "scaled": (changed(transform_matrix=turned(np.diag([2, 2, 2, 1]))), "scales, shears or mirrors"),
    "too far": (changed(transform_matrix=turned(np.eye(4) + 1e12 * np.eye(4, k=3))), "impossible pose"),
    "huge": (changed(transform_matrix=[[10**400] * 4] * 4), "has no transform_matrix"),
    "no name": (changed(file_path=""), "frame 1 of .* has no file_path"),
    "outside": (changed(file_path="../secret.png"), "leads out of"),
    "absolute": (changed(file_path="/etc/passwd"), "leads out of"),
    "twice": (changed(file_path="images/0.png"), "a second time"),
    "a word": (changed(fl_x="70"), "fl_x that is not a finite number"),
    "no focal length": ({"w": 64, "h": 48, "frames": frames()}, "no focal length"),
    "negative focal length": (changed(fl_x=-70.0), "lens that cannot be"),
    "endless focal length": (changed(fl_x=1e300), "lens that cannot be"),
    "infinite": (changed(cx=float("inf")), "cx that is not a finite number"),
    "huge whole number": (changed(cx=10**400), "cx that is not a finite number"),
    "no size": (changed(w=0), "size of 0x48"),
    "wrong size": (changed(w=48, h=64), "has 64x48 pixels but .* says 48x64"),
    "no time": (changed(exposure_time=0), "exposure_time of 0 s"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_is_refused_in_one_sentence_and_leaves_nothing(tmp_path, name):
    value, sentence = BAD[name]
    with pytest.raises(InputError, match=sentence) as caught:
        imported(scene(tmp_path / "n", value))
    assert "\n" not in str(caught.value)
    assert {path.name for path in tmp_path.iterdir()} == {"n"}


# Anything that JSON can say, and a little that it cannot.
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)
KEYS = [
    "file_path",
    "is_fisheye",
    "transform_matrix",
    "camera_model",
    "exposure_time",
    "camera_angle_x",
    "x_fov",
    "distortion_params",
    "rolling_shutter",
    "transform_matrix_start",
    "transform_matrix_end",
    "from_mitsuba",
    "applied_scale",
    "n_frames",
    "time",
    "latlong",
    *LENS,
    *TERMS,
]


@given(top=st.dictionaries(st.sampled_from(KEYS), JSON), frame=st.dictionaries(st.sampled_from(KEYS), JSON))
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_any_value_of_any_key_is_read_or_refused(tmp_path_factory, top, frame):
    folder = tmp_path_factory.mktemp("any")
    whole = LENS | {"frames": frames()[:1]}
    changed_top = whole | top | {"frames": [whole["frames"][0] | frame]}
    try:
        layout = nerfstudio.read(scene(folder, changed_top, photos=1))
    except InputError as error:
        sentence = str(error)
    else:
        sentence = "; ".join(layout.missing)
        assert len(layout.photos) + len(layout.missing) == 1
    assert len(sentence) < 1000
