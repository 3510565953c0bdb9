"""The inverse's step in C99: a root of the step, safeguarded."""


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
