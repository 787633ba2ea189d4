"""Pages of the site that stand elsewhere in the repository, with their links turned to where they are in the site."""

import re
from pathlib import Path

from mkdocs.structure.files import File, Files

PROJECT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "config/README.md": "config.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
LINK = re.compile(r"(\[[^\]]*\])\(([^)#:\s]+)(#[^)\s]*)?\)")


def turned(text: str, folder: Path, home: str) -> str:
    """A page's text with links from `folder` of the repository made links from the page `home` of the site.

    A link to what the site does not have keeps its words only.
    """

    def turn(match: re.Match) -> str:
        words, path, anchor = match[1], match[2], match[3] or ""
        target = (folder / path).resolve()
        if not target.is_relative_to(PROJECT):
            return match[0]
        within = target.relative_to(PROJECT).as_posix()
        if within in PAGES:
            place = PAGES[within]
        elif within.startswith("docs/") and target.is_file():
            place = within.removeprefix("docs/")
        else:
            return words[1:-1]
        return f"{words}({'../' * home.count('/')}{place}{anchor})"

    return LINK.sub(turn, text)


def on_files(files: Files, config) -> Files:
    """Called by MkDocs: adds the pages that stand elsewhere."""
    for source, place in PAGES.items():
        path = PROJECT / source
        text = turned(path.read_text(encoding="utf-8"), path.parent, place)
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, page, config, files) -> str:
    """Called by MkDocs for each page: links of pages in docs/ that lead out of it."""
    place = page.file.src_uri
    if place in PAGES.values():
        return markdown
    return turned(markdown, (PROJECT / "docs" / place).parent, place)
