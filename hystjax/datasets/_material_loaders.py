"""One loader a material: which column is what, and what to know before using it.

A loader takes a finder of files and the name of the record, if there are several.
"""

import numpy as np

from .._recording import Recording
from .._tables import micromag_segments, read_mat, read_text
from ._entry import Find

M130_LOOPS = ("0.43T", "0.95T", "1.50T")  # in the order of the columns


def no27_steel(find: Find, record: str) -> Recording:
    """NO27-1450H electrical steel in an Epstein frame, 0.2 T at 10 Hz, measured.

    `"loop"` (`mag10.txt`; no header): column 0 field strength H (A/m), the output w,
    and column 1 flux density B (T), the input u, for the frame imposes a sine of B.
    1000 rows over one period of 0.1 s; the file has no time column, so 10 kHz is the
    number of rows times 10 Hz.

    `"hystlab"` (`data_file_Loops.txt`; one header line): the same kind of loop as
    written by the program HystLab, column 0 field (mT), the input, and column 1
    moment (A m²), the output. 988 rows. Neither time nor rate is known: rows are
    nominally 1 s apart, which serves for laws that do not depend on the rate. The
    field repeats in some neighbouring rows. HystLab's own fit of the moment is column
    2, `no27_hystlab_fit()`.

    Source: Chandra et al. (2023), doi:10.1063/5.0146134. No licence is stated: linked,
    never redistributed.
    """
    if record == "hystlab":
        return Recording.from_csv(
            find("data_file_Loops.txt"),
            period=1.0,
            input=0,
            output=1,
            names=("field", "moment"),
            units=("mT", "A m²"),
        )
    return Recording.from_csv(
        find("mag10.txt"),
        period=0.1 / 1000,
        input=1,
        output=0,
        names=("flux density", "field strength"),
        units=("T", "A/m"),
    )


def hystlab_fit(find: Find) -> np.ndarray:
    """The moment (A m²) that HystLab fitted to the record `"hystlab"`, shape (988,)."""
    return read_text(find("data_file_Loops.txt")).column("fitted moment", 2)


def steel_m130_27s(find: Find, record: str) -> Recording:
    """M130-27s grain-oriented electrical steel in its easy direction, measured.

    Records `"0.43T"`, `"0.95T"` and `"1.50T"`: loops by the amplitude of the flux
    density, columns 0, 1 and 2 of both files. `H_M130_27s.mat` (variable `HmeasT`):
    field strength u (A/m), `B_M130_27s.mat` (`BmeasT`): flux density w (T). 256 rows a
    loop, from the positive tip down and up again; there is no clock. The field runs in
    equal steps, and rests for one at the negative tip, where the flux density need not.
    The loop does not quite close: the last row lies 1 to 4.2 mT from the first.

    Source: Szewczyk, JAmodel (2014). MIT licence.
    """
    loop = M130_LOOPS.index(record)
    return Recording(
        None,
        read_mat(find("H_M130_27s.mat")).column("input", ("HmeasT", loop)),
        read_mat(find("B_M130_27s.mat")).column("output", ("BmeasT", loop)),
        names=("field strength", "flux density"),
        units=("A/m", "T"),
    )


def steel_coupon(find: Find, record: str) -> Recording:
    """Coupons of structural steel, pulled and pushed far beyond yield, measured.

    Columns (one header line): `e_true` true strain u, `Sigma_true` true stress w
    (MPa). Record `"1"` (`example_1.csv`): 23 reversals at strains of some 0.02, 634
    rows, a third of which repeat the strain of the row before; they are left as they
    are. Record `"3"` (`example_3.csv`): pulled once to a strain of 0.125, 333 rows.
    Neither is given a clock; the second file has one all the same, with uneven steps
    over 109 s, which `Recording.from_csv(..., time="Time[s]")` reads.

    Source: de Castro e Sousa, Suzuki and Lignos, RESSPyLab (2020). MIT licence.
    """
    return Recording.from_csv(
        find(f"example_{record}.csv"),
        input="e_true",
        output="Sigma_true",
        clock=False,
        names=("true strain", "true stress"),
        units=("1", "MPa"),
    )


def forc_md00(find: Find, record: str) -> Recording:
    """First-order reversal curves of the marine sediment MD00-2361, measured.

    File `MD00-2361` of a vibrating-sample magnetometer (MicroMag 2900/3900, hybrid SI):
    column 0 field u (T), column 1 moment w (A m²), not corrected for drift, slope or
    background. 297 curves of 1, 3, 5, ... and at last 458 points, 83 585 rows in the
    order of measurement; there is no clock. Each runs from its reversal field upwards.

    Left out are the 297 points at 0.133 T, one before each curve, by which drift is
    judged. Between curves the field went up to saturation (0.5 T) and down to the next
    reversal, which was not recorded: where one curve ends and the next begins this
    recording is no path that the field took. For the curves by themselves see
    `hystjax.datasets.forc_md00_curves`.

    Source: Heslop et al., FORCsensei (2020). MIT licence.
    """
    return _forc(np.concatenate(_forc_curves(find)))


def forc_curves(find: Find) -> tuple[Recording, ...]:
    """The curves of `forc_md00` that have the points for a recording, in order."""
    return tuple(_forc(curve) for curve in _forc_curves(find) if len(curve) >= 3)


def _forc_curves(find: Find) -> list[np.ndarray]:
    """Field and moment of each curve; every other segment is a point for the drift."""
    return micromag_segments(find("MD00-2361"))[1::2]


def _forc(points: np.ndarray) -> Recording:
    return Recording(None, *points.T, names=("field", "moment"), units=("T", "A m²"))
