"""What can go wrong with input, as types that every part of the toolkit shares."""


class InputError(ValueError):
    """Input that cannot be used. The message says what was expected, what was found and the next step.

    The command line prints it as one line and exits with code 2.
    """


class DataWarning(UserWarning):
    """Part of the input was dropped or repaired; the message carries the count."""
