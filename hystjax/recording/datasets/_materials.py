"""Steels and a sediment: how each is read, its files, checksums and terms.

A loader says which column is what, and what to know before using it. It takes a finder
of files and the name of the record, if there are several.
"""

import numpy as np

from .._formats import micromag_segments, read_mat
from .._recording import Recording
from .._text import read_text
from ._source import NO_LICENCE, SMART_HYSTERESIS, Dataset, Find, file, page

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
    table = read_text(find(f"example_{record}.csv"))
    return Recording(
        None,
        table.column("input", "e_true"),
        table.column("output", "Sigma_true"),
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


_JAMODEL = (
    "romanszewczyk/JAmodel",
    "4bbe905d420ce27c66ee93d8b25ef44b553f9175",
    "3_mixed/Characterisitcs_mixed_mat",  # spelt so at the source
)
_RESSPYLAB = (
    "AlbanoCastroSousa/RESSPyLab",
    "99657963eca60d7f84445201ec5a47a3f7c63e45",
    "examples",
)
_FORCSENSEI = (
    "FORCaist/forcsensei",
    "42aad879384fcac7cae03dd37de8403ed3673564",
    "Case study data files",
)

MATERIALS = (
    Dataset(
        name="no27_steel",
        what="NO27-1450H electrical steel in an Epstein frame, 0.2 T (measured)",
        columns=(
            "loop: u flux density (T), w field strength (A/m); "
            "hystlab: u field (mT), w moment (A m²)"
        ),
        rate="loop: one period of 10 Hz in 1000 rows; hystlab: 988 rows, rate unknown",
        licence=NO_LICENCE,
        citation="Chandra et al., Appl. Phys. Lett. (2023), doi:10.1063/5.0146134",
        source=page(SMART_HYSTERESIS),
        files=(
            file(
                SMART_HYSTERESIS,
                "mag10.txt",
                "7ac7be390a86df1932d04de7eea4abfcd5430c456d72dbe54ff162d54ee4b738",
            ),
            file(
                SMART_HYSTERESIS,
                "data_file_Loops.txt",
                "d9dc53f70115c35c59da9ef8839f3e4ab865f09f1fb926b57d9b5b4cc43d5534",
            ),
        ),
        loader=no27_steel,
        records=("loop", "hystlab"),
    ),
    Dataset(
        name="steel_m130_27s",
        what="M130-27s grain-oriented electrical steel, easy direction (measured)",
        columns="u field strength (A/m), w flux density (T)",
        rate="no clock; three loops of 256 rows",
        licence="MIT",
        citation="Szewczyk, JAmodel, GitHub (2014)",
        source=page(_JAMODEL),
        files=(
            file(
                _JAMODEL,
                "H_M130_27s.mat",
                "57bec8a75306e06a5e3fb3a51ba56f0c0f5d2c0fe74a7f78401176c0ec5d3e5b",
            ),
            file(
                _JAMODEL,
                "B_M130_27s.mat",
                "6d26c631fcd8eaeec601c3ad96c4ac29a526c6ee04a876aadd4e9c660c617af0",
            ),
        ),
        loader=steel_m130_27s,
        records=M130_LOOPS,
    ),
    Dataset(
        name="steel_coupon",
        what="structural steel coupons, one cycled, one pulled (measured)",
        columns="u true strain (1), w true stress (MPa)",
        rate="no clock; 1: 634 rows; 3: 333 rows",
        licence="MIT",
        citation="de Castro e Sousa, Suzuki and Lignos, RESSPyLab, GitHub (2020)",
        source=page(_RESSPYLAB),
        files=(
            file(
                _RESSPYLAB,
                "example_1.csv",
                "716368c9cefa4fa5d295684847da89aaa5be3976f7a110edcd8e4939a13be603",
            ),
            file(
                _RESSPYLAB,
                "example_3.csv",
                "0a3dcbffc434eeddbb57f4f5edea2915bcdbde4bee334753197186f6962a06ce",
            ),
        ),
        loader=steel_coupon,
        records=("1", "3"),
    ),
    Dataset(
        name="forc_md00",
        what="first-order reversal curves of marine sediment MD00-2361 (measured)",
        columns="u field (T), w moment (A m²)",
        rate="no clock; 83 585 rows in 297 curves",
        licence="MIT",
        citation="Heslop et al., FORCsensei, GitHub (2020)",
        source=page(_FORCSENSEI),
        files=(
            file(
                _FORCSENSEI,
                "MD00-2361",
                "fc6eff9f0ae28eed8a521e5b0a1df0dc5b836909b63dfed49cb6340290b0c14e",
            ),
        ),
        loader=forc_md00,
    ),
)
