"""Logs: time and named channels with units, and the readers of every file format."""

from kfgen.log.log import RATE_RELATIVE_TOLERANCE, Channel, Log, StoredChannel, StoredLog

__all__ = ["RATE_RELATIVE_TOLERANCE", "Channel", "Log", "StoredChannel", "StoredLog"]
