"""Configuration of the documentation: `make docs`. Nothing is fetched from anywhere."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from cortet import __version__

project = "cortet"
version = release = __version__
language = "en-GB"
html_title = f"cortet {release}"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["cortet.css"]
html_copy_source = False
html_show_sphinx = False
html_last_updated_fmt = None  # the same sources make the same pages
_LIGHT, _DARK = "#14586a", "#8accdd"
html_theme_options = {
    f"{mode}_css_variables": dict.fromkeys(
        ("color-brand-primary", "color-brand-content", "color-api-name", "color-api-pre-name"), colour
    )
    for mode, colour in (("light", _LIGHT), ("dark", _DARK))
}
pygments_style, pygments_dark_style = "a11y-high-contrast-light", "a11y-high-contrast-dark"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "from_code"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
default_role = "literal"  # in docstrings
smartquotes_action = "D"  # dashes only

# a name in a page that stands for nothing is an error; types in signatures are words to read, not links
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring, napoleon_google_docstring = True, False
napoleon_use_rtype = False
python_display_short_literal_types = True
python_maximum_signature_line_length = 80
toc_object_entries_show_parents = "hide"
