"""Functions of Modelica, as a parser reads them, run in Python: a compiler of Modelica
cannot be asked for here."""

import operator
import types

import numpy as np
import pymoca.ast
import pymoca.parser


def functions(text, package):
    """The functions of a package, by name, as ones of Python."""
    classes = pymoca.parser.parse(text).classes[package].classes
    known = {}
    for name, each in classes.items():
        if each.type == "function":
            known[name] = _function(each, known, classes["State"].symbols.values())
    return known


def _function(definition, known, fields):
    symbols = definition.symbols.values()
    inputs = [s.name for s in symbols if "input" in s.prefixes]
    outputs = [s.name for s in symbols if "output" in s.prefixes]

    def run(*given):
        values = {s.name: _empty(s, fields) for s in symbols}
        values |= zip(inputs, given, strict=True)
        for statement in definition.statements:
            right = _value(statement.right, values, known)
            several = right if len(statement.left) > 1 else (right,)
            for left, each in zip(statement.left, several, strict=True):
                _assign(left, each, values)
        results = tuple(values[name] for name in outputs)
        return results if len(results) > 1 else results[0]

    return run


def _empty(symbol, fields):
    """What a variable is before it is assigned; constants are declared with values."""
    if str(symbol.type) == "State":
        return types.SimpleNamespace(**{s.name: _empty(s, ()) for s in fields})
    if "constant" in symbol.prefixes:
        (array,) = symbol.class_modification.arguments[0].value.modifications
        return np.array([_value(each, {}, {}) for each in array.values])
    size = symbol.dimensions[0][0].value
    return np.nan if size is None else np.full(size, np.nan)


def _place(reference, values):
    """What holds the value that is referred to, and where in it."""
    holder, name = values, reference.name
    if reference.child:
        holder = vars(values[name])
        (reference,) = reference.child
        name = reference.name
    (index,) = reference.indices[0]
    return holder, name, index


def _assign(reference, value, values):
    holder, name, index = _place(reference, values)
    if index is None:
        holder[name] = value
    else:
        holder[name][index.value - 1] = value


def _value(node, values, known):
    if isinstance(node, pymoca.ast.Primary):
        return node.value
    if isinstance(node, pymoca.ast.ComponentRef):
        holder, name, index = _place(node, values)
        entry = holder[name]
        return entry if index is None else entry[int(_value(index, values, known)) - 1]
    if isinstance(node, pymoca.ast.IfExpression):
        for condition, expression in zip(
            node.conditions, node.expressions, strict=False
        ):
            if _value(condition, values, known):
                return _value(expression, values, known)
        return _value(node.expressions[-1], values, known)
    operands = [_value(each, values, known) for each in node.operands]
    name = str(getattr(node.operator, "name", node.operator))
    if name == "-" and len(operands) == 1:
        return -operands[0]
    return (known | _WORDS)[name](*operands)


_WORDS = {"+": operator.add, "-": operator.sub, "*": operator.mul}
_WORDS |= {"/": operator.truediv, "^": operator.pow, "not": operator.not_}
_WORDS |= {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_WORDS |= {"==": operator.eq, "<>": operator.ne, "abs": abs, "min": min, "max": max}
_WORDS |= {"and": lambda a, b: a and b, "or": lambda a, b: a or b}
_WORDS |= {"integer": lambda a: int(np.floor(a)), "div": lambda a, b: int(a / b)}
_SAME = "sign exp log sqrt floor ceil sin cos tan sinh cosh tanh"
_WORDS |= {name: getattr(np, name) for name in _SAME.split()}
_WORDS |= {"atan": np.arctan, "atan2": np.arctan2, "asin": np.arcsin}


def block(text, package, name):
    """What a block does at an event, with its inputs and parameters given by name; at
    the first call it is initial."""
    classes = pymoca.parser.parse(text).classes[package].classes
    known, fields = functions(text, package), classes["State"].symbols.values()
    values = {s.name: _empty(s, fields) for s in classes[name].symbols.values()}
    (when,) = classes[name].statements
    parts = iter([when.blocks[0], *[when.blocks[1]] * 1000])

    def run(**given):
        values.update(given)
        for statement in next(parts):
            _assign(statement.left[0], _value(statement.right, values, known), values)
        return values["w"]

    return run
