"""The simulated camera's description, judged by what others wrote, over the simulated camera's memory.

Package `genicam` is the GenICam committee's own implementation; `arv-tool` is Aravis's.
"""

import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from drivers.genicam.nodemap.formula import parse
from drivers.u3v.registers import Abrm, read_xml
from drivers.u3v.session import open_session
from tests.drivers.genicam.judge import judge_of
from tests.drivers.genicam.nodemap.test_formula import BOTH, FLOAT, WHOLE
from tests.drivers.gige.fakes import port_of_aravis

from .conftest import MakeBench

HEAD = (
    '<RegisterDescription ModelName="A" VendorName="B" ToolTip="" StandardNameSpace="None" '
    'SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" '
    'MinorVersion="0" SubMinorVersion="0" ProductGuid="76543210-3210-3210-3210-ba9876543210" '
    'VersionGuid="76543210-3210-3210-3210-ba9876543210" '
    'xmlns="http://www.genicam.org/GenApi/Version_1_1">'
)


@pytest.fixture(scope="module")
def genapi() -> Any:
    return pytest.importorskip("genicam.genapi", reason="the package genicam is not installed")


def test_the_committees_evaluator_agrees_on_formulas(genapi: Any) -> None:
    def judged(text: str, kind: str) -> float:
        safe = text.replace("&", "&amp;").replace("<", "&lt;")
        nodes = genapi.NodeMap()
        nodes.load_xml_from_string(
            f'{HEAD}<{kind} Name="F"><Formula>{safe}</Formula></{kind}></RegisterDescription>'
        )
        return float(nodes.get_node("F").value)

    for text in BOTH | WHOLE:
        assert judged(text, "IntSwissKnife") == parse(text, whole=True)({}), text
    for text in BOTH | FLOAT:
        assert judged(text, "SwissKnife") == pytest.approx(parse(text, whole=False)({})), text


def test_the_committees_node_map_agrees_on_every_feature(genapi: Any, make_bench: MakeBench) -> None:
    bench = make_bench()
    session = open_session(bench.serial, bench.bus, bench.clock)
    memory = bench.device._memory
    control = session.stream._control
    xml = read_xml(control, control.read_number(Abrm.MANIFEST, 8)).decode()

    judge, _port = judge_of(genapi, xml, memory.read, control.write)
    ours = session.nodes
    ours.set("DeviceLinkThroughputLimitMode", "On")
    ours.set("LineMode", "Output")
    readable = 0
    for name in ours.features():
        node = judge.get_node(name)
        kind = type(node).__name__
        if kind == "ICommand" or name == "ChunkExposureTime":
            continue
        readable += 1
        if kind == "IEnumeration":
            assert (node.value, tuple(node.symbolics)) == (ours.text(name), ours.entries(name)), name
        elif kind == "IString":
            assert node.value == ours.text(name)
        else:
            assert float(node.value) == pytest.approx(float(ours.number(name))), name
        if kind in ("IInteger", "IFloat"):
            limits = ours.limits(name)
            for end, judged in ((limits.low, node.min), (limits.high, node.max)):
                # What is unlimited is the largest number there.
                if math.isfinite(end):
                    assert float(judged) == pytest.approx(end), name
    assert readable > 30

    # Set by the judge, read by us, and the other way round.
    judge.get_node("ExposureTime").value = 15625.0
    judge.get_node("Gain").value = 20 * math.log10(4)
    judge.get_node("TriggerSelector").value = "FrameBurstStart"
    judge.get_node("TriggerSource").value = "Line1"
    judge.get_node("OffsetX").value = 0
    judge.get_node("Width").value = 31
    assert ours.number("ExposureTime") == 15625.0
    assert ours.number("Gain") == pytest.approx(20 * math.log10(4))
    assert (ours.text("TriggerSelector"), ours.text("TriggerSource")) == ("FrameBurstStart", "Line1")
    assert ours.limits("OffsetX").high == 33
    ours.set("OffsetX", 33)
    ours.set("TriggerSelector", "FrameStart")
    assert judge.get_node("OffsetX").value == 33
    assert judge.get_node("TriggerSource").value == "Software"
    assert judge.get_node("PayloadSize").value == ours.number("PayloadSize") == 31 * 48


def test_aravis_reads_the_description(make_bench: MakeBench, tmp_path: Path) -> None:
    """Aravis's fake camera serves our XML, over registers that are not ours; its tool reads it from there."""
    fake = shutil.which("arv-fake-gv-camera-0.8") or shutil.which("arv-fake-gv-camera-0.10")
    tool = shutil.which("arv-tool-0.8") or shutil.which("arv-tool-0.10")
    if fake is None or tool is None:
        pytest.skip("Aravis (arv-tool and arv-fake-gv-camera) is not installed")
    bench = make_bench()
    session = open_session(bench.serial, bench.bus, bench.clock)
    control, ours = session.stream._control, session.nodes
    xml = tmp_path / "simulated.xml"
    xml.write_bytes(read_xml(control, control.read_number(Abrm.MANIFEST, 8)))

    def ask(*words: str) -> str:
        command = [tool, "-a", "127.0.0.1", *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=20).stdout

    command = [fake, "-i", "127.0.0.1", "-g", xml]
    with port_of_aravis(), subprocess.Popen(command, stdout=subprocess.DEVNULL) as served:
        try:
            listed = next((output for _ in range(20) if "Root" in (output := ask("features"))), "")
            gain = ask("control", "Gain")
        finally:
            served.terminate()
    pairs = re.findall(r"^ *(\w+) +: (?:\[\w\w\] )?'(\w+)'", listed, re.MULTILINE)
    features = [name for kind, name in pairs if kind not in ("Category", "EnumEntry")]
    assert tuple(features) == ours.features()
    entries = sorted(name for kind, name in pairs if kind == "EnumEntry")
    assert entries == sorted(entry for name in features for entry in ours.entries(name))
    # The limits go through the formulas of the converter, whatever the register holds.
    low, high = re.findall(r"min:(\S+) max:(\S+)", gain)[0]
    limits = ours.limits("Gain")
    assert (float(low), float(high)) == pytest.approx((limits.low, limits.high), abs=1e-3)
