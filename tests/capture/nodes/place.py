"""A rig of simulated cameras on two nodes, of one process and on one virtual clock."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from capture.capture_rig import capture_rig
from capture.connected_rig import Unattended
from capture.record.capture_result import CaptureResult
from capture.record.shooting import shoot
from capture.request import CaptureRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import RigFile, read_rig_file
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.usb.virtual_clock import VirtualClock
from tests.capture.nodes.nearby import NearLink, near_node
from tests.trees import tree

RIG = """
frames = 2
[bracket]
exposures = [-4, 0]
time = "1/60"
f_number = 8
[trigger]
mode = "software"
tolerance = 0.005
"""
CAMERA = """
[[camera]]
name = "{name}"
serial = "{serial}"
rig = "rig"
node = "{node}"
"""
NODES = {"left": 71.5, "right": -1234.25}
"""Their clocks: s ahead of the leader's."""


@dataclass
class Place:
    """A rig file of cameras on two nodes, as they are started for each capture."""

    folder: Path
    text: str = RIG
    cameras: int = 2
    model: str = "generic"
    said: list[str] = field(default_factory=list)
    links: dict[str, NearLink] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    ways: dict[str, float] = field(default_factory=dict)
    jumps: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    clock: VirtualClock = field(default_factory=VirtualClock)

    @property
    def file(self) -> RigFile:
        names = list(NODES)
        cameras = [
            CAMERA.format(name=f"cam{n}", serial=f"SIM-RAW-{n + 1:03d}", node=names[n % 2])
            for n in range(self.cameras)
        ]
        path = self.folder / "RIG.toml"
        path.write_text(self.text + "".join(cameras))
        return read_rig_file(path)

    def start(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.links = {
            name: near_node(
                name,
                assignment,
                clock,
                self.folder,
                ahead=NODES[name],
                jumps=self.jumps.get(name, ()),
                there=self.ways.get(name, 0.0004),
                back=self.ways.get(name, 0.0009),
                cameras=self.cameras,
                model=self.model,
                **self.options,
            )
            for name, assignment in assignments_of(self.file).items()
        }

    def shoot(self, out: str = "nodes", prepare=lambda place: None, **options: Any) -> CaptureResult:
        clock = VirtualClock()
        self.start(clock)
        prepare(self)
        request = CaptureRequest(**options)
        try:
            with nodes_source(
                self.file, request, self.links, person=Unattended(), clock=clock, say=self.said.append
            ) as source:
                return shoot(source, self.folder / out, request)
        finally:
            for link in self.links.values():
                link.close()

    def shoot_without_nodes(self, out: str = "alone", **options: Any) -> CaptureResult:
        rig = simulate("toy", 3, samples=1, cameras=self.cameras)
        bus = BusRig(rig, model=self.model)
        return capture_rig(
            self.file,
            self.folder / out,
            operator=rig,
            positions=rig.frames,
            backend=bus.backend,
            clock=bus.clock,
            **options,
        )

    def files(self, out: str) -> dict[str, bytes]:
        return tree(self.folder / out, "*.dng")
