"""Laws in C99: a struct, and functions of it, that need the C library's mathematics
alone."""

from .._core.solution import Solution
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ._about import Samples, about, first_samples
from ._c_functions import Writer
from ._c_inverse import inverse
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
