"""What a file of a model holds: plain values, and the names of what they make."""

from ._decoding import Context as Context
from ._encoding import encoded as encoded
from ._registry import (
    MOST_BYTES as MOST_BYTES,
    check_candidates as check_candidates,
    check_text as check_text,
    register as register,
)
from ._storable import Storable as Storable, difference as difference
