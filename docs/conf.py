"""The documentation site: scripts/docs builds it into out/docs."""

import os
import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT / "python"))
import flexgram  # noqa: E402

project = "flexgram"
author = "the authors of flexgram"
release = version = flexgram.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["requirements*"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
html_theme = "furo"
html_title = f"flexgram {release}"
autodoc_typehints = "none"  # the docstrings give types, shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True  # attributes in a table, not as objects of their own
napoleon_custom_sections = [("Attributes", "params_style")]
suppress_warnings = ["myst.header"]

#: Files outside this folder that are pages of the site: page -> file.
PAGES = {
    "index": ROOT / "README.md",
    "made/architecture": ROOT / "src" / "README.md",
    "made/contributing": ROOT / "CONTRIBUTING.md",
    "made/changes": ROOT / "CHANGELOG.md",
    "made/examples": ROOT / "examples" / "README.md",
}


def with_site_links(text: str, source: Path, page: str) -> str:
    """Links between files of the repository as links between pages; files that are no pages by
    their names alone."""
    pages = {file: name for name, file in PAGES.items()}

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.group(1), match.group(2), match.group(3)
        if target.startswith(("http", "#")):
            return match.group(0)
        path, _, anchor = target.partition("#")
        file = (source.parent / path).resolve()
        if not file.exists():
            raise ValueError(f"{source}: no such file: {target}")
        inside = file.is_relative_to(DOCS)
        if not inside and file not in pages:
            return words if words.startswith("`") else f"`{words}`"
        name = str(file.relative_to(DOCS)) if inside else pages[file] + ".md"
        here = os.path.relpath(DOCS / name, (DOCS / page).parent)
        return f"{picture}[{words}]({here}{'#' + anchor if anchor else ''})"

    return re.sub(r"(!?)\[([^\]]+)\]\(([^)\s]+)\)", link, text)


def read(app, page, content):
    """Sphinx's hook: the text of a page."""
    source = PAGES.get(page, DOCS / f"{page}.md")
    if source.suffix != ".md" or not source.exists():
        return
    text = content[0]
    if page == "index":
        text = source.read_text() + text
    content[0] = with_site_links(text, source, page)


def setup(app):
    (DOCS / "made").mkdir(exist_ok=True)
    for page, file in PAGES.items():
        if page != "index":
            (DOCS / f"{page}.md").write_text(file.read_text())
    app.connect("source-read", read)
