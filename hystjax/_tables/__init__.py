"""Columns of numbers out of text files and MATLAB files."""

from ._mat import MatTable as MatTable, read_mat as read_mat
from ._text import TextTable as TextTable, read_text as read_text
from ._times import times as times
