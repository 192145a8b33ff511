"""Emit targets: each a module with its printer, and a folder of templates."""
