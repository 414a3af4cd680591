"""Files that are written whole or not at all: see `pcsg.outputs`."""

from pcsg.outputs import check_output, write_whole

__all__ = ["check_output", "write_whole"]
