"""Recordings of real and simulated devices, found on disk or fetched from source.

`load` gives a `Recording`; `hystjax data list`, or `listing`, says what there is.
"""

from ._access import (
    fetch as fetch,
    forc_md00_curves as forc_md00_curves,
    listing as listing,
    load as load,
    names as names,
    no27_hystlab_fit as no27_hystlab_fit,
    path as path,
    records as records,
)
