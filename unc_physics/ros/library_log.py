"""What the library has to say, in the node's log: that kernels are being compiled, for one."""

import logging

LIBRARY = logging.getLogger("unc_physics")


class LibraryLog(logging.Handler):
    """Passes messages of the library on to a node's logger, until it is closed.

    Parameters
    ----------
    log : rclpy logger
    """

    def __init__(self, log):
        super().__init__()
        self._log = log
        LIBRARY.addHandler(self)

    def emit(self, record):
        """Pass one on; rclpy remembers the severity of each call in the source, so there is one."""
        self._log.info(record.getMessage())

    def close(self):
        """Pass nothing on any more."""
        LIBRARY.removeHandler(self)
        super().close()
