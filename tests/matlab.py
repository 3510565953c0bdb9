"""The few statements of MATLAB that exported functions are made of, line by line in
Python: MATLAB itself cannot be asked for here."""

import re
import types

import numpy as np


class Column(np.ndarray):
    """An array whose entries are called, from 1."""

    def __call__(self, i):
        return self[int(i) - 1]


def function(text, name):
    """A function of a file, as one of Python of as many arguments."""
    namespace = dict(_WORDS)
    exec(_translated(text), namespace)
    return namespace[name]


def _translated(text):
    lines, depth, results = [], 0, ""
    for line in re.sub(r" \.\.\.\n\s*", " ", text).splitlines():
        line = line.split("%")[0].strip()
        head = re.fullmatch(r"function \[?([\w, ]+?)\]? = (\w+)\((.*)\)", line)
        loop = re.fullmatch(r"for (\w+) = 1:(\w+)", line)
        if head:
            results = head[1]
            lines.append(f"def {head[2]}({head[3].replace('varargin', '*_')}):")
            lines.append(f"    nargin = {len(head[3].split(','))}")
            depth = 1
        elif loop:
            lines.append(f"{depth * '    '}for {loop[1]} in range(1, {loop[2]} + 1):")
            depth += 1
        elif line.startswith("if "):
            lines.append(f"{depth * '    '}{_expression(line)}:")
            depth += 1
        elif line == "else":
            lines.append(f"{(depth - 1) * '    '}else:")
        elif line == "end":
            depth -= 1
            if depth == 0:
                lines.append(f"    return {results}")
        else:
            for statement in filter(None, map(str.strip, line.split(";"))):
                lines.append(depth * "    " + _assignment(statement))
    return "\n".join(lines)


def _assignment(text):
    text = re.sub(r"^(\w+)\((\w+)\) = ", r"\1[\2 - 1] = ", text)
    text = re.sub(r"^\[(.*?)\] = ", r"\1 = ", text)
    return _expression(re.sub(r"= \[(.*)\]$", r"= column([\1])", text))


def _expression(text):
    words = {"^": "**", "&&": " and ", "||": " or ", "~=": "!=", "~": " not "}
    return re.sub(r"\^|&&|\|\||~=|~", lambda match: words[match[0]], text)


def _struct(*pairs):
    return types.SimpleNamespace(**dict(zip(pairs[::2], pairs[1::2], strict=True)))


def column(values):
    return np.asarray(values, float).view(Column)


def _isreal(value):
    return not np.iscomplexobj(value)


_SAME = "sign exp expm1 log1p floor ceil size sin cos tan sinh cosh tanh"
_WORDS = {name: getattr(np, name) for name in _SAME.split()}
_WORDS |= {"abs": abs, "min": min, "max": max, "numel": len, "double": float}
_WORDS |= {"all": all}
_WORDS |= {
    "fix": np.trunc,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "NaN": np.nan,
    "Inf": np.inf,
}
_WORDS |= {"sqrt": np.emath.sqrt, "log": np.emath.log, "isreal": _isreal}
_WORDS |= {"zeros": lambda n, _=1: column(np.zeros(n)), "struct": _struct}
_WORDS |= {"column": column, "true": True, "false": False}
