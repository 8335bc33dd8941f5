# SPDX-License-Identifier: Apache-2.0
"""What the calls of nearmesh raise. Texts are those of the C++ library: the thing, the place, what was expected and found."""


class Error(Exception):
    """Any trouble that nearmesh reports."""


class InvalidArgumentError(Error, ValueError):
    """A value is outside its stated range."""


class NotFoundError(Error, LookupError):
    """The named thing does not exist."""


class CorruptError(Error, ValueError):
    """Bytes contradict their checksum or their format."""


class UnsupportedError(Error):
    """Well formed, but of a version or size that this build does not handle."""


class IoError(Error, OSError):
    """The operating system refused."""


class ConflictError(Error):
    """Contradicts what is already held or there."""
