"""The findings of a refinement in words."""

import numpy as np

from .._solution import Solution
from ..models._base import signed_sum

_UNDETERMINED = 1e-4  # relative singular value below which a combination is named
_SUSPICIOUS = 0.01  # probability below which residuals are not taken for white


def statements(solution: Solution) -> list[str]:
    """Sentences on the noise, on what the data do not determine, and on stability.

    **Arguments:** `solution`, of `hystjax.refine` or `hystjax.discover`, concrete.
    """
    stats = solution.stats
    said = [f"noise (standard deviation of the residuals): {_noise(stats)}"]
    said += [_whiteness(float(p)) for p in np.asarray(stats["whiteness"])[:1]]
    said += _undetermined(solution)
    if "fading" in stats:
        said.append(_fading(stats["fading"]))
    return said


def _noise(stats) -> str:
    noise, weights = float(stats["certainty"].noise), stats.get("weights")
    if weights is None:
        return f"{noise:.4g}"
    size = noise / np.sqrt(np.concatenate(weights))
    return f"grows with the output, from {np.min(size):.4g} to {np.max(size):.4g}"


def _whiteness(probability: float) -> str:
    if probability >= _SUSPICIOUS:
        return f"residuals look white (Ljung-Box probability {probability:.2g})"
    return (
        "residuals are correlated (Ljung-Box probability "
        f"{probability:.1g}): something is left to explain, and standard errors are "
        "too small; `hystjax.bootstrap` gives better ones"
    )


def _undetermined(solution) -> list[str]:
    found = solution.stats["certainty"].undetermined()
    return [
        f"hardly determined (1 : {1 / max(size, 1e-300):.1e}): {_mixed(components)}"
        for size, components in found
    ]


def _mixed(components) -> str:
    """The combination, such as `0.71 w - 0.71 |du|`."""
    parts = [(part, name) for name, part in components.items()]
    return signed_sum(parts, lambda part: f"{part:.2g}", " ")


def _fading(fading) -> str:
    exponent = float(np.max(fading.exponent))
    share = 100 * float(np.max(fading.share))
    if exponent >= 0:
        return (
            f"the law does not forget its initial value (exponent {exponent:.3g} per s)"
        )
    worst = float(np.max(fading.largest))
    where = float(np.ravel(fading.where)[np.argmax(fading.largest)])
    return (
        f"the law forgets its initial value at {-exponent:.3g} per s on average; it "
        f"expands on {share:.2g} % of the samples, at most {worst:.3g} per s, at t = "
        f"{where:.4g} s"
    )
