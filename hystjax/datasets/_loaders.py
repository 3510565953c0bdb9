"""One loader a recording: which column is what, and what to know before using it.

A loader takes a finder of files and the name of the record, if there are several.
"""

import numpy as np

from .._recording import Recording
from .._tables import read_mat, read_text
from ..interpolation import BandLimited
from ._entry import Find

_BOUCWEN_PERIOD = 8192  # rows


def piezo_ayala(find: Find, record: str) -> Recording:
    """Cantilever piezo actuator under a sine of 150 V and 1 Hz, measured.

    Columns (no header): 0 empty, 1 time (s), 2 displacement w (µm), 3 voltage u (V).
    5 kHz, 50 001 rows, 10 s. At rest to 3.26 s, then a step to -87 V that rings, then
    6.7 cycles: choose a window, `load("piezo_ayala").window(35001, 45001)` being the
    paper's. The voltage is the command, a sine to rounding.

    Source: Ayala et al., Data in Brief 29 (2020) 105175, as used by Chandra et al.
    (2023), doi:10.1063/5.0146134. No licence is stated: linked, never redistributed.
    """
    return Recording.from_csv(
        find("hysteresis_v_150_1hz.csv"),
        time=1,
        input=3,
        output=2,
        names=("voltage", "displacement"),
        units=("V", "µm"),
    )


def piezo_yan9a(find: Find, record: str) -> Recording:
    """Flexure piezo micromanipulator, 40 cycles of 0 to 3.6 V at 1 Hz, measured.

    Columns (no header): 0 command u (V), 4 displacement w (µm) from a capacitive
    sensor whose zero is arbitrary; the others are unused. 200 Hz, 8027 rows, no time
    column. Starts at rest at mid-voltage. The output lags the input by one sample, as
    the author notes; it is left as recorded.

    Source: Aye and Ang, International Conference on Science and Technology for
    Sustainable Development (2018). MIT licence.
    """
    return Recording.from_csv(
        find("Model_Vi_Do.dat"),
        period=1 / 200,
        input=0,
        output=4,
        names=("command voltage", "displacement"),
        units=("V", "µm"),
    )


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


def mr_damper(find: Find, record: str) -> Recording:
    """Magnetorheological damper on a shaking table at 1.5 Hz, one current, measured.

    Records `"1"` to `"10"` differ in amplitude: 20.1, 18.5, 16.7, 14.2, 15.5, 10.4,
    12.5, 11.4, 9.0 and 8.7 mm. File `ensaioN.2.2.mat`, variable `x_F`: column 0
    displacement u (mm), column 1 velocity (mm/s), column 2 force w (N). 100 Hz
    (variable `Ts`), 1501 rows, 15 s. The force follows the velocity more than the
    displacement; for the velocity as input read the file, at
    `fetch("mr_damper")`, with `Recording.from_mat(..., input=("x_F", 1))`.

    Source: Vargas, doi:10.5281/zenodo.4445334. MIT licence.
    """
    return Recording.from_mat(
        find(f"ensaio{record}.2.2.mat"),
        period="Ts",
        input=("x_F", 0),
        output=("x_F", 2),
        names=("displacement", "force"),
        units=("mm", "N"),
    )


def friction_pin(find: Find, record: str) -> Recording:
    """Reciprocating slide under 5 N, 50 cycles of 0.24 mm, measured.

    Columns (one header line): 0 time (s), 1 normal force (µN), 2 position u (mm),
    3 friction force (µN). The output w is the friction force with its sign flipped,
    as the author does, so that it rises with the position. 200 Hz, 42 579 rows, 214 s;
    179 steps of the time column are twice as long as the others. The position is that
    of the stage, near -110 mm; it rests for a second at both ends of the stroke.

    Source: Christopherson, FrictionModels.jl. MIT licence.
    """
    measured = Recording.from_csv(
        find("test_data_2.txt"), time=0, input=2, output=3, units=("mm", "µN")
    )
    return Recording(
        measured.t,
        measured.u,
        -measured.w,
        names=("position", "friction force"),
        units=measured.units,
    )


def boucwen_benchmark(find: Find, record: str) -> Recording:
    """Bouc-Wen oscillator of the nonlinear system identification benchmark, simulated.

    Input u: force (N), a random-phase multisine of 5 to 150 Hz and 50 N rms; output
    w: displacement (m) with noise of 7.4e-6 m rms added. 750 Hz, four steady-state
    periods of 8192 rows: records `"1"` to `"4"`, or `"all"` in a row. Files
    `uest_multisine.mat` (variable `u`) and `yest_multisine.mat` (`y`). The law is
    m y'' + c y' + k y + z = u, z' = α y' - β (γ |y'| |z|^(ν-1) z + δ y' |z|^ν).

    Straight lines between samples would spoil this input: it carries `BandLimited`,
    which is exact on whole periods, and which windows of the record keep.

    Source: Noël and Schoukens, 4TU.ResearchData, doi:10.4121/12967592. CC BY-SA 4.0.
    """
    u = read_mat(find("uest_multisine.mat")).column("input", "u")
    w = read_mat(find("yest_multisine.mat")).column("output", "y")
    rows = slice(None)
    if record != "all":
        start = (int(record) - 1) * _BOUCWEN_PERIOD
        rows = slice(start, start + _BOUCWEN_PERIOD)
    return Recording(
        (np.arange(len(u)) / 750)[rows],
        u[rows],
        w[rows],
        names=("force", "displacement"),
        units=("N", "m"),
        interpolation=BandLimited(),
    )
