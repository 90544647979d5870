"""`import rig`: every name it promises is there, and is what it says."""

import pytest

import rig


@pytest.mark.parametrize("name", rig.__all__)
def test_every_public_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(rig, name)
    assert value.__doc__
    assert name in dir(rig)


def test_names_are_those_of_their_stages() -> None:
    from capture.check import check
    from imaging.errors import RigError

    assert rig.check is check
    assert rig.RigError is RigError


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="frobnicate"):
        rig.frobnicate  # noqa: B018


def test_every_lazy_name_is_public() -> None:
    assert set(rig._HOMES) == set(rig.__all__)
