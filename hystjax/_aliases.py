"""Which terms of a library a recording cannot tell apart."""

from collections.abc import Sequence

from . import _checks, regression
from ._recording import Recording
from ._regressors import admitted, as_group, check, chosen, factor
from .differentiation import AbstractDifferentiation, FiniteDifference
from .formulation import AbstractFormulation
from .library import Library
from .regression import Alias


def aliases(
    recordings: Recording | Sequence[Recording],
    library: Library,
    *,
    formulation: AbstractFormulation | None = None,
    differentiation: AbstractDifferentiation = FiniteDifference(),
    tolerance: float = 0.01,
) -> tuple[Alias, ...]:
    """Terms of a library that the excitation of a recording cannot tell apart.

    One sine makes 1, u^2 and du^2 collinear, for example: a law that holds one of them
    could hold another, and only another excitation (a second amplitude, a decaying
    sine, a second frequency) will say.

    **Arguments:**

    - `recordings`, `library`, `formulation`, `differentiation`: as for `identify`.
    - `tolerance`: a term of which a smaller share is new, given the terms before it in
        the library, counts as an alias of those.

    **Returns:** one `Alias` for each such term, in the library's order.

    **Raises:** as `identify`.
    """
    _checks.concrete("`aliases`", recordings)
    how = chosen(formulation, differentiation)
    library, group = admitted(library, as_group(recordings), how)
    check(group, library)
    problem = factor(group, library, how)
    return regression.aliases(problem, library.names, tolerance)
