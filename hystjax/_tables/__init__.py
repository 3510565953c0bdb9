"""Columns of numbers out of text, MATLAB and Parquet files."""

from ._mat import MatTable as MatTable, read_mat as read_mat
from ._parquet import parquet_columns as parquet_columns
from ._text import TextTable as TextTable, read_text as read_text
from ._times import times as times
