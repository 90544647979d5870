"""Requests of stages: made of keywords, checked by type before any work begins."""

import inspect
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import pytest

import rig
from imaging.arguments import checked
from imaging.errors import InputError
from imaging.request import Request, forgets, value_of


@dataclass(frozen=True)
class Wanted(Request):
    size: Annotated[int | None, "How large."] = None
    kind: Annotated["Literal['a', 'b'] | Later", "Which."] = "a"


DEFAULT = Wanted()


@checked
def stage(subject: str, request: Wanted = DEFAULT, **options: Any) -> Wanted:
    return request


class Later:
    """Named by the request before it is there."""


def test_options_are_those_of_a_request_of_keywords_and_of_both() -> None:
    assert stage("S") == DEFAULT
    assert stage("S", Wanted(3)) == stage("S", size=3) == Wanted(size=3, kind="a")
    assert stage("S", Wanted(3, "b"), size=4) == Wanted(4, "b")
    assert stage("S", request=Wanted(3)) == stage("S", 3) == Wanted(3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"length": 3}, "no option 'length': give any of size, kind"),
        ({"size": "3"}, "stage cannot take '3' for size: give it a whole number or None"),
        ({"kind": "c"}, "one of 'a', 'b' or a Later"),
        ({"request": "c"}, "stage cannot take 'c' for size"),
        ({"request": Wanted(size=2.5)}, "stage cannot take 2.5 for size"),
    ],
)
def test_what_is_no_option_or_of_a_wrong_type_is_one_sentence(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        stage("S", **options)


def test_none_is_forgotten_as_text_and_as_a_path_and_the_rest_is_a_value() -> None:
    assert [forgets(value) for value in ("none", Path("none"), None, "nones")] == [True, True, False, False]
    assert [value_of(value) for value in ("none", None, "table.csv")] == [None, None, "table.csv"]


REQUESTS = [name for name in rig.__all__ if name.endswith("Request")]


@pytest.mark.parametrize("name", REQUESTS)
def test_every_option_of_a_request_has_a_type_a_default_and_a_help(name: str) -> None:
    for field in fields(getattr(rig, name)):
        assert get_origin(field.type) is Annotated, field.name
        assert get_args(field.type)[1].endswith((".", "]")), field.name
        assert field.default is not MISSING or field.default_factory is not MISSING


FUNCTIONS = [name for name in rig.__all__ if inspect.isfunction(getattr(rig, name)) and name != "rasterize"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_no_public_function_has_more_than_seven_parameters(name: str) -> None:
    """Besides those that tell of progress; the rasteriser takes the tensors of Gaussians one by one."""
    parameters = inspect.signature(getattr(rig, name)).parameters.keys() - {"on_progress", "on_message"}
    assert len(parameters) <= 7
