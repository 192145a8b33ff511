"""Observability: what no measurement can show, exactly and in words."""
