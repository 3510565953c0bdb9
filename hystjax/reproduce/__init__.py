"""The source paper's experiments, rerun, and studies of what it does not do."""

from ._devices import table_3 as table_3
from ._document import (
    AbstractDocument as AbstractDocument,
    Comparison as Comparison,
    Row as Row,
    write as write,
)
from ._measured import measured as measured
from ._oscillators import boucwen as boucwen
from ._published import (
    duhem_growing_sine as duhem_growing_sine,
    published_settings as published_settings,
)
from ._registry import (
    EXPERIMENTS as EXPERIMENTS,
    STUDIES as STUDIES,
    TABLES as TABLES,
    figure as figure,
    reproduce as reproduce,
)
from ._trust import certainty as certainty
