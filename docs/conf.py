# SPDX-License-Identifier: Apache-2.0
"""Configuration of Sphinx: pages in Markdown, the API from docstrings, tables from the code."""

import sys
from pathlib import Path
from xml.etree import ElementTree

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / 'extensions'))

project = 'soliton_linkage'
author = 'soliton_linkage maintainers'
package = ElementTree.parse(HERE.parent / 'src/soliton_linkage/package.xml').getroot()
release = version = package.findtext('version', '')

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'mathml',
    'suite_docstrings',
    'suite_tables',
]
myst_enable_extensions = ['colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 3

autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_preserve_defaults = True
autodoc_default_options = {'members': True}
autodoc_type_aliases = {name: name for name in ('Array', 'ArrayLike')}
default_role = 'code'
highlight_language = 'none'
python_use_unqualified_type_names = True

html_math_renderer = 'mathml'
html_theme = 'furo'
html_title = f'soliton_linkage {release}'
html_static_path = ['static']
html_css_files = ['wide.css']
html_show_copyright = False
html_copy_source = False
html_theme_options = {'navigation_with_keys': True}
