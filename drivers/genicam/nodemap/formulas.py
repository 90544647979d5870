"""Nodes that compute: SwissKnife, IntSwissKnife, Converter, IntConverter."""

import math
import sys
from collections.abc import Iterator, Mapping

from drivers.errors import CameraProtocol
from drivers.genicam.nodemap.description import Element
from drivers.genicam.nodemap.formula import Formula, Number, parse
from drivers.genicam.nodemap.nodes import UNLIMITED, Limits, Node, Surroundings, Value, numeric


class _Variables(Mapping[str, Number]):
    """The variables, constants and expressions of a node, found out when a formula first uses them."""

    def __init__(self, node: "Computing", given: dict[str, Number]) -> None:
        self._node, self._values = node, given

    def __getitem__(self, name: str) -> Number:
        if name not in self._values:
            if name in self._node.variables:
                self._values[name] = self._node.variable(name)
            else:
                self._values[name] = self._node.expressions[name](self)
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter((*self._values, *self._node.variables, *self._node.expressions))

    def __len__(self) -> int:
        return len(list(iter(self)))


class Computing(Node):
    """Variables of formulas, each read once."""

    def __init__(self, element: Element, around: Surroundings) -> None:
        super().__init__(element, around)
        self.whole_numbers = element.tag.startswith("Int")
        self.variables = {child.name: child.text for child in element.all("pVariable")}
        self.expressions = {
            child.name: self.formula(child.text)
            for child in (*element.all("Constant"), *element.all("Expression"))
        }

    def formula(self, text: str | None) -> Formula:
        """A formula of this node's kind. CameraProtocol if it is missing or makes no sense."""
        if text is None:
            raise CameraProtocol("a formula is missing")
        return parse(text, whole=self.whole_numbers)

    def variable(self, name: str) -> Number:
        """The value of a variable's node, or what its name asks of that: a limit or the step, as X.Max and
        X.Inc do, or the number of an entry, as X.Entry.Mono8 does.

        CameraProtocol if the node has no such step or entry.
        """
        node = self.around.find(self.variables[name])
        if entry := name.partition(".Entry.")[2]:
            return node.entry(entry)
        ending = name.rpartition(".")[2]
        if "." not in name or ending not in ("Min", "Max", "Inc"):
            return numeric(node.value())
        whole = self.whole_numbers or node.whole
        values, key = self.around.values, (node, ending, whole)
        if key not in values:
            values[key] = _step(node, whole) if ending == "Inc" else _limit(node, ending, whole)
        return numeric(values[key])

    def compute(self, formula: Formula, **given: Number) -> Number:
        """The value of a formula."""
        return formula(_Variables(self, given))


def _limit(node: Node, ending: str, whole: bool) -> Number:
    """Min or Max of a node; one that is not stated is that of the numbers of its kind, as in GenICam."""
    limits = node.limits()
    low, high = (-(1 << 63), (1 << 63) - 1) if whole else (-sys.float_info.max, sys.float_info.max)
    return min(max(limits.low if ending == "Min" else limits.high, low), high)


def _step(node: Node, whole: bool) -> Number:
    step = node.limits().step or (1 if whole else None)
    if step is None:
        raise CameraProtocol(
            f"a formula needs the Inc of {node.element.name}, which has none: update the firmware"
        )
    return step


class SwissKnife(Computing):
    """SwissKnife and IntSwissKnife: a value computed from others."""

    def __init__(self, element: Element, around: Surroundings) -> None:
        super().__init__(element, around)
        self._formula = self.formula(element.first("Formula"))

    def get(self) -> Number:
        """The value."""
        return self.compute(self._formula)

    def target_access(self) -> str:
        """Access mode: read only."""
        return "RO"


class Converter(Computing):
    """Converter and IntConverter: another node's value in other units; FROM is here, TO is there."""

    def __init__(self, element: Element, around: Surroundings) -> None:
        super().__init__(element, around)
        self._there = self.formula(element.first("FormulaTo"))
        self._here = self.formula(element.first("FormulaFrom"))

    def behind(self) -> Node | None:
        """The node that keeps the value, in other units."""
        return self.refer("pValue")

    def _target(self) -> Node:
        target = self.behind()
        if target is None:
            raise CameraProtocol("it has no pValue")
        return target

    def target_access(self) -> str:
        """Access mode of the node behind."""
        return {"R": "RO", "W": "WO"}.get(self._target().access(), "RW")

    def get(self) -> Number:
        """The value in this node's units."""
        return self.compute(self._here, TO=numeric(self._target().value()))

    def set(self, value: Value) -> None:
        """Set the node behind; where that takes whole numbers or goes in steps, to the nearest."""
        there = self.compute(self._there, FROM=numeric(value))
        target = self._target()
        try:
            limits = target.limits()
        except CameraProtocol:  # the formula of a converter need not have a value at its ends
            limits = Limits(-UNLIMITED, UNLIMITED)
        if not target.whole:
            drawn_in = min(max(there, limits.low), limits.high)
            # Beyond the ends it is refused; an end that went through both formulas may miss it by rounding.
            missed = not math.isclose(drawn_in, there, rel_tol=1e-9, abs_tol=1e-12)
            target.set(there if missed else drawn_in)
            return
        step = limits.step or 1
        # Beyond the ends it is refused, not drawn in; a rounded formula may miss an end by less than a step.
        inside = limits.low - step < there < limits.high + step
        target.set(limits.nearest(there, whole=True) if inside else round(there))

    def limits(self) -> Limits:
        """Limits of the node behind, converted; a falling slope swaps them."""
        behind = self._target().limits()
        if UNLIMITED in (behind.high, -behind.low):
            return Limits(-UNLIMITED, UNLIMITED)
        low, high = sorted(self.compute(self._here, TO=end) for end in (behind.low, behind.high))
        return Limits(low, high)
