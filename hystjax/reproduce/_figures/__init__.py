"""What the experiments draw: the paper's figure beside a better one."""

from ._errors_over import errors_over as errors_over
from ._noise import under_noise as under_noise
from ._sides import (
    PUBLISHED as PUBLISHED,
    Side as Side,
    as_run as as_run,
    averaged as averaged,
    published_side as published_side,
    runs as runs,
    side_by_side as side_by_side,
)
