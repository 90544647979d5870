"""The formulas of GenICam's SwissKnife and Converter nodes, evaluated without Python's `eval`.

Precedence as the GenICam committee's own evaluator has it (package `genicam` 1.6.0, tried formula by
formula), which is not that of C. Loosest first; equals associate from left to right:

    ? :        then      = <> < > <= >= && ||        then      + -        then      * / %
    then      ** & | ^ << >>        then      - + ~ before a value, calls, parentheses

Two things are otherwise. A sign before a parenthesis belongs to that alone: -(1) + 2 is 1; theirs negates
all that follows. In a chain of choices the second belongs to the else of the first; theirs is the reverse.
Integer formulas compute in 64 bits with wrap-around; a quotient and a remainder go towards zero. In others
`& | ^ << >>` compute in 32 bits with a sign, as makers count on ((V << 16) >> 16 extends a sign); where an
operand needs more than that, theirs has no value, and here it is that of 64 bits.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.errors import CameraProtocol

Number = int | float
Evaluate = Callable[[Mapping[str, Number]], Number]

_TOKEN = re.compile(
    r"\s*(?:(?P<hex>0[xX][0-9a-fA-F]+)|(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_.]*)|(?P<sign>\*\*|<<|>>|<>|<=|>=|==|!=|&&|\|\||[-+*/%&|^~<>=?:(),]))"
)
_LONGEST, _DEEPEST = 10_000, 60
_LEVELS = (
    frozenset(("=", "==", "<>", "!=", "<", ">", "<=", ">=", "&&", "||")),
    frozenset(("+", "-")),
    frozenset(("*", "/", "%")),
    frozenset(("**", "&", "|", "^", "<<", ">>")),
)


def wrapped(value: int) -> int:
    """A whole number as 64 bits with a sign hold it."""
    return (value + (1 << 63)) % (1 << 64) - (1 << 63)


def nearest_whole(value: Number) -> int:
    """The whole number that is nearest, of two the one farther from zero: what counts where one is wanted."""
    if isinstance(value, int) or abs(value) >= 2.0**52:
        return int(value)
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def _on_bits(operator: str, a: Number, b: Number) -> int:
    """Result of an operator on bits outside integer formulas: of 32 bits, where both operands are."""
    values = [int(a), int(b)]
    if not all(-(1 << 31) <= value < 1 << 31 for value in values):
        return int(_BINARY[operator](*values))
    if operator in ("<<", ">>"):
        values[1] &= 31
    return (int(_BINARY[operator](*values)) + (1 << 31)) % (1 << 32) - (1 << 31)


def _quotient(a: Number, b: Number) -> Number:
    if isinstance(a, int) and isinstance(b, int):
        return (abs(a) // abs(b)) * (1 if (a < 0) == (b < 0) else -1)
    return a / b


def _remainder(a: Number, b: Number) -> Number:
    if isinstance(a, int) and isinstance(b, int):
        return a - b * int(_quotient(a, b))
    return math.fmod(a, b)


def _power(a: Number, b: Number) -> Number:
    power = math.pow(a, b)
    if not (isinstance(a, int) and isinstance(b, int)):
        return power
    return int(power) if abs(power) < 2.0**53 else pow(a, b)


def _rounded(value: Number, digits: Number = 0) -> Number:
    """Halves go away from zero."""
    scale = 10.0 ** int(digits)
    return math.copysign(math.floor(abs(value) * scale + 0.5), value) / scale


_BINARY: dict[str, Callable[[Number, Number], Number]] = {
    "=": lambda a, b: int(a == b),
    "==": lambda a, b: int(a == b),
    "<>": lambda a, b: int(a != b),
    "!=": lambda a, b: int(a != b),
    "<": lambda a, b: int(a < b),
    ">": lambda a, b: int(a > b),
    "<=": lambda a, b: int(a <= b),
    ">=": lambda a, b: int(a >= b),
    "&&": lambda a, b: int(bool(a) and bool(b)),
    "||": lambda a, b: int(bool(a) or bool(b)),
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": _quotient,
    "%": _remainder,
    "**": _power,
    "&": lambda a, b: int(a) & int(b),
    "|": lambda a, b: int(a) | int(b),
    "^": lambda a, b: int(a) ^ int(b),
    "<<": lambda a, b: int(a) << (int(b) & 63),
    ">>": lambda a, b: int(a) >> (int(b) & 63),
}
_BITWISE = frozenset(("&", "|", "^", "<<", ">>"))
_UNARY: dict[str, Callable[[Number], Number]] = {
    "-": lambda a: -a,
    "+": lambda a: a,
    "~": lambda a: ~int(a),
}
_FUNCTIONS: dict[str, Callable[..., Number]] = {
    "SGN": lambda a: (a > 0) - (a < 0),
    "NEG": lambda a: -a,
    "ABS": abs,
    "SIN": math.sin,
    "COS": math.cos,
    "TAN": math.tan,
    "ASIN": math.asin,
    "ACOS": math.acos,
    "ATAN": math.atan,
    "EXP": math.exp,
    "LN": math.log,
    "LG": math.log10,
    "SQRT": math.sqrt,
    "TRUNC": math.trunc,
    "FLOOR": math.floor,
    "CEIL": math.ceil,
    "ROUND": _rounded,
}
_CONSTANTS = {"PI": math.pi, "E": math.e}


@dataclass(frozen=True)
class Formula:
    """A parsed formula; `evaluate` gives its value for values of its variables. CameraProtocol."""

    text: str
    whole: bool
    _evaluate: Evaluate

    def __call__(self, variables: Mapping[str, Number]) -> Number:
        """The value; a formula in whole numbers gives an int."""
        try:
            value = self._evaluate(variables)
            if not math.isfinite(value):
                raise ValueError("not finite")
        except (ArithmeticError, ValueError, TypeError, RecursionError) as error:
            raise CameraProtocol(f"the formula {self.text!r} has no value ({error})") from error
        return wrapped(int(value)) if self.whole else float(value)


def parse(text: str, *, whole: bool) -> Formula:
    """Read a formula; `whole` computes in integers of 64 bits. CameraProtocol if it makes no sense."""
    parser = _Parser(text, whole)
    try:
        evaluate = parser.choice(0)
    except RecursionError:
        raise parser.wrong("it is nested too deeply") from None
    if parser.token is not None:
        raise parser.wrong(f"{parser.token!r} is one too many")
    return Formula(text, whole, evaluate)


class _Parser:
    """Recursive descent over the tokens; one method a kind of term."""

    def __init__(self, text: str, whole: bool) -> None:
        self._text, self._whole, self._at = text, whole, 0
        if len(text) > _LONGEST:
            raise self.wrong("it is too long")
        self.kind, self.token = "", None
        self._advance()

    kind: str
    token: str | None

    def wrong(self, why: str) -> CameraProtocol:
        return CameraProtocol(f"the formula {self._text[:80]!r} cannot be read: {why}")

    def _advance(self) -> None:
        match = _TOKEN.match(self._text, self._at)
        if match is None:
            if self._text[self._at :].strip():
                raise self.wrong(f"{self._text[self._at :].strip()[0]!r} means nothing")
            self.token = None
            return
        self._at = match.end()
        self.kind = match.lastgroup or ""
        self.token = match[self.kind]

    def _take(self, token: str) -> bool:
        if self.kind != "sign" or self.token != token:
            return False
        self._advance()
        return True

    def _need(self, token: str) -> None:
        if not self._take(token):
            raise self.wrong(f"{token!r} is missing")

    def choice(self, depth: int) -> Evaluate:
        if depth > _DEEPEST:
            raise self.wrong("it is nested too deeply")
        cases: list[tuple[Evaluate, Evaluate]] = []
        otherwise = self._binary(0, depth)
        while self._take("?"):
            cases.append((otherwise, self.choice(depth + 1)))
            self._need(":")
            otherwise = self._binary(0, depth)
        if not cases:
            return otherwise

        def chosen(variables: Mapping[str, Number]) -> Number:
            for condition, value in cases:
                if condition(variables):
                    return value(variables)
            return otherwise(variables)

        return chosen

    def _binary(self, level: int, depth: int) -> Evaluate:
        if level == len(_LEVELS):
            return self._unary(depth)
        result = self._binary(level + 1, depth)
        while self.kind == "sign" and self.token in _LEVELS[level]:
            operator = self.token
            self._advance()
            result = self._joined(operator, result, self._binary(level + 1, depth))
        return result

    def _joined(self, name: str, left: Evaluate, right: Evaluate) -> Evaluate:
        operator = _BINARY[name]
        # Outside integer formulas all is float, so that 7 / 2 is 3.5 there.
        if self._whole:
            return lambda variables: wrapped(int(operator(left(variables), right(variables))))
        if name in _BITWISE:
            return lambda variables: float(_on_bits(name, left(variables), right(variables)))
        return lambda variables: float(operator(left(variables), right(variables)))

    def _unary(self, depth: int) -> Evaluate:
        if depth > _DEEPEST:
            raise self.wrong("it is nested too deeply")
        if self.kind == "sign" and self.token in _UNARY:
            operator = _UNARY[self.token]
            self._advance()
            operand = self._unary(depth + 1)
            return lambda variables: operator(operand(variables))
        if self._take("("):
            inner = self.choice(depth + 1)
            self._need(")")
            return inner
        return self._atom(depth)

    def _atom(self, depth: int) -> Evaluate:
        token, kind = self.token, self.kind
        if token is None or kind == "sign":
            raise self.wrong("a value is missing")
        self._advance()
        if kind != "name":
            return self._literal(token, kind)
        if self._take("("):
            return self._call(token.upper(), depth)
        constant = None if self._whole else _CONSTANTS.get(token.upper())

        def variable(variables: Mapping[str, Number]) -> Number:
            value = variables.get(token, constant)
            if value is None:
                raise self.wrong(f"{token} is not known")
            return nearest_whole(value) if self._whole else float(value)

        return variable

    def _literal(self, token: str, kind: str) -> Evaluate:
        if kind == "hex":
            number: Number = wrapped(int(token, 16))
        elif token.isdecimal():
            number = wrapped(int(token))
        elif self._whole:
            raise self.wrong(f"{token} is no whole number")
        else:
            number = float(token)
        value = number if self._whole else float(number)
        return lambda variables: value

    def _call(self, name: str, depth: int) -> Evaluate:
        function = _FUNCTIONS.get(name)
        constant = _CONSTANTS.get(name)
        if constant is not None and not self._whole and self._take(")"):
            return lambda variables: constant
        if function is None:
            raise self.wrong(f"there is no function {name}")
        arguments = [self.choice(depth + 1)]
        if name == "ROUND" and self._take(","):
            arguments.append(self.choice(depth + 1))
        self._need(")")
        return lambda variables: function(*(argument(variables) for argument in arguments))
