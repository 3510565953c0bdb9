"""What hystjax raises on bad input and on failed computations."""


class InputError(ValueError):
    """An argument that cannot be used; the message says which, why and what to do."""


class ComputationError(RuntimeError):
    """A computation that ended without a usable value; `result` holds the reason."""

    def __init__(self, message: str, result=None):
        super().__init__(message)
        self.result = result
