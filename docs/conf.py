"""How Sphinx builds the pages: ``make docs``."""

from __future__ import annotations

import builtins
import os
import re
import sys
import tempfile
import tomllib
from pathlib import Path

from mpi4py import MPI  # noqa: F401  first: it loads the MPI library of DOLFINx's wheel

from sphinx_gallery.scrapers import figure_rst

HOME = Path(__file__).parents[1]
PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
RESULTS = Path(tempfile.mkdtemp(prefix="mpm_fenicsx_gallery_"))  # of demos that are run
sys.path.insert(0, str(HOME))
import mpm_fenicsx  # noqa: E402  from this copy of the source

os.environ.setdefault("OMP_NUM_THREADS", "1")

project = "mpm_fenicsx"
author = PROJECT["authors"][0]["name"]
version = release = mpm_fenicsx.__version__
copyright = author
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "**/GALLERY_HEADER.rst"]
nitpicky = True
suppress_warnings = ["config.cache"]  # of the gallery's functions, which no cache can hold

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

html_theme = "pydata_sphinx_theme"
html_title = "mpm_fenicsx"
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
}

# -- the interface ---------------------------------------------------------------------------------

autosummary_generate = False  # the pages of api/ say what goes where
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
# Types of other packages, and of this one that are no part of its interface, have no page here.
nitpick_ignore_regex = [("py:.*", r"(?!mpm_fenicsx\.).*"), ("py:.*", r"mpm_fenicsx\.\w+\..*")]


def indented_is_literal(app, what, name, obj, options, lines):
    """An indented block after a colon is a formula or code: it keeps its lines."""
    for i in range(len(lines) - 2):
        block = not lines[i + 1].strip() and lines[i + 2].startswith("    ")
        if block and re.search(r"(?<!:):$", lines[i]) and not lines[i].startswith(" "):
            lines[i] += ":"


# -- the gallery -----------------------------------------------------------------------------------


def written_figures(block, block_vars, gallery_conf):
    """Pictures that a demo has written into its folder of results."""
    shown = []
    for picture in sorted(RESULTS.glob("*.png")):
        target = next(block_vars["image_path_iterator"])
        Path(target).parent.mkdir(parents=True, exist_ok=True)
        picture.rename(target)
        shown.append(target)
    return figure_rst(shown, gallery_conf["src_dir"])


def arguments(gallery_conf, script_vars):
    """What demos are called with: results go to a temporary folder, the long ones are quick."""
    builtins.__file__ = script_vars["src_file"]  # demos ask for it, and the gallery gives them none
    name = Path(script_vars["src_file"]).name
    options = {name: [] for name in ("column.py", "column_3d.py", "footing_3d.py", "lamb.py")}
    options |= {name: [] for name in ("cavity.py", "strip_load.py", "slope_failure.py")}
    options["site_response.py"] = []
    options |= {name: ["--quick"] for name in ("dam_on_rock.py", "slope_earthquake.py")}
    options["basin.py"] = ["--quick"]
    options["column_collapse.py"] = ["--aspects", "0.5", "1", "--no-clay"]
    options["foundation.py"] = ["--quick"]
    return [*options[name], "--results", str(RESULTS)] if name in options else []


sphinx_gallery_conf = {
    "examples_dirs": "../demos",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": "foundation_figures",
    "image_scrapers": (written_figures,),
    "reset_argv": arguments,
    "within_subsection_order": "FileNameSortKey",
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "plot_gallery": "True",
}


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", indented_is_literal)
