"""Sphinx: the pages of this folder, the reference of the public verbs, notebooks that are executed (``make docs``)."""

from __future__ import annotations

import kfgen

project = "kfgen"
author = "the authors of kfgen"
copyright = author
version = release = kfgen.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["build"]
language = "en"
suppress_warnings: list[str] = []

myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 3
nb_execution_mode = "force"  # what is shown is what the code of today says
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"kfgen {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["schemas"]
html_copy_source = False
html_show_sphinx = False
