"""Takes pages of the repository that lie outside `docs/` into the book, and turns links to them round.

On disk a page of `docs/guide` says `../../ARCHITECTURE.md`, so that its links hold in the repository. In the book
that page is `ARCHITECTURE.md`. Links to files that are no pages become plain text; tools/docs/links.py checks them on
disk.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[2]

OUTSIDE = [
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "benches/RESULTS.md",
    "interop/README.md",
    "kit_bridge/exts/esaac.sim/docs/README.md",
]

LINK = re.compile(r"(!?)\[((?:[^\]\[]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```[ ]*$)", re.MULTILINE | re.DOTALL)


def on_files(files, config):
    for path in [*OUTSIDE, *plots()]:
        # The README of a folder would be the folder's index.
        file = File.generated(config, path, abs_src_path=str(ROOT / path), inclusion=InclusionLevel.INCLUDED)
        files.append(file)
    return files


def plots():
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / "benches/results").rglob("*.svg"))


def on_page_markdown(markdown, page, config, files: Files):
    source = page.file.src_uri
    # Where the page lies in the repository.
    place = source if source in OUTSIDE else posixpath.join("docs", source)

    def turned(match):
        image, text, target = match.groups()
        path, hash_, anchor = target.partition("#")
        if not path or re.match(r"[a-z]+:", target):
            return match.group(0)
        in_repository = posixpath.normpath(posixpath.join(posixpath.dirname(place), path))
        in_book = in_repository.removeprefix("docs/")
        if files.get_file_from_path(in_book) is None:
            return text
        relative = posixpath.relpath(in_book, posixpath.dirname(source) or ".")
        return f"{image}[{text}]({relative}{hash_}{anchor})"

    parts = FENCE.split(markdown)
    return "".join(part if part.startswith("```") else LINK.sub(turned, part) for part in parts)
