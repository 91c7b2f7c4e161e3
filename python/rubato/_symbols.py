"""Formulas by tracing: a Python function is called once with symbols, which record what it does with them."""

from __future__ import annotations

import inspect
import math
import numbers
import re

import numpy as np

from . import _core

#: NumPy's and SciPy's names of functions, where they differ from the formula's.
_RENAMED = {
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "arcsinh": "asinh", "arccosh": "acosh",
    "arctanh": "atanh", "absolute": "abs", "fabs": "abs", "minimum": "min", "maximum": "max", "fmin": "min",
    "fmax": "max", "jv": "besselj", "jn": "besselj", "yv": "bessely", "yn": "bessely", "iv": "besseli", "kv": "besselk",
    "kn": "besselk",
}
_FUNCTIONS = frozenset(_core.functions())

#: How tightly an operator binds.
_COMPARISON, _SUM, _PRODUCT, _SIGN, _POWER, _ATOM = 0, 1, 2, 3, 4, 5


class Symbol:
    """An expression in the names of a problem, with Python's operators and NumPy's functions.

    ``str(symbol)`` is the formula. A symbol has no value: it cannot be compared, nor turned into a number.
    """

    __slots__ = ("_head", "_parts", "_size")
    __array_priority__ = 1000.0

    def __init__(self, head: str, parts: tuple = ()):
        self._head = head
        self._parts = parts
        self._size = len(head) + sum(part._size + 2 for part in parts)

    def __str__(self) -> str:
        return _text(self)

    def __repr__(self) -> str:
        return f"Symbol({_text(self)!r})"

    def __add__(self, other):
        return _binary("+", self, other)

    def __radd__(self, other):
        return _binary("+", other, self)

    def __sub__(self, other):
        return _binary("-", self, other)

    def __rsub__(self, other):
        return _binary("-", other, self)

    def __mul__(self, other):
        return _binary("*", self, other)

    def __rmul__(self, other):
        return _binary("*", other, self)

    def __truediv__(self, other):
        return _binary("/", self, other)

    def __rtruediv__(self, other):
        return _binary("/", other, self)

    def __pow__(self, other):
        return _binary("^", self, other)

    def __rpow__(self, other):
        return _binary("^", other, self)

    def __mod__(self, other):
        return call("mod", self, other)

    def __rmod__(self, other):
        return call("mod", other, self)

    def __floordiv__(self, other):
        return call("floor", self / other)

    def __neg__(self):
        return Symbol("neg", (self,))

    def __pos__(self):
        return self

    def __abs__(self):
        return call("abs", self)

    def __bool__(self):
        raise TypeError("a formula cannot branch on its arguments: use where, minimum, maximum or abs")

    def __lt__(self, other):
        return _compared("<", self, other)

    def __le__(self, other):
        return _compared("<=", self, other)

    def __gt__(self, other):
        return _compared(">", self, other)

    def __ge__(self, other):
        return _compared(">=", self, other)

    def __eq__(self, other):
        raise TypeError("a formula cannot ask whether its arguments are equal: use where with <, <=, > or >=")

    __ne__ = __eq__
    __hash__ = object.__hash__

    def __float__(self):
        raise TypeError("a symbol has no value: use NumPy's functions in formulas, numpy.sin in place of math.sin")

    __int__ = __complex__ = __float__

    def conjugate(self):
        return self

    def __array_ufunc__(self, ufunc, method, *inputs, **keywords):
        if method != "__call__" or any(value is not None for value in keywords.values()):
            return NotImplemented
        apply = _ufunc(ufunc.__name__)
        if any(isinstance(value, np.ndarray) and value.ndim > 0 for value in inputs):
            return np.frompyfunc(apply, ufunc.nin, 1)(*(_boxed(value) for value in inputs))
        return apply(*(value.item() if isinstance(value, np.ndarray) else value for value in inputs))

    def __array_function__(self, function, types, arguments, keywords):
        if function is np.where and len(arguments) == 3 and not keywords:
            return where(*arguments)
        if function is np.clip and len(arguments) == 3 and not keywords:
            value, least, most = arguments
            return np.maximum(np.minimum(as_symbol(value), most), least)
        raise TypeError(f"numpy.{function.__name__} has no formula: write it with where, minimum and maximum")


class Condition(Symbol):
    """A comparison of symbols: the first argument of where, or an event."""

    __slots__ = ()

    def _refuse(self, *_):
        raise TypeError("a comparison is no number: it is for where, and for events")

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __mod__ = __rmod__ = __floordiv__ = _refuse
    __hash__ = object.__hash__

    def _combine(self, *_):
        raise TypeError("comparisons do not combine: where(a, where(b, x, y), y) is x where a and b hold, "
                        "where(a, x, where(b, x, y)) where one of them does")

    __and__ = __rand__ = __or__ = __ror__ = __xor__ = __rxor__ = __invert__ = _combine


def _compared(operator: str, left, right) -> Condition:
    return Condition(operator, (as_symbol(left), as_symbol(right)))


def where(condition, a, b):
    """Returns a where the condition holds, else b: of symbols a formula, of arrays what numpy.where does.

    Examples
    --------
    >>> import rubato as rb
    >>> x, = rb.symbols("x")
    >>> str(rb.where(x > 0, x**2, 0))
    'where(x > 0, x^2, 0)'
    """
    if not isinstance(condition, Condition):
        return np.where(condition, a, b)
    return Symbol("call where", (condition, as_symbol(a), as_symbol(b)))


def _boxed(value):
    if isinstance(value, Symbol):
        box = np.empty((), dtype=object)
        box[()] = value
        return box
    return value


def symbols(names) -> tuple:
    """Returns a symbol for each of the names, given as a list or as one text with blanks."""
    return tuple(Symbol(name) for name in (names.split() if isinstance(names, str) else names))


def _number(value) -> Symbol:
    if isinstance(value, bool) or not isinstance(value, (numbers.Real, np.number)):
        raise TypeError(f"a formula takes real numbers, and not {value!r}")
    if isinstance(value, numbers.Integral):
        return Symbol(str(int(value)))
    value = float(value)
    if not math.isfinite(value):
        raise ValueError(f"a formula takes finite numbers, and not {value!r}")
    if value == int(value) and abs(value) < 1e15:
        return Symbol(str(int(value)))
    return Symbol(repr(value))


def as_symbol(value) -> Symbol:
    if isinstance(value, Condition):
        value._refuse()
    return value if isinstance(value, Symbol) else _number(value)


def _is(symbol: Symbol, number: str) -> bool:
    return not symbol._parts and symbol._head == number


def _binary(operator: str, left, right):
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return NotImplemented
    try:
        left, right = as_symbol(left), as_symbol(right)
    except TypeError:
        return NotImplemented
    if operator == "+" and _is(left, "0"):  # where sum() begins
        return right
    return Symbol(operator, (left, right))


def call(function: str, *arguments) -> Symbol:
    """Returns the formula ``function(arguments)``."""
    return Symbol("call " + function, tuple(as_symbol(argument) for argument in arguments))


_COMPOSED = {
    "add": lambda a, b: as_symbol(a) + b,
    "subtract": lambda a, b: as_symbol(a) - b,
    "multiply": lambda a, b: as_symbol(a) * b,
    "divide": lambda a, b: as_symbol(a) / b,
    "true_divide": lambda a, b: as_symbol(a) / b,
    "power": lambda a, b: as_symbol(a) ** b,
    "float_power": lambda a, b: as_symbol(a) ** b,
    "negative": lambda a: -a,
    "positive": lambda a: a,
    "square": lambda a: a ** 2,
    "reciprocal": lambda a: 1 / a,
    "remainder": lambda a, b: call("mod", a, b),
    "floor_divide": lambda a, b: call("floor", as_symbol(a) / b),
    "hypot": lambda a, b: call("sqrt", as_symbol(a) ** 2 + as_symbol(b) ** 2),
    "log2": lambda a: call("log", a) / call("log", 2),
    "log10": lambda a: call("log", a) / call("log", 10),
    "exp2": lambda a: 2 ** a,
    "deg2rad": lambda a: a * (math.pi / 180),
    "radians": lambda a: a * (math.pi / 180),
    "conjugate": lambda a: a,
    "less": lambda a, b: _compared("<", a, b),
    "less_equal": lambda a, b: _compared("<=", a, b),
    "greater": lambda a, b: _compared(">", a, b),
    "greater_equal": lambda a, b: _compared(">=", a, b),
}


def _ufunc(name: str):
    if name in _COMPOSED:
        return _COMPOSED[name]
    function = _RENAMED.get(name, name)
    if function not in _FUNCTIONS:
        raise TypeError(f"{name} has no formula; a formula may hold {', '.join(sorted(_FUNCTIONS))}")
    return lambda *arguments: call(function, *arguments)


def _method(name: str):
    return lambda self, *others: _ufunc(name)(self, *others)


# NumPy calls these for arrays of symbols.
for _name in ("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "arcsinh",
              "arccosh", "arctanh", "exp", "log", "sqrt", "cbrt", "hypot", "log2", "log10", "log1p", "expm1", "exp2",
              "square", "reciprocal", "fabs", "sign", "deg2rad", "radians", "sech", "csch"):
    setattr(Symbol, _name, _method(_name))


_numeric = {"sech": lambda x: 1 / np.cosh(x), "csch": lambda x: 1 / np.sinh(x)}


def sech(x):
    """Returns 1/cosh(x) of a symbol, a number or an array."""
    return _apply("sech", x)


def csch(x):
    """Returns 1/sinh(x) of a symbol, a number or an array."""
    return _apply("csch", x)


def _apply(name: str, x):
    if isinstance(x, Symbol):
        return call(name, x)
    if isinstance(x, np.ndarray) and x.dtype == object:
        return np.frompyfunc(lambda value: call(name, value), 1, 1)(x)
    return _numeric[name](x)


def _text(symbol: Symbol, names: dict | None = None) -> str:
    """The formula; symbols in `names` (by identity) stand as their names."""
    done: dict = {}
    stack = [symbol]
    while stack:  # deep sums would exhaust the stack of calls
        top = stack[-1]
        waiting = [part for part in top._parts if id(part) not in done]
        if waiting and not (names and id(top) in names and top is not symbol):
            stack.extend(waiting)
            continue
        stack.pop()
        if names and id(top) in names and top is not symbol:
            done[id(top)] = (names[id(top)], _ATOM)
        elif id(top) not in done:
            done[id(top)] = _joined(top, [done[id(part)] for part in top._parts])
    return done[id(symbol)][0]


def _joined(symbol: Symbol, parts: list) -> tuple:
    head = symbol._head
    inside = lambda part, least: part[0] if part[1] >= least else f"({part[0]})"
    if not parts:
        return head, _SIGN if head.startswith("-") else _ATOM
    if head.startswith("call "):
        return f"{head[5:]}({', '.join(part[0] for part in parts)})", _ATOM
    if head == "neg":
        return f"-{inside(parts[0], _POWER)}", _SIGN
    left, right = parts
    if head[0] in "<>":
        return f"{inside(left, _SUM)} {head} {inside(right, _SUM)}", _COMPARISON
    if head == "^":
        return f"{inside(left, _ATOM)}^{inside(right, _ATOM)}", _POWER
    least = _SUM if head in "+-" else _PRODUCT
    own = f" {head} " if head in "+-" else head
    return f"{inside(left, least)}{own}{inside(right, _POWER if parts[1][1] == _SIGN else least + 1)}", least


#: Formulas longer than this are written with definitions for what they hold more than once.
_LONG = 4000


def formula(symbol: Symbol, prefix: str = "part_") -> tuple:
    """Returns the text of a formula, and the definitions that it needs by name: of a short one none."""
    if symbol._size <= _LONG:
        return _text(symbol), {}
    seen: dict = {}
    order: list = []
    stack = [(symbol, False)]
    while stack:
        top, left = stack.pop()
        if left:
            order.append(top)
            continue
        seen[id(top)] = seen.get(id(top), 0) + 1
        if seen[id(top)] == 1:
            stack.append((top, True))
            stack.extend((part, False) for part in top._parts)
    names: dict = {}
    definitions: dict = {}
    for part in order:
        if seen[id(part)] > 1 and part._parts and part is not symbol:
            name = f"{prefix}{len(names) + 1}"
            definitions[name] = _text(part, names)
            names[id(part)] = name
    return _text(symbol, names), definitions


_VECTOR = re.compile(r"(\w+)\[(\d+)\](\w*)")
_COMPONENT = re.compile(r"(\w*[^\W\d])(\d+)([^\W\d]*)")


def stem(name: str) -> str:
    """Returns "r" of "r[3]", and "r_dot" of "r[3]_dot"."""
    match = _VECTOR.fullmatch(name)
    return match[1] + match[3] if match else name


def components(name: str) -> list:
    """Returns the names that ``"r[3]"`` declares: r1, r2, r3; or the name itself."""
    match = _VECTOR.fullmatch(name)
    if match:
        return [f"{match[1]}{i + 1}{match[3]}" for i in range(int(match[2]))]
    if "[" in name or "]" in name:
        raise ValueError(f"{name!r} declares no vector: write r[3] for r1, r2, r3")
    return [name]


def vectors(names) -> dict:
    """Returns the vectors whose components() are among the names: {"r": ["r1", "r2", "r3"]}."""
    found: dict = {}
    for name in names:
        if match := _COMPONENT.fullmatch(name):
            found.setdefault(match[1] + match[3], {})[int(match[2])] = name
    return {vector: [parts[i + 1] for i in range(len(parts))] for vector, parts in found.items()
            if len(parts) > 1 and max(parts) == len(parts) and min(parts) == 1 and vector not in names}


def argument(name: str):
    """Returns what a function is called with for a declared name: a symbol, or an array of them for a vector."""
    if "[" not in name:
        return Symbol(name)
    parts = components(name)
    array = np.empty(len(parts), dtype=object)
    array[:] = [Symbol(part) for part in parts]
    return array


def trace(function, declared: list, others=(), what: str = "the formula") -> Symbol:
    """Calls `function` with symbols and returns what it made of them.

    Parameters of the function that have names of `declared` or `others` get these; otherwise all of `declared` are
    passed in their order.
    """
    known = {stem(name): name for name in declared}
    try:
        parameters = [p for p in inspect.signature(function).parameters.values()]
    except (TypeError, ValueError):
        parameters = None
    if parameters is not None and all(p.kind is not p.VAR_POSITIONAL for p in parameters):
        every = dict(known, **{name: name for name in others})
        parameters = [p for p in parameters if p.name in every or p.default is p.empty]
        wanted = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
        if all(name in every for name in wanted):
            result = function(*(argument(every[p.name]) for p in parameters if p.kind in
                                (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)),
                              **{p.name: argument(every[p.name]) for p in parameters if p.kind is p.KEYWORD_ONLY})
        elif len(wanted) == len(declared):
            result = function(*(argument(name) for name in declared))
        else:
            raise TypeError(f"{what} takes {', '.join(wanted) or 'nothing'}, and there are "
                            f"{', '.join(list(known) + list(others))}")
    else:
        result = function(*(argument(name) for name in declared))
    if isinstance(result, np.ndarray) and result.size == 1:
        result = result.item()
    return result if isinstance(result, Condition) else as_symbol(result)


def from_sympy(expression) -> Symbol:
    """Returns a SymPy expression as a symbol. Functions and numbers that formulas do not have are errors."""
    renamed = {"Abs": "abs", "Min": "min", "Max": "max", "ln": "log"}
    if expression.is_Symbol:
        return Symbol(str(expression))
    if expression.is_Integer:
        return Symbol(str(int(expression)))
    if expression.is_Rational:
        return Symbol(str(int(expression.p))) / Symbol(str(int(expression.q)))
    if expression.is_NumberSymbol:
        return Symbol("pi") if str(expression) == "pi" else _number(float(expression))
    if expression.is_Float:
        return _number(float(expression))
    parts = [from_sympy(part) for part in expression.args]
    if expression.is_Add or expression.is_Mul:
        result = parts[0]
        for part in parts[1:]:
            result = result + part if expression.is_Add else result * part
        return result
    if expression.is_Pow:
        return call("sqrt", parts[0]) if str(expression.exp) == "1/2" else parts[0] ** parts[1]
    name = type(expression).__name__
    name = renamed.get(name, name)
    if name not in _FUNCTIONS:
        raise TypeError(f"SymPy's {type(expression).__name__} has no formula; a formula may hold "
                        f"{', '.join(sorted(_FUNCTIONS))}")
    return call(name, *parts)


def as_expression(value, declared=(), others=(), what: str = "the formula"):
    """Returns a formula given as number, symbol, SymPy expression or function as a symbol; a text as it is."""
    if isinstance(value, (str, Symbol)):
        return value
    if hasattr(value, "free_symbols") and hasattr(value, "args"):
        return from_sympy(value)
    if callable(value):
        return trace(value, list(declared), others, what)
    return _number(value)


def as_text(value, declared=(), others=(), what: str = "the formula") -> str:
    """Returns the text of such a formula."""
    return str(as_expression(value, declared, others, what))


def as_formula(value, declared=(), others=(), what: str = "the formula", prefix: str = "part_") -> tuple:
    """Returns the text and the definitions of such a formula."""
    expression = as_expression(value, declared, others, what)
    return (expression, {}) if isinstance(expression, str) else formula(expression, prefix)
