"""Steels and a sediment: their files, checksums, terms and loaders."""

from . import _material_loaders
from ._entry import Dataset
from ._source import NO_LICENCE, SMART_HYSTERESIS, file, page

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
        loader=_material_loaders.no27_steel,
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
        loader=_material_loaders.steel_m130_27s,
        records=_material_loaders.M130_LOOPS,
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
        loader=_material_loaders.steel_coupon,
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
        loader=_material_loaders.forc_md00,
    ),
)
