"""Columns of numbers out of text, MATLAB, Parquet and other files."""

from ._json import json_matrix as json_matrix
from ._mat import MatTable as MatTable, read_mat as read_mat
from ._micromag import micromag_segments as micromag_segments
from ._parquet import parquet_columns as parquet_columns
from ._text import TextTable as TextTable, read_text as read_text
from ._times import times as times
