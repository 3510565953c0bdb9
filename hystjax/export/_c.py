"""Laws in C99: a struct, and functions of it, that need the C library's mathematics
alone."""

import math
from typing import NamedTuple

from .._core.solution import Solution
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ._program import (
    SINGLE,
    Language,
    Printer,
    Program,
    Samples,
    Statement,
    about,
    first_samples,
    identifier,
    in_32_bits,
    inputs_of,
    program,
    wrapped,
)
from ._rules import REAL, TRUTH, WHOLE, Node

KINDS = {REAL: "{p}_real", WHOLE: "int", TRUTH: "bool"}

# Operations that C99 has no operator for, and for floats no function either; what is
# not here is a function of <math.h>.
HELPERS = {
    ("sign", REAL): "return (a != a) ? a : ({p}_real)((a > 0) - (a < 0));",
    ("sign", WHOLE): "return (a > 0) - (a < 0);",
    # Of two numbers the one that is none, as JAX has it: such a state is refused.
    ("max", REAL): "return ((a > b) || (a != a)) ? a : b;",
    ("min", REAL): "return ((a < b) || (a != a)) ? a : b;",
    ("max", WHOLE): "return (a > b) ? a : b;",
    ("min", WHOLE): "return (a < b) ? a : b;",
    ("abs", WHOLE): "return (a < 0) ? -a : a;",
    # Beyond what an int holds C says nothing of a conversion.
    ("convert", WHOLE): "return (a >= 2147483647.0) ? 2147483647 : "
    "(a <= -2147483648.0) ? (-2147483647 - 1) : (a == a) ? (int)a : 0;",
}
_MATH = {"abs": "fabs"}


class Words(NamedTuple):
    """How C is written with one prefix."""

    prefix: str

    def number(self, node: Node) -> str:
        if node.kind == TRUTH:
            return str(node.data).lower()
        if node.kind == WHOLE:
            return in_32_bits(node.data)
        if not math.isfinite(node.data):
            text = "NAN" if math.isnan(node.data) else "INFINITY"
        else:
            text = repr(abs(node.data))
        sign = "-" if math.copysign(1, node.data) < 0 else ""
        return f"{sign}{self.prefix.upper()}_R({text})"

    def call(self, op: str, kind: str, args: tuple[str, ...]) -> str:
        joined = ", ".join(args)
        if op == "not":
            return f"(!({joined}))"
        if op == "div":
            return f"(({args[0]}) / ({args[1]}))"
        if op == "convert" and kind == REAL:
            return f"(({KINDS[kind].format(p=self.prefix)})({joined}))"
        if (op, kind) in HELPERS:
            return f"{self.prefix}_{op}{'' if kind == REAL else 'i'}({joined})"
        return f"{self.prefix.upper()}_M({_MATH.get(op, op)})({joined})"

    def language(self) -> Language:
        return Language(
            self.number,
            self.call,
            entry="{name}[{i}]",
            select="{condition} ? {a} : {b}",
            lookup=f"{{table}}[{self.prefix}_at({{i}}, {{last}})]",
            symbols={"and": "&&", "or": "||"},
        )


_INPUTS = ("x", "m", "k", "t", "u0", "u", "du", "h")  # in the order of arguments


class Writer:
    """Writes the parts of one file."""

    def __init__(self, law: Program, prefix: str):
        self.law, self.p = law, prefix
        self.print = Printer(Words(prefix).language(), prefix)
        # First, as it finds out what else is needed.
        self.functions = self._functions()

    @property
    def immediate(self) -> bool:
        """Whether the output sees the derivative of the input."""
        return "du" in inputs_of(self.law.output)

    def types(self) -> str:
        p, upper, law = self.p, self.p.upper(), self.law
        fields = [f"    {p}_real u;  /* the input now */"]
        fields += [f"    {p}_real du; /* its derivative before, per s */"]
        if law.timed:
            fields.append(f"    {p}_real t;  /* time, s, 0 at {p}_init */")
        if law.flows:
            fields.append(f"    {p}_real x[{law.flows}]; /* what flows */")
        if law.floats:
            fields.append(f"    {p}_real m[{law.floats}]; /* what the input decides */")
        if law.integers:
            fields.append(f"    int k[{law.integers}]; /* likewise */")
        rows = "\n".join(fields)
        timed = f"\n#define {upper}_TIMED /* the state has a t */" if law.timed else ""
        return _TYPES.format(p=p, upper=upper, rows=rows, timed=timed)

    def constants(self) -> str:
        """Tables, and functions that C lacks, as far as they are used."""
        p = self.p
        parts = []
        for name, kind, texts in self.print.numbered():
            type_ = KINDS[kind].format(p=p)
            rows = "\n".join(wrapped(", ".join(texts), 84))
            parts.append(
                f"static const {type_} {name}[{len(texts)}] = {{\n{rows}\n}};\n"
            )
        if self.print.tables:
            parts.append(
                f"static int {p}_at(int i, int last)\n{{\n"
                "    return (i < 0) ? 0 : ((i > last) ? last : i);\n}\n"
            )
        for op, kind in sorted(self.print.used & set(HELPERS)):
            type_ = KINDS[kind].format(p=p)
            name = f"{p}_{op}{'' if kind == REAL else 'i'}"
            of = "double" if op == "convert" else type_
            two = f", {type_} b" if op in ("max", "min") else ""
            inside = HELPERS[op, kind].format(p=p)
            parts.append(f"static {type_} {name}({of} a{two})\n{{\n    {inside}\n}}\n")
        return "\n".join(parts)

    def _functions(self) -> str:
        law = self.law
        parts = []
        if law.floats or law.integers:
            parts += [self._after()]
        if law.flows:
            parts += [self._rate(), self._flow()]
        parts += [self._init(), self._step(), self._output()]
        return "\n".join(parts)

    def _lines(self, statements: list[Statement]) -> list[str]:
        return [
            f"    const {KINDS[s.kind].format(p=self.p)} {s.name} = {s.text};"
            for s in statements
        ]

    def _parameters(self, used: set[str], outputs: list[str]) -> str:
        p = self.p
        kinds = {
            "x": f"const {p}_real x[]",
            "m": f"const {p}_real m[]",
            "k": "const int k[]",
        }
        inputs = [kinds.get(n, f"{p}_real {n}") for n in _INPUTS if n in used]
        return ", ".join(inputs + outputs)

    def _call(self, name: str, results: list, given: dict[str, str], *outputs: str):
        """A call of the function that makes `results`, of what is given under the names
        of their inputs."""
        used = inputs_of(results)
        arguments = [given[n] for n in _INPUTS if n in used]
        return f"    {self.p}_{name}({', '.join([*arguments, *outputs])});"

    def _after(self) -> str:
        law, p = self.law, self.p
        results = law.memory_after
        statements, texts = self.print(results)
        places = self._places("m_after", "k_after")
        outputs = [f"{p}_real m_after[]"] if law.floats else []
        outputs += ["int k_after[]"] if law.integers else []
        header = self._parameters(inputs_of(results), outputs)
        rows = [f"    {a} = {t};" for a, t in zip(places, texts, strict=True)]
        return "\n".join(
            [
                "/* What is remembered after the input has gone straight to u. */",
                f"static void {p}_after({header})",
                "{",
                *self._lines(statements),
                *rows,
                "}",
                "",
            ]
        )

    def _places(self, m: str, k: str) -> list[str]:
        floats = [f"{m}[{i}]" for i in range(self.law.floats)]
        return floats + [f"{k}[{i}]" for i in range(self.law.integers)]

    def _rate(self) -> str:
        law, p = self.law, self.p
        statements, texts = self.print(law.rate)
        header = self._parameters(inputs_of(law.rate), [f"{p}_real rate[]"])
        rows = [f"    rate[{i}] = {text};" for i, text in enumerate(texts)]
        comment = "/* The derivatives of what flows, per s. */"
        return "\n".join(
            [
                comment,
                f"static void {p}_rate({header})",
                "{",
                *self._lines(statements),
                *rows,
                "}",
                "",
            ]
        )

    def _flow(self) -> str:
        p, n, upper = self.p, self.law.flows, self.p.upper()
        return f"""/* y = x + time slope. */
static void {p}_moved(const {p}_real x[], const {p}_real slope[], {p}_real time,
                      {p}_real y[])
{{
    for (int i = 0; i < {n}; i++) {{
        y[i] = x[i] + time * slope[i];
    }}
}}

/* The mean of the four slopes of a step, times six. */
static void {p}_summed({p}_real k[4][{n}], {p}_real sum[])
{{
    for (int i = 0; i < {n}; i++) {{
        sum[i] = k[0][i] + {upper}_R(2) * (k[1][i] + k[2][i]) + k[3][i];
    }}
}}
"""

    def _init(self) -> str:
        law, p = self.law, self.p
        rows, used = [], set()
        rows += ["    s->u = u;", f"    s->du = {p.upper()}_R(0.0);"]
        rows += [f"    s->t = {p.upper()}_R(0.0);"] if law.timed else []
        start = [*law.memory_start]
        statements, texts = self.print(start)
        used |= inputs_of(start)
        places = self._places("s->m", "s->k")
        memory = [f"    {a} = {t};" for a, t in zip(places, texts, strict=True)]
        head = self._lines(statements)
        flow: list[str] = []
        if law.flows:
            more, texts = self.print(law.flow_start)
            flow_used = inputs_of(law.flow_start)
            used |= flow_used
            inner = [f"    const {p}_real *m = s->m;"] if "m" in flow_used else []
            inner += ["    const int *k = s->k;"] if "k" in flow_used else []
            flow = ["    {"]
            flow += [f"    {each}" for each in inner + self._lines(more)]
            flow += [f"        s->x[{i}] = {text};" for i, text in enumerate(texts)]
            flow += ["    }"]
        unused = [] if "w" in used else ["    (void)w;"]
        time = [f"    const {p}_real t = {p.upper()}_R(0.0);"] if "t" in used else []
        return "\n".join(
            [
                f"void {p}_init({p}_state *s, {p}_real u, {p}_real w)",
                "{",
                *time,
                *head,
                *unused,
                *rows,
                *memory,
                *flow,
                "}",
                "",
            ]
        )

    def _step(self) -> str:
        law, p = self.law, self.p
        rows = [
            f"    {p}_state next = *s;",
            f"    {p}_real du;",
            "",
            "    if (!(isfinite(u) && isfinite(h) && (h > 0))) {",
            "        return false;",
            "    }",
            "    du = (u - s->u) / h;",
            "    if (!isfinite(du)) {",
            "        return false;",
            "    }",
            "    next.u = u;",
            "    next.du = du;",
        ]
        rows += ["    next.t = s->t + h;"] if law.timed else []
        start = {"m": "s->m", "k": "s->k", "t": "s->t", "u": "s->u", "du": "du"}
        end = {"m": "next.m", "k": "next.k", "t": "next.t", "u": "u", "du": "du"}
        go = self._flowing if law.flows else self._remembering
        rows += [*go(start, end, "h"), *self._refusing()]
        rows += ["    *s = next;", "    return true;"]
        signature = f"bool {p}_step({p}_state *s, {p}_real u, {p}_real h)"
        return "\n".join([signature, "{", *rows, "}", ""])

    def _remembering(self, start: dict[str, str], end: dict[str, str], h: str):
        """What takes the memory from the start to the end of a stretch."""
        law = self.law
        if not law.memory_after:
            return []
        outputs = [end["m"]] if law.floats else []
        outputs += [end["k"]] if law.integers else []
        given = {**start, "u0": start["u"], "u": end["u"], "h": h}
        return [self._call("after", law.memory_after, given, *outputs)]

    def _flowing(self, start: dict[str, str], end: dict[str, str], h: str) -> list[str]:
        """The classical step of Runge and Kutta, with the memory at its stages."""
        law, p, upper = self.law, self.p, self.p.upper()
        middle = {"m": "m_mid", "k": "k_mid", "t": f"{start['t']} + half"}
        middle |= {"u": "middle", "du": "du"}
        rows = [
            f"    const {p}_real half = {upper}_R(0.5) * {h};",
            f"    {p}_real k[4][{law.flows}], y[{law.flows}];",
        ]
        if law.memory_after or "u" in inputs_of(law.rate):
            rows.append(f"    const {p}_real middle = {start['u']} + half * du;")
        rows += [f"    {p}_real m_mid[{law.floats}];"] if law.floats else []
        rows += [f"    int k_mid[{law.integers}];"] if law.integers else []
        rows += self._remembering(start, middle, "half")
        rows += self._remembering(middle, end, "half")
        stages = [(start, ""), (middle, "half"), (middle, "half"), (end, h)]
        for i, (stage, time) in enumerate(stages):
            if time:
                rows.append(f"    {p}_moved(s->x, k[{i - 1}], {time}, y);")
            given = {**stage, "x": "y" if time else "s->x"}
            rows.append(self._call("rate", law.rate, given, f"k[{i}]"))
        return [
            *rows,
            f"    {p}_summed(k, y);",
            f"    {p}_moved(s->x, y, {h} / {upper}_R(6), next.x);",
        ]

    def _refusing(self) -> list[str]:
        """What leaves a step undone whose state or output is no finite number."""
        rows = []
        for name, size in (("x", self.law.flows), ("m", self.law.floats)):
            if size:
                rows += [
                    f"    for (int i = 0; i < {size}; i++) {{",
                    f"        if (!isfinite(next.{name}[i])) {{",
                    "            return false;",
                    "        }",
                    "    }",
                ]
        return [
            *rows,
            f"    if (!isfinite({self.p}_output(&next, du))) {{",
            "        return false;",
            "    }",
        ]

    def _output(self) -> str:
        law, p = self.law, self.p
        statements, (text,) = self.print(law.output)
        used = inputs_of(law.output)
        rows = [
            f"    const {'int' if n == 'k' else f'{p}_real'} *{n} = s->{n};"
            for n in ("x", "m", "k")
            if n in used
        ]
        rows += [f"    const {p}_real {n} = s->{n};" for n in ("t", "u") if n in used]
        rows += [] if "du" in used else ["    (void)du;"]
        rows += [] if used - {"du"} else ["    (void)s;"]
        signature = f"{p}_real {p}_output(const {p}_state *s, {p}_real du)"
        return "\n".join(
            [
                signature,
                "{",
                *rows,
                *self._lines(statements),
                f"    return {text};",
                "}",
                "",
            ]
        )


def to_c(
    model: AbstractModel | AbstractSequenceModel | Solution,
    *,
    name: str = "law",
    record: Recording | None = None,
) -> str:
    """Source text of a device in C99, of any model that computes what JAX can trace.

    It is a struct `law_state` and functions: `law_init` for the state at a first input
    (and the output there, of laws of its rate), `law_step` for a straight line of so
    many seconds to the next input, and `law_output`; there are no globals but
    constants, and nothing is allocated. Memory is exact, and what flows goes by the
    steps of `simulation.FixedStep(1)`. Inputs and steps that are not finite, and states
    that would not be, are refused, and the state stays as it was.

    `law_follow` is the inverse's step: the input, between two limits, that takes the
    output to a target, looked for in the manner of `hystjax.invert`, by at most some
    330 steps tried. It is false where the output misses, or the step is too long for
    the leap: then the input is the one of those tried that came closest. Whole numbers
    are of 32 bits. Names of several in one program must differ in more than case.

    Numbers are doubles, or floats with `-DLAW_FLOAT`; contraction should be off
    (`-ffp-contract=off`) for the same bits on all machines.

    **Arguments:**

    - `model`: one device, of whatever class; models of one's own too.
    - `name`: what all names begin with.
    - `record`: if there is one, its range is told, and with `-DLAW_SELF_TEST` a `main`
        compares the law along its first samples with what hystjax makes of them.

    **Raises:** `InputError` for models that have no equations (networks of sequences,
    outputs that come late), or for what is not known in C.
    """
    model = as_model(model, "to_c(model)")
    prefix = identifier(name)
    law = program(model)
    writer = Writer(law, prefix)
    return "\n".join(
        [
            _comment(law, prefix, record),
            writer.types(),
            writer.constants(),
            writer.functions,
            inverse(prefix, writer.immediate, law.flows > 0),
            _self_test(prefix, first_samples(model, record, law.timed), law.timed),
        ]
    )


_TYPES = """
#include <float.h>
#include <math.h>
#include <stdbool.h>

#ifdef {upper}_FLOAT
typedef float {p}_real;
#define {upper}_LAST_DIGIT FLT_EPSILON
#define {upper}_M(function) function##f
#else
typedef double {p}_real;
#define {upper}_LAST_DIGIT DBL_EPSILON
#define {upper}_M(function) function
#endif
#define {upper}_R(number) (({p}_real)(number)){timed}

typedef struct {{
{rows}
}} {p}_state;

/* The state at a first input u, where the output was w. */
void {p}_init({p}_state *s, {p}_real u, {p}_real w);

/* Goes straight to the input u in h seconds. False, and the state as it was, where
 * these or the state after it are no finite numbers. */
bool {p}_step({p}_state *s, {p}_real u, {p}_real h);

/* The output, where the input goes on with the derivative du, per s. */
{p}_real {p}_output(const {p}_state *s, {p}_real du);

/* Goes in h seconds, between the inputs low and high, to the one that takes the output
 * to w, or the closest of those tried; the input is left in s->u. True if not further
 * off than by tolerance, and the step not too long for the leap. What an output that
 * sees du has at the start of the step counts, and else at its end. */
bool {p}_follow({p}_state *s, {p}_real w, {p}_real h, {p}_real low, {p}_real high,
                {p}_real tolerance);
"""


def _comment(law: Program, prefix: str, record: Recording | None) -> str:
    lines = [
        *about(law, prefix, record),
        "",
        "The input is straight from one step to the next. Compile with",
        f"-std=c99 -ffp-contract=off; floats with -D{prefix.upper()}_FLOAT.",
    ]
    return "\n".join(["/*", *(f" * {each}".rstrip() for each in lines), " */"])


def _self_test(p: str, samples: Samples | None, timed: bool) -> str:
    """A `main` that runs along the first samples of a record."""
    if samples is None:
        return ""
    t = samples.t
    # `init` begins at 0 s, and the record need not.
    clock = f"\n    s.t = ({p}_real){p}_tested[0][0];" if timed else ""
    rows = ",\n".join(
        f"    {{{a!r}, {b!r}, {c!r}}}"
        for a, b, c in zip(*samples.columns(), strict=True)
    )
    return f"""#ifdef {p.upper()}_SELF_TEST
#include <stdio.h>

/* Time, input, and what hystjax has for the output. */
static const double {p}_tested[{len(t)}][3] = {{
{rows}
}};

int main(void)
{{
    const double allowed =
        (sizeof({p}_real) == sizeof(float)) ? {SINGLE * samples.size!r}
                                            : {samples.allowed!r};
    double worst = 0.0;
    {p}_state s;

    {p}_init(&s, ({p}_real){p}_tested[0][1], ({p}_real){samples.seen!r});{clock}
    for (int i = 0; i < {len(t) - 1}; i++) {{
        const double h = {p}_tested[i + 1][0] - {p}_tested[i][0];
        const double du = ({p}_tested[i + 1][1] - {p}_tested[i][1]) / h;
        const double off =
            fabs((double){p}_output(&s, ({p}_real)du) - {p}_tested[i][2]);

        worst = (off <= worst) ? worst : ((off > worst) ? off : HUGE_VAL);
        if (!{p}_step(&s, ({p}_real){p}_tested[i + 1][1], ({p}_real)h)) {{
            worst = HUGE_VAL;
        }}
    }}
    (void)printf("{p}: off by %g at most, %g allowed\\n", worst, allowed);
    return (worst <= allowed) ? 0 : 1;
}}
#endif
"""


def inverse(p: str, immediate: bool, flows: bool) -> str:
    """Text of a function that steps to the input which takes the output to a target.

    An interval with a root is looked for on both sides of where the input is, at first
    as far as the step before went, or where that moves nothing as far as it takes to,
    then twice as far each time, and made smaller by regula falsi with halved weights,
    every third time by halves: so it ends, however the output bends and jumps. Where no
    input within the limits is enough, the closest of those tried is taken. Where
    something flows, a leap for which the step is too long is not good enough.

    **Source:** Dowell and Jarratt (1971), doi 10.1007/BF01934364.
    """
    words = {"p": p, "upper": p.upper()}
    output = f"{p}_output(s, (u - s->u) / h)" if immediate else f"{p}_output(&n, n.du)"
    holds = flows and not immediate
    return _TEXT.format(
        **words,
        output=output,
        holding=_HOLDING.format(**words) if holds else "",
        held=f"{p}_holds(s, best, h)" if holds else "true",
    )


_HOLDING = """
/* Whether a step is short enough for an input that goes so far: whether two of half the
   length lead to the same output, but for a quarter of its way and a fiftieth of it. A
   leap for which it is too long comes to outputs that no input leads to. */
static bool {p}_holds(const {p}_state *s, {p}_real u, {p}_real h)
{{
    const {p}_real middle = s->u + {upper}_R(0.5) * (u - s->u);
    {p}_state whole = *s, half = *s;
    {p}_real before, finer, size;

    if (!{p}_step(&whole, u, h) || !{p}_step(&half, middle, {upper}_R(0.5) * h) ||
        !{p}_step(&half, u, {upper}_R(0.5) * h)) {{
        return false;
    }}
    before = {p}_output(s, half.du);
    finer = {p}_output(&half, half.du);
    size = {upper}_M(fmax)({upper}_M(fabs)(before), {upper}_M(fabs)(finer));
    return {upper}_M(fabs)({p}_output(&whole, whole.du) - finer) <=
           {upper}_R(0.25) * {upper}_M(fabs)(finer - before) + {upper}_R(0.02) * size;
}}
"""


_TEXT = """{holding}
/* How far the output is off w, where the input goes to u in h seconds. */
static {p}_real {p}_off(const {p}_state *s, {p}_real u, {p}_real w, {p}_real h)
{{
    {p}_state n = *s;

    return {p}_step(&n, u, h) ? ({output} - w) : {upper}_R(NAN);
}}

static bool {p}_across({p}_real a, {p}_real b)
{{
    return ((a <= 0) && (b >= 0)) || ((a >= 0) && (b <= 0));
}}

/* Whether the output, off w by start at u, moves by a thousandth of that where the
   input goes far to either side, within the limits. */
static bool {p}_moves(const {p}_state *s, {p}_real u, {p}_real far, {p}_real start,
                      {p}_real w, {p}_real h, {p}_real low, {p}_real high)
{{
    const {p}_real least = {upper}_R(1e-3) * {upper}_M(fabs)(start);
    const {p}_real below = (u - far > low) ? (u - far) : low;
    const {p}_real above = (u + far < high) ? (u + far) : high;
    const {p}_real down = {p}_off(s, below, w, h) - start;
    const {p}_real up = {p}_off(s, above, w, h) - start;

    /* So far that it is lost it has moved too. */
    return !(({upper}_M(fabs)(down) <= least) && ({upper}_M(fabs)(up) <= least));
}}

/* The least of powers of two at which it does, whatever the unit of the input. */
static {p}_real {p}_distance(const {p}_state *s, {p}_real u, {p}_real start, {p}_real w,
                             {p}_real h, {p}_real low, {p}_real high)
{{
    int small = -100, large = 100;

    while (large - small > 1) {{
        const int middle = (small + large) / 2;
        const {p}_real far = {upper}_M(ldexp)({upper}_R(1.0), middle);

        if ({p}_moves(s, u, far, start, w, h, low, high)) {{
            large = middle;
        }} else {{
            small = middle;
        }}
    }}
    return {upper}_M(ldexp)({upper}_R(1.0), large);
}}

bool {p}_follow({p}_state *s, {p}_real w, {p}_real h, {p}_real low, {p}_real high,
                {p}_real tolerance)
{{
    const {p}_real here = (s->u < low) ? low : ((s->u > high) ? high : s->u);
    const {p}_real start = {p}_off(s, here, w, h);
    /* Of the side on which the output comes to w. */
    {p}_real a = here, off_a = start, b = here, off_b = start;
    {p}_real best = here, off = start;
    {p}_real far = {upper}_M(fabs)(s->du * h);
    const {p}_real last_digits = {upper}_R(64) * {upper}_LAST_DIGIT;
    {p}_real sides[2], offs[2], steep = {upper}_R(0.0);
    bool found = false, held;

    if (!(low <= high) || !isfinite(start)) {{
        return false;
    }}
    sides[0] = here;
    sides[1] = here;
    offs[0] = start;
    offs[1] = start;
    /* After a rest the step before was none, or one of rounding. */
    if (!{p}_moves(s, here, far, start, w, h, low, high)) {{
        far = {p}_distance(s, here, start, w, h, low, high);
    }}
    for (int i = 0; (i < 80) && !found && ({upper}_M(fabs)(off) > tolerance); i++) {{
        if (i == 40) {{
            /* Nearer: after a leap the output may have come back on the way so far. */
            far = {p}_distance(s, here, start, w, h, low, high);
            sides[0] = here;
            sides[1] = here;
            offs[0] = start;
            offs[1] = start;
        }}
        for (int side = 0; side < 2; side++) {{
            const {p}_real last = sides[side], off_last = offs[side];
            const {p}_real end = (side == 0) ? (here - far) : (here + far);
            const {p}_real v = (end < low) ? low : ((end > high) ? high : end);
            const {p}_real off_v = {p}_off(s, v, w, h);
            const {p}_real slope = {upper}_M(fabs)(off_v - start) / far;
            {p}_real rounding;

            if (!isfinite(off_v)) {{
                continue;
            }}
            sides[side] = v;
            offs[side] = off_v;
            steep = (slope > steep) ? slope : steep;
            /* Where nothing answers any more this would lead ever farther out. */
            rounding = last_digits * steep * {upper}_M(fabs)(v);
            if ({upper}_M(fabs)(off_v) + rounding < {upper}_M(fabs)(off)) {{
                best = v;
                off = off_v;
            }}
            if (!found && {p}_across(off_v, start) &&
                ({upper}_M(fabs)(off_v) > rounding)) {{
                found = true;
                a = last;
                off_a = off_last;
                b = v;
                off_b = off_v;
            }}
        }}
        far *= {upper}_R(2.0);
    }}
    for (int i = 0; (i < 128) && found; i++) {{
        const {p}_real middle = a + {upper}_R(0.5) * (b - a);
        const {p}_real straight = b - off_b * ((b - a) / (off_b - off_a));
        const bool inside = ((a < straight) && (straight < b)) ||
                            ((b < straight) && (straight < a));
        const {p}_real v = (inside && (i % 3 < 2)) ? straight : middle;
        const {p}_real off_v = {p}_off(s, v, w, h);

        if (!isfinite(off_v)) {{
            break;
        }}
        if ({upper}_M(fabs)(off_v) < {upper}_M(fabs)(off)) {{
            best = v;
            off = off_v;
        }}
        if ({p}_across(off_v, off_b)) {{
            a = b;
            off_a = off_b;
        }} else {{
            /* The end that stays counts half, so that the next passes the root. */
            off_a *= {upper}_R(0.5);
        }}
        b = v;
        off_b = off_v;
        found = ({upper}_M(fabs)(off) > tolerance) && (v != a) &&
                ((middle != a) || (middle != b));
    }}
    held = {held};
    return {p}_step(s, best, h) && held && ({upper}_M(fabs)(off) <= tolerance);
}}
"""
