"""Nodes that compute: SwissKnife, IntSwissKnife, Converter, IntConverter."""

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
            variable = self._node.variables.get(name)
            if variable is not None:
                self._values[name] = numeric(self._node.around.find(variable).value())
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
        if not target.whole:
            target.set(there)
            return
        limits = target.limits()
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
