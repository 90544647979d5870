"""Nodes that compute: SwissKnife, IntSwissKnife, Converter, IntConverter."""

import math
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
        """The value of a variable's node, or the limit or step of it that the name ends in, as in X.Max.

        CameraProtocol if the node has no such limit or step.
        """
        node, ending = self.around.find(self.variables[name]), name.rpartition(".")[2]
        if "." not in name or ending not in ("Min", "Max", "Inc"):
            return numeric(node.value())
        values = self.around.values
        if (node, ending) not in values:
            limits = node.limits()
            step = limits.step or (1 if node.whole else None)
            asked = {"Min": limits.low, "Max": limits.high, "Inc": step}[ending]
            if asked is None or not math.isfinite(asked):
                raise CameraProtocol(
                    f"a formula needs the {ending} of {node.element.name}, which has none: update the "
                    "firmware"
                )
            values[node, ending] = asked
        return numeric(values[node, ending])

    def compute(self, formula: Formula, **given: Number) -> Number:
        """The value of a formula."""
        return formula(_Variables(self, given))


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
        limits = target.limits()
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
