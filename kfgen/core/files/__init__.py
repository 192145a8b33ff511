"""Inputs and outputs on disk: checked before they are read, written whole or not at all."""
