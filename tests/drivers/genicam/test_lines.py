"""Trigger lines of descriptions that leave something out."""

import pytest

from drivers.genicam import lines

from .nodemap.nodes import Bytes, node_map
from .test_units import held, number

TRIGGER = (
    '<Enumeration Name="TriggerSource"><EnumEntry Name="Software"><Value>0</Value></EnumEntry>'
    '<Value>0</Value></Enumeration><Enumeration Name="TriggerMode"><EnumEntry Name="Off"><Value>0</Value>'
    '</EnumEntry><EnumEntry Name="On"><Value>1</Value></EnumEntry><Value>0</Value></Enumeration>'
)


@pytest.mark.parametrize(("low", "delay"), [("-inf", 0), ("-5", 0), ("0", 0), ("2", 2)])
def test_a_trigger_delays_as_little_as_it_can(low: str, delay: float) -> None:
    memory = Bytes()
    description = TRIGGER + number("TriggerDelay", "us", 1, 1e6).replace("<Min>1</Min>", f"<Min>{low}</Min>")
    nodes = node_map(description, memory)
    nodes.set("TriggerDelay", 1000.0)
    lines.apply(nodes, "camera 1", lines.Wiring())
    assert held(memory) == delay
    assert nodes.text("TriggerMode") == "On"
