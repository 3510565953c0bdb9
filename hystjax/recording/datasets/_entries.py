"""The registry: actuators, dampers, slides, steels and a sediment; how each is read,
its files, checksums and terms.

A loader says which column is what, and what to know before using it. It takes a finder
of files and the name of the record, if there are several.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

import numpy as np

from ...signals import BandLimited
from .._formats import json_matrix, micromag_segments, read_mat
from .._recording import Recording
from .._text import read_text

Find: TypeAlias = Callable[[str], Path]
"""From a file's name to where the file is, fetched if need be."""


@dataclass(frozen=True)
class File:
    """A file, the SHA-256 of its bytes in hexadecimal, and where it comes from."""

    name: str
    sha256: str
    url: str


@dataclass(frozen=True)
class Dataset:
    """One entry of the registry.

    **Attributes:**

    - `name`: what `load` calls it.
    - `what`: the device and the experiment, in a line.
    - `columns`: what input and output are, with their units.
    - `rate`: sampling rate and length.
    - `licence`, `citation`: terms of the source, and whom to cite.
    - `source`: a page about the files.
    - `files`: the files, original and unchanged.
    - `loader`: makes the recording, from a finder of files and a record's name.
    - `records`: names of the records if there are several, the default first.
    """

    name: str
    what: str
    columns: str
    rate: str
    licence: str
    citation: str
    source: str
    files: tuple[File, ...]
    loader: Callable[[Find, str], Recording]
    records: tuple[str, ...] = ()


Place: TypeAlias = tuple[str, str, str]
"""A repository, a commit of it and a folder in that."""

NO_LICENCE = "none stated by the source; linked here, never redistributed"
SMART_HYSTERESIS = (
    "chandratue/SmartHysteresis",
    "56ccb389f852ca9858b2a34c06ee7eda7185cf1b",
    "Data",
)


def page(place: Place) -> str:
    """The address of a folder's page."""
    repository, commit, folder = place
    return f"https://github.com/{repository}/tree/{commit}/{quote(folder)}"


def file(place: Place, name: str, sha256: str) -> File:
    """The file `name` in a folder."""
    raw = "https://raw.githubusercontent.com"
    return File(name, sha256, "/".join([raw, *map(quote, place), name]))


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


M130_LOOPS = ("0.43T", "0.95T", "1.50T")  # in the order of the columns


def no27_steel(find: Find, record: str) -> Recording:
    """NO27-1450H electrical steel in an Epstein frame, 0.2 T at 10 Hz, measured.

    `"loop"` (`mag10.txt`; no header): column 0 field strength H (A/m), the output w,
    and column 1 flux density B (T), the input u, for the frame imposes a sine of B.
    1000 rows over one period of 0.1 s; the file has no time column, so 10 kHz is the
    number of rows times 10 Hz.

    `"hystlab"` (`data_file_Loops.txt`; one header line): the same kind of loop as
    written by the program HystLab, column 0 field (mT), the input, and column 1
    moment (A m²), the output. 988 rows. Neither time nor rate is known, so that this
    recording has no clock. The field repeats in some neighbouring rows. HystLab's own
    fit of the moment is column 2, `no27_hystlab_fit()`.

    Source: Chandra et al. (2023), doi:10.1063/5.0146134. No licence is stated: linked,
    never redistributed.
    """
    if record == "hystlab":
        return Recording.from_csv(
            find("data_file_Loops.txt"),
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


_YAN9A = (
    "yan9a/DiscreteBacklashOperator",
    "79fd060d86cdf69be2388e29bf57b0766c273650",
    "MatLabCode/DiscreteBacklashModel",
)
_MR_DAMPER = (
    "labcontrol-data/mr-damper",
    "5badf1c327d00fafd7ab0517b29229fc8ecd682d",
    "data",
)
_FRICTION = (
    "jchristopherson/FrictionModels.jl",
    "19de236062631413961fea6da5d1a0b4da97e205",
    "examples",
)
_FRICTION_DAMPER = (
    "ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash",
    "0e09aa9d950760277e31c08cd93fd01f39a5af09",
    "data/dataset-2/characterization datasets",
)
_BOUCWEN = (
    "JanHHoekstra/Model-Augmentation-Public",
    "097aa706f918fcf5468d5720d12dfdfa7c0d2f38",
    "data/bouc_wen",
)
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

ENTRIES = (
    Dataset(
        name="piezo_ayala",
        what="cantilever piezo actuator, 150 V sine at 1 Hz (measured)",
        columns="u voltage (V), w displacement (µm)",
        rate="5 kHz, 50 001 rows",
        licence=NO_LICENCE,
        citation="Ayala et al., Data in Brief 29 (2020) 105175",
        source=page(SMART_HYSTERESIS),
        files=(
            file(
                SMART_HYSTERESIS,
                "hysteresis_v_150_1hz.csv",
                "480af23e3cdae958eef05601a43e55cec79a93f6d49d05d61cfbe3e4d6281b4c",
            ),
        ),
        loader=piezo_ayala,
    ),
    Dataset(
        name="piezo_yan9a",
        what="flexure piezo micromanipulator, 40 cycles at 1 Hz from rest (measured)",
        columns="u command voltage (V), w displacement (µm), one sample late",
        rate="200 Hz, 8027 rows",
        licence="MIT",
        citation=(
            "Aye and Ang, International Conference on Science and Technology for "
            "Sustainable Development, Yangon (2018)"
        ),
        source=page(_YAN9A),
        files=(
            file(
                _YAN9A,
                "Model_Vi_Do.dat",
                "672714f09302b892721aa44d72f337a7ee1a0eb1d107f4d6797ab47d849428ae",
            ),
        ),
        loader=piezo_yan9a,
    ),
    Dataset(
        name="mr_damper",
        what="magnetorheological damper, sines of 8.7 to 20.1 mm at 1.5 Hz (measured)",
        columns="u displacement (mm), w force (N)",
        rate="100 Hz, ten records of 1501 rows",
        licence="MIT",
        citation="Vargas, doi:10.5281/zenodo.4445334",
        source=page(_MR_DAMPER),
        files=tuple(
            file(_MR_DAMPER, f"ensaio{number}.2.2.mat", sha256)
            for number, sha256 in enumerate(
                (
                    "5ff1e84576e13ae61362c5eb7d9c0526f13d7013a3ea6a68ae3c995765ba34eb",
                    "d4a5323629179165c303d9241e2d230c239e7b98370d90a868287980a50e7c0b",
                    "b8b9d911e291c13a0492e5376b372a4d25d9fa5864e657bc67251b59504087ab",
                    "b4d714e4c873b0dde14e44fec4a7bde719c7c890793b6b6d8b3dbfffcd598f0f",
                    "4e37985f6cdd832a731458feef66ca5859ae5fbfa40f747188310412f4b20350",
                    "fa85b5b254301572c9c3012e50c703580f063104f64426e930138b0a289318fc",
                    "38a337e06e1225bf4c779de8350bf97d75fb71833f570fa4d394fc1589cc1d1e",
                    "703617c5a473944a1e1989c66aad90f4f58f5803b12687a9ad0bf4a50f6a9b51",
                    "79afeca1e56c4f7c6fcee683046694f9c3f21826a8a90b6bcf791ac64afc88fe",
                    "57f4bca7006b90237f6c202f454b70266039aaf210dc823b234e7241c7def43a",
                ),
                start=1,
            )
        ),
        loader=mr_damper,
        records=tuple(str(number) for number in range(1, 11)),
    ),
    Dataset(
        name="friction_pin",
        what="reciprocating slide under 5 N, 50 cycles of 0.24 mm (measured)",
        columns="u position (mm), w friction force (µN) with its sign flipped",
        rate="200 Hz, 42 579 rows",
        licence="MIT",
        citation="Christopherson, FrictionModels.jl",
        source=page(_FRICTION),
        files=(
            file(
                _FRICTION,
                "test_data_2.txt",
                "e0abf58da8288eebe180a8fe191f1f223a5e1c43025e37c3db7cfb03ce9488a5",
            ),
        ),
        loader=friction_pin,
    ),
    Dataset(
        name="boucwen_benchmark",
        what="Bouc-Wen oscillator of the nonlinear benchmark, multisine (simulated)",
        columns="u force (N), w displacement (m)",
        rate="750 Hz, four periods of 8192 rows",
        licence="CC BY-SA 4.0",
        citation=(
            "Noël and Schoukens, Hysteretic benchmark with a dynamic nonlinearity, "
            "4TU.ResearchData, doi:10.4121/12967592"
        ),
        source=page(_BOUCWEN),
        files=(
            file(
                _BOUCWEN,
                "uest_multisine.mat",
                "d397884e6b68cad06c91a1ee98dd84949a94826f56c4907aa1908583dc5c9a60",
            ),
            file(
                _BOUCWEN,
                "yest_multisine.mat",
                "ae0c7c0df174b61d17517c7092bc2b7d2888a695dbd9bca9a63c7c9fc067f605",
            ),
        ),
        loader=boucwen_benchmark,
        records=("all", "1", "2", "3", "4"),
    ),
    Dataset(
        name="friction_damper",
        what="banded rotary friction damper with backlash, sines at 30 lb (measured)",
        columns="u displacement (in), w friction force (kip)",
        rate="1024 Hz; 14 337 rows at 0.5 Hz, 7169 at 1 Hz",
        licence="CC BY-SA 4.0",
        citation=(
            "Coble, Huggins, Cao, Ricles and Downey, "
            "Dataset-Friction-Damper-with-Backlash, GitHub (2022)"
        ),
        source=page(_FRICTION_DAMPER),
        files=(
            file(
                _FRICTION_DAMPER,
                "0.5Hz30lbtension0.5amplitude.json",
                "7ded96e7236317bcdc574182473967c5c072e687c7d7b5e0b694bcf93a4eb7f9",
            ),
            file(
                _FRICTION_DAMPER,
                "0.5Hz30lbtension1amplitude.json",
                "3d58d0f71296a6221974c14454352fa29a27d536295fd5cb05e6d946a7cf30db",
            ),
            file(
                _FRICTION_DAMPER,
                "1Hz30lbtension0.5amplitude.json",
                "8d8c46dcbed3889ae8dbe6ff3698d67e6453349ab728a8915b22680453c4d277",
            ),
            file(
                _FRICTION_DAMPER,
                "1Hz30lbtension1amplitude.json",
                "ed02a98a96369937851bed92b4e5e92e34d98ceebd4db81d5bd65d5b77c4bc91",
            ),
        ),
        loader=friction_damper,
        records=("0.5Hz_0.5in", "0.5Hz_1in", "1Hz_0.5in", "1Hz_1in"),
    ),
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
