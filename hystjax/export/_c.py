"""Laws in C99: a struct, and functions of it, that need the C library's mathematics
alone."""

from .._core.solution import Solution
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ._c_functions import Writer
from ._printing import Samples, about, first_samples
from ._program import Program, identifier, program


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
    output to a target, as `hystjax.invert` finds it, by at most some 170 steps tried.

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
            inverse(prefix, writer.immediate),
            _self_test(prefix, first_samples(model, record)),
        ]
    )


def _comment(law: Program, prefix: str, record: Recording | None) -> str:
    lines = [
        *about(law, prefix, record),
        "",
        "The input is straight from one step to the next. Compile with",
        f"-std=c99 -ffp-contract=off; floats with -D{prefix.upper()}_FLOAT.",
    ]
    return "\n".join(["/*", *(f" * {each}".rstrip() for each in lines), " */"])


def _self_test(p: str, samples: Samples | None) -> str:
    """A `main` that runs along the first samples of a record."""
    if samples is None:
        return ""
    t, size = samples.t, samples.size
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
    const double share = (sizeof({p}_real) == sizeof(float)) ? 1e-3 : 1e-9;
    const double allowed = {size!r} * share;
    double worst = 0.0;
    {p}_state s;

    {p}_init(&s, ({p}_real){p}_tested[0][1], ({p}_real){p}_tested[0][2]);
    for (int i = 0; i < {len(t) - 1}; i++) {{
        const double h = {p}_tested[i + 1][0] - {p}_tested[i][0];
        const double du = ({p}_tested[i + 1][1] - {p}_tested[i][1]) / h;
        const double off =
            fabs((double){p}_output(&s, ({p}_real)du) - {p}_tested[i][2]);

        worst = (off > worst) ? off : worst;
        if (!{p}_step(&s, ({p}_real){p}_tested[i + 1][1], ({p}_real)h)) {{
            worst = HUGE_VAL;
        }}
    }}
    (void)printf("{p}: off by %g at most, %g allowed\\n", worst, allowed);
    return (worst <= allowed) ? 0 : 1;
}}
#endif
"""


def inverse(p: str, immediate: bool) -> str:
    """Text of a function that steps to the input which takes the output to a target.

    An interval with a root is looked for on both sides of where the input is, twice as
    far each time, and made smaller by regula falsi with halved weights, every third
    time by halves: so it ends, however the output bends and jumps. Where no input
    within the limits is enough, the one that comes closest is taken.

    **Source:** Dowell and Jarratt (1971), doi 10.1007/BF01934364.
    """
    output = f"{p}_output(s, (u - s->u) / h)" if immediate else f"{p}_output(&n, n.du)"
    return _TEXT.format(p=p, upper=p.upper(), output=output)


_TEXT = """
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

bool {p}_follow({p}_state *s, {p}_real w, {p}_real h, {p}_real low, {p}_real high,
                {p}_real tolerance)
{{
    const {p}_real here = (s->u < low) ? low : ((s->u > high) ? high : s->u);
    const {p}_real start = {p}_off(s, here, w, h);
    /* Of the side on which the output comes to w. */
    {p}_real a = here, off_a = start, b = here, off_b = start;
    {p}_real best = here, off = start;
    {p}_real far = {upper}_M(fabs)(s->du * h);
    {p}_real sides[2], offs[2];
    bool found = false;

    if (!(low <= high) || !isfinite(start)) {{
        return false;
    }}
    sides[0] = here;
    sides[1] = here;
    offs[0] = start;
    offs[1] = start;
    if (!(far > 0)) {{
        far = {upper}_R(1e-3) * ({upper}_R(1.0) + {upper}_M(fabs)(here));
    }}
    for (int i = 0; (i < 40) && !found && ({upper}_M(fabs)(off) > tolerance); i++) {{
        for (int side = 0; side < 2; side++) {{
            const {p}_real last = sides[side], off_last = offs[side];
            const {p}_real end = (side == 0) ? (here - far) : (here + far);
            const {p}_real v = (end < low) ? low : ((end > high) ? high : end);
            const {p}_real off_v = {p}_off(s, v, w, h);

            if (!isfinite(off_v)) {{
                continue;
            }}
            sides[side] = v;
            offs[side] = off_v;
            if ({upper}_M(fabs)(off_v) < {upper}_M(fabs)(off)) {{
                best = v;
                off = off_v;
            }}
            if (!found && {p}_across(off_v, start)) {{
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
    return {p}_step(s, best, h) && ({upper}_M(fabs)(off) <= tolerance);
}}
"""
