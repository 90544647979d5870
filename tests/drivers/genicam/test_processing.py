"""In-camera processing is switched off and read back, or the camera is refused."""

import pytest

from drivers.errors import CameraRefused
from drivers.genicam.processing import STAGES, switch_off
from drivers.genicam.settings import prepare

from .nodemap.nodes import node_map


def switch(name: str, on: int = 1, more: str = "") -> str:
    return f'<Boolean Name="{name}">{more}<Value>{on}</Value></Boolean>'


def amount(name: str, value: float, more: str = "") -> str:
    return f'<Float Name="{name}">{more}<Value>{value}</Value><Min>-10</Min><Max>10</Max></Float>'


def choice(name: str, value: int, *entries: str) -> str:
    inside = "".join(
        f'<EnumEntry Name="{one}"><Value>{at}</Value></EnumEntry>' for at, one in enumerate(entries)
    )
    return f'<Enumeration Name="{name}">{inside}<Value>{value}</Value></Enumeration>'


LOCKED = "<ImposedAccessMode>RO</ImposedAccessMode>"


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_every_switch_and_amount_is_put_where_it_does_nothing(stage) -> None:  # type: ignore[no-untyped-def]
    for name in stage.switches:
        nodes = node_map(switch(name) + choice(f"{name}Other", 1, "Off", "On"))
        switch_off(nodes, "cam0")
        assert nodes.number(name) == 0
        off = "Timed" if name.startswith("ExposureMode") else "Off"
        for entries in ((off, "On"), (off.upper(), "ON"), (f"{name}_{off}", f"{name}_On")):
            nodes = node_map(choice(name, 1, *entries))
            switch_off(nodes, "cam0")
            assert nodes.text(name) == entries[0]
    for name, neutral in stage.amounts:
        nodes = node_map(amount(name, 2.5))
        switch_off(nodes, "cam0")
        assert nodes.number(name) == neutral


@pytest.mark.parametrize(
    ("inside", "why"),
    [
        (amount("Gamma", 0.8, LOCKED), r"by its gamma .*\(Gamma is 0\.8\)"),
        (switch("GammaEnable", 1, LOCKED) + amount("Gamma", 1.0), r"\(GammaEnable is True\)"),
        (switch("LUTEnable", 1, LOCKED), r"by its lookup table .*\(LUTEnable is True\)"),
        ('<Integer Name="DigitalShift"><Value>2</Value><Min>1</Min></Integer>', r"by its digital shift"),
        (switch("ProcessedRawEnable", 1, LOCKED), r"signal processor .*\(ProcessedRawEnable is True\)"),
        (switch("ReverseX", 1, LOCKED), r"by its mirroring .*\(ReverseX is True\)"),
        (amount("ScalingVerticalAbs", 0.5, LOCKED), r"by its scaling .*\(ScalingVerticalAbs is 0\.5\)"),
        (choice("ExposureMode", 1, "Timed", "PieceWiseLinearHDR").replace("><Enum", f">{LOCKED}<Enum", 1),
         r"exposures .*\(ExposureMode is PieceWiseLinearHDR\)"),
        (choice("ExposureAuto", 1, "Off", "On").replace("><Enum", f">{LOCKED}<Enum", 1), "automatic exp"),
    ],
)  # fmt: skip
def test_what_stays_on_is_a_refusal(inside: str, why: str) -> None:
    with pytest.raises(CameraRefused, match=f"^cam0 changes every frame .*{why}.*switch it off"):
        switch_off(node_map(inside), "cam0")


def test_what_is_off_may_stay_as_it_is() -> None:
    """A gamma that is not applied, corrections of single pixels, and a switch that is none."""
    nodes = node_map(
        switch("GammaEnable", 0, LOCKED)
        + amount("Gamma", 0.45, LOCKED)
        + switch("DefectCorrectStaticEnable", 1, LOCKED)
        + choice("ContrastMode", 1, "Soft", "Hard")
        + switch("SaturationEnable", 1, LOCKED)
        + '<Category Name="FlatFieldCorrection"/>'
    )
    switch_off(nodes, "cam0")
    assert nodes.number("Gamma") == 0.45


def test_containers_are_switched_off() -> None:
    nodes = node_map(choice("PixelFormat", 0, "Mono8") + choice("GenDCStreamingMode", 1, "Off", "On"))
    assert prepare(nodes, "cam0").name == "Mono8"
    assert nodes.text("GenDCStreamingMode") == "Off"
