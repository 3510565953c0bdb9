"""What a file of a model holds: plain values, and the names of what they make."""

from ._decoding import (
    Context as Context,
    Storable as Storable,
    check_known as check_known,
    difference as difference,
)
from ._encoding import (
    MOST_BYTES as MOST_BYTES,
    check_candidates as check_candidates,
    check_text as check_text,
    encoded as encoded,
    register as register,
)
