"""The documentation as a site (./tachless docs): the pages that are here, and the API of C++ and Python."""

import pathlib
import re
import shutil
import sys

root = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(root / "build/release/python"))

project = "tachless"
author = "The tachless authors"
copyright = author
release = version = re.search(r"project\(tachless VERSION ([0-9.]+)", (root / "CMakeLists.txt").read_text())[1]

extensions = ["myst_parser", "breathe", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = ["docs/**.md", "*.md"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]

html_theme = "furo"
html_title = f"tachless {release}"
html_copy_source = False
# A run's page, which docs/site/report.md shows.
html_extra_path = [str(root / "build/docs/run/report.html")]

breathe_projects = {"tachless": str(root / "build/docs/doxygen/xml")}
breathe_default_project = "tachless"
breathe_default_members = ("members",)

chapters = {
    "Learn": "tutorial why_no_velocity examples faq",
    "Do": "install migration robots stiff_gains tuning identification studies report use_law own_law python ros2_control realtime real_robot drivers/* several_hosts",
    "Look up": "scenario laws/* trajectories plant protocol log faults security notation performance site/report site/cpp site/python",
    "Understand": "paper certificate certificate_theory studies/* decisions/* style",
}


def contents():
    """The chapters of docs/README.md as Sphinx wants them, for the front page."""
    for chapter, pages in chapters.items():
        listed = "\n".join("docs/" + page for page in pages.split())
        yield f"\n```{{toctree}}\n:hidden:\n:glob:\n:caption: {chapter}\n\n{listed}\n```\n"
    yield "\n```{toctree}\n:hidden:\n:caption: Project\n\ndocs/README\nCHANGELOG\nCONTRIBUTING\nSECURITY\n```\n"


def setup(app):
    def read(_app, page, source):
        if page == root_doc:
            source[0] += "".join(contents())

    def finished(app, error):
        if not error:
            shutil.copy(pathlib.Path(app.outdir, "README.html"), pathlib.Path(app.outdir, "index.html"))

    app.connect("source-read", read)
    app.connect("build-finished", finished)
