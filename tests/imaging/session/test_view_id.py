"""A view has one name, one order and one text, which are read again as they were written."""

import pytest

from imaging.errors import InputError
from imaging.record import Record, parse
from imaging.session.view_id import ViewId, ViewText

VIEW = ViewId(3, "left")


class Lost(Record):
    views: tuple[ViewText, ...]


def test_views_are_in_order_of_frames_and_then_of_cameras() -> None:
    views = [ViewId(10, "a"), ViewId(2, "b"), ViewId(2, "a")]
    assert sorted(views) == [ViewId(2, "a"), ViewId(2, "b"), ViewId(10, "a")]


@pytest.mark.parametrize("view", [VIEW, ViewId(12345, "a.b-c_1"), ViewId(0, "0")])
def test_names_of_views_and_of_their_images_are_read_as_they_are_written(view: ViewId) -> None:
    assert ViewId.parse(str(view)) == view
    assert ViewId.of_image(view.image_name) == view


def test_a_view_is_called_by_frame_and_camera_and_its_image_lies_in_the_folder_of_its_camera() -> None:
    assert (str(VIEW), VIEW.image_name) == ("0003/left", "left/0003.png")


@pytest.mark.parametrize("text", ["", "left", "left/0003", "0003/", "/left", "-1/left"])
def test_another_text_is_no_view(text: str) -> None:
    with pytest.raises(ValueError, match="FRAME/CAMERA"):
        ViewId.parse(text)


@pytest.mark.parametrize("name", ["", "0003.png", "left/0003.jpg", "left/three.png", "left/.png"])
def test_another_image_is_of_no_view(name: str) -> None:
    with pytest.raises(ValueError, match=r"CAMERA/FRAME\.png"):
        ViewId.of_image(name)


def test_records_hold_views_as_text() -> None:
    record = Lost(views=(VIEW,))
    assert record.model_dump(mode="json") == {"views": ["0003/left"]}
    assert parse(Lost, record.model_dump(mode="json"), "lost.json") == record
    with pytest.raises(InputError, match=r"lost\.json: views\.0: .*frame/camera"):
        parse(Lost, {"views": ["left/0003"]}, "lost.json")
