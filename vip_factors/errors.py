"""The exceptions of the package: one base, so that a caller can catch everything of ours at once.

Every message is one clear sentence: what was given, where, what was expected, and what to do.
"""


class VipFactorsError(Exception):
    """Base of every error that vip_factors raises on purpose."""


class InputError(VipFactorsError, ValueError):
    """What the user gave cannot be used: a value, a name, a combination of options."""


class FileFormatError(InputError):
    """A file is not what it should be: truncated, malformed, of another format."""


class RecordingError(InputError):
    """The samples of a recording are unusable: time running backwards, NaN everywhere, no sensor left."""


class SolveError(VipFactorsError):
    """The optimiser could not proceed: an indeterminate system, a cost that is not finite."""
