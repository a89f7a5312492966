"""The recording: its schema, checks of untrusted files, and files of elongations.

`from protocol.recording import ...` is the public interface of this package: all of `schema`.
"""

from protocol.recording.schema import *  # noqa: F403 - the interface of the package is its schema's
