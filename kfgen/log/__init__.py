"""Logs: time and named channels with units, and the readers of every file format."""

from kfgen.log.log import CONTRADICTION, Channel, Log, StoredChannel, StoredLog

__all__ = ["CONTRADICTION", "Channel", "Log", "StoredChannel", "StoredLog"]
