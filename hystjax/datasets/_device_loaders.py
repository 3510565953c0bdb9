"""One loader a device: which column is what, and what to know before using it.

A loader takes a finder of files and the name of the record, if there are several.
"""

import numpy as np

from .._recording import Recording
from .._tables import json_matrix, read_mat
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


def friction_damper(find: Find, record: str) -> Recording:
    """Banded rotary friction damper with backlash under sines, measured.

    Records `"0.5Hz_0.5in"`, `"0.5Hz_1in"`, `"1Hz_0.5in"` and `"1Hz_1in"`: frequency
    and amplitude, all with 30 lb in the brake band. Files
    `FHz30lbtensionAamplitude.json`, variable `data`: column 0 time (s), 1 displacement
    u (in), 2 friction force w (kip), 3 velocity (in/s), 4 and 5 actuator forces (lb),
    unused. 1024 Hz, 14 337 rows in 14 s at 0.5 Hz and 7169 in 7 s at 1 Hz. Units are
    left as recorded: an inch is 25.4 mm, a kip 4.448 kN. Seven cycles, of which
    the first two swell to the amplitude and the last two fade. The band tightens itself
    while the drum turns, and slackens before it turns back: the backlash.

    Source: Coble, Huggins, Cao, Ricles and Downey (2022),
    Dataset-Friction-Damper-with-Backlash, dataset 2. CC BY-SA 4.0.
    """
    frequency, amplitude = record.removesuffix("in").split("Hz_")
    measured = json_matrix(
        find(f"{frequency}Hz30lbtension{amplitude}amplitude.json"), "data"
    )
    return Recording(
        *measured[:, :3].T,
        names=("displacement", "friction force"),
        units=("in", "kip"),
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
