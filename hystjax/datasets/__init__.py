"""Recordings of real and simulated devices, found on disk or fetched from source.

`load` gives a `Recording`; `hystjax data list`, or `listing`, says what there is.
"""

from ._access import (
    fetch as fetch,
    load as load,
    names as names,
    no27_hystlab_fit as no27_hystlab_fit,
    path as path,
    records as records,
)
from ._listing import listing as listing
