"""What the experiments draw: the paper's figure beside a better one."""

from ._sides import (
    Side as Side,
    paper_side as paper_side,
    runs as runs,
    side_by_side as side_by_side,
)
