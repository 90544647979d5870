"""Nodes whose value another node keeps: Integer, Float, Boolean, Enumeration, Command, String."""

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap.description import Element
from drivers.genicam.nodemap.formula import Number
from drivers.genicam.nodemap.nodes import UNLIMITED, Limits, Node, Value, as_number, integral, numeric


class Holder(Node):
    """A node whose value is in itself, in the node of pValue, or in one chosen by pIndex."""

    _stored: Value | None = None

    def behind(self) -> Node | None:
        """The node that keeps the value."""
        index = self.refer("pIndex")
        if index is None:
            return self.refer("pValue")
        chosen = self._indexed("pValueIndexed", index)
        return self.refer("pValueDefault") if chosen is None else self.around.find(chosen)

    def target_access(self) -> str:
        """Access mode of the node that keeps the value; a value of its own can be read and set."""
        target = self.behind()
        if target is None:
            return "RW"
        return {"R": "RO", "W": "WO"}.get(target.access(), "RW")

    def unit(self) -> str:
        """Its own unit, else that of the node that keeps the value."""
        target = self.behind()
        return super().unit() or ("" if target is None else target.unit())

    def literal(self) -> Number:
        """The value where no other node keeps it."""
        index = self.refer("pIndex")
        chosen = None if index is None else self._indexed("ValueIndexed", index)
        if chosen is not None:
            return as_number(chosen)
        value = self.number("Value" if index is None else "ValueDefault")
        if value is None:
            raise CameraProtocol("it has no value")
        return value

    def _indexed(self, tag: str, index: Node) -> str | None:
        """The text of the child whose Index is the value of that node, if there is one."""
        place = integral(index.value())
        for child in self.element.all(tag):
            if as_number(child.attributes.get("Index", "")) == place:
                return child.text
        return None

    def raw(self) -> Value:
        """Return what the node behind gives, or the value of its own."""
        target = self.behind()
        if target is not None:
            return target.value()
        return self.literal() if self._stored is None else self._stored

    def put(self, value: Value) -> None:
        """Give a value to the node behind and to the copies, or keep it."""
        target = self.behind()
        if target is None:
            self._stored = value
            self.around.values.clear()
        else:
            if isinstance(value, float) and target.whole:  # a fraction for what counts in whole steps
                value = target.limits().nearest(value, whole=True)
            target.set(value)
        for copy in self.element.all("pValueCopy"):
            self.around.find(copy.text).set(value)

    def limits(self) -> Limits:
        """Min, Max and Inc of its own, else those of the node behind."""
        target = self.behind()
        behind = Limits(-UNLIMITED, UNLIMITED) if target is None else target.limits()
        low, high, step = self.number("Min"), self.number("Max"), self.number("Inc")
        return Limits(
            behind.low if low is None else max(low, behind.low),
            behind.high if high is None else min(high, behind.high),
            behind.step if step is None else step,
            self._listed() or behind.values,
        )

    def _listed(self) -> tuple[float, ...]:
        """The only values that it takes, where it lists them."""
        text = self.element.first("ValidValueSet") or ""
        return tuple(float(as_number(one)) for one in text.split(";") if one.strip())


class Integer(Holder):
    """Integer."""

    def get(self) -> int:
        """The number."""
        return integral(self.raw())

    def set(self, value: Value) -> None:
        """Set the number, which must keep to the limits."""
        number = numeric(value)
        if number != int(number):
            raise CameraRefused(f"{value} is no whole number: give another value")
        self.limits().check(int(number))
        self.put(int(number))


class Float(Holder):
    """Float."""

    def get(self) -> float:
        """The number."""
        return float(numeric(self.raw()))

    def set(self, value: Value) -> None:
        """Set the number, which must keep to the limits; steps are the device's own affair."""
        number = float(numeric(value))
        limits = self.limits()
        Limits(limits.low, limits.high).check(number)
        self.put(number)


class Boolean(Holder):
    """Boolean: 1 or 0."""

    def get(self) -> int:
        """Return whether the node behind has the OnValue."""
        on = self.integer("OnValue")
        return int(self.raw() == (1 if on is None else on))

    def set(self, value: Value) -> None:
        """Set to OnValue or OffValue."""
        on, off = self.integer("OnValue"), self.integer("OffValue")
        self.put((1 if on is None else on) if value else (0 if off is None else off))

    def literal(self) -> Number:
        """true, false or a number."""
        words = {"true": 1, "false": 0}
        word = words.get((self.element.first("Value") or "").lower())
        return super().literal() if word is None else word


class Enumeration(Holder):
    """Enumeration: a number whose values have names."""

    def entries(self) -> dict[str, int]:
        """The available entries and their numbers."""
        entries = {}
        for element in self.element.all("EnumEntry"):
            entry = Node(element, self.around)
            value = entry.integer("Value")
            if value is not None and entry.available():
                entries[self._symbolic(element)] = value
        return entries

    def entry(self, name: str) -> int:
        """The number of the entry of that name, available or not."""
        for element in self.element.all("EnumEntry"):
            number = Node(element, self.around).integer("Value")
            if number is not None and self._symbolic(element) == name:
                return number
        return super().entry(name)

    def get(self) -> int:
        """The number."""
        return integral(self.raw())

    def name(self) -> str:
        """The entry, an available one if several have the number. CameraProtocol if the number has none."""
        number = self.get()
        entries = [Node(element, self.around) for element in self.element.all("EnumEntry")]
        named = [entry for entry in entries if entry.integer("Value") == number]
        if not named:
            raise CameraProtocol(f"its value {number} has no name")
        if len(named) > 1:  # else it has the name even where its availability cannot be read
            named.sort(key=lambda entry: not entry.available())
        return self._symbolic(named[0].element)

    def set(self, value: Value) -> None:
        """Choose an entry by its name or number."""
        entries = self.entries()
        number = entries.get(value) if isinstance(value, str) else int(value)
        if number is None or number not in entries.values():
            raise CameraRefused(f"{value!r} is not offered: choose among {', '.join(entries)}")
        self.put(number)

    @staticmethod
    def _symbolic(entry: Element) -> str:
        """The name by which an entry is chosen; its node may have another."""
        return entry.first("Symbolic") or entry.name


class Command(Holder):
    """Command: writing its value does something."""

    def execute(self) -> None:
        """Execute the command."""
        self.put(self._command())

    def done(self) -> bool:
        """Return whether the device has taken the value back; true where that cannot be read."""
        target = self.behind()
        return target is None or "R" not in target.access() or target.value() != self._command()

    def _command(self) -> int:
        value = self.integer("CommandValue")
        if value is None:
            raise CameraProtocol("it has no CommandValue")
        return value


class String(Holder):
    """String."""

    def get(self) -> str:
        """The text."""
        return str(self.raw())

    def set(self, value: Value) -> None:
        """Set the text."""
        self.put(str(value))

    def raw(self) -> Value:
        """The text of its own is not read as a number."""
        return (self.element.first("Value") or "") if self._text_is_stored() else super().raw()

    def _text_is_stored(self) -> bool:
        return self.behind() is None and self._stored is None
