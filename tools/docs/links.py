"""Checks what documents refer to.

- Every relative link: the file exists, and so does the heading after `#`.
- The lists of pages, in `docs/index.md` and at ARCHITECTURE's end, have the pages of the book.
- Every environment variable that the code reads is told of in CONTRIBUTING or in the guide.
"""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

LINK = re.compile(r"!?\[(?:[^\]\[]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
#: A page in the navigation of mkdocs.yml.
PAGE = re.compile(r"^ +- (?:.+: )?(\S+\.md)$", re.MULTILINE)
#: A variable of the environment: a string in a program, but for those of the build (`env!`), or an expansion in a
#: script.
VARIABLE = re.compile(r'(?<!env!\()"(ESAAC_\w*[A-Z0-9])"|\$\{?(ESAAC_\w*[A-Z0-9])')
HEADING = re.compile(r"^#{1,6}\s+(.*?)\s*#*$")


def prose(text: str) -> str:
    """A page without its fenced blocks and code spans."""
    text = re.sub(r"^```.*?^```\s*$", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "", text)


def anchors(text: str) -> set[str]:
    """Anchors of a page's headings, as GitHub and MkDocs make them."""
    found: set[str] = set()
    in_fence = False
    for line in text.splitlines():
        if line.startswith("```"):
            in_fence = not in_fence
        heading = None if in_fence else HEADING.match(line)
        if heading:
            plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading.group(1)).replace("`", "")
            slug = re.sub(r"[^\w\s-]", "", plain).strip().lower()
            slug = re.sub(r"[\s]+", "-", slug)
            number = 1
            name = slug
            while name in found:
                name = f"{slug}_{number}"
                number += 1
            found.add(name)
    return found


def faults_of(root: Path, page: Path) -> list[str]:
    """Links of a page that lead nowhere."""
    faults: list[str] = []
    for target in LINK.findall(prose((root / page).read_text())):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = ((root / page).parent / unquote(path)).resolve() if path else root / page
        if not file.is_relative_to(root):
            faults.append(f"{page}: `{target}` leads out of the checkout")
        elif not file.exists():
            faults.append(f"{page}: `{target}` does not exist")
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text()):
            faults.append(f"{page}: {file.relative_to(root)} has no heading for `#{anchor}`")
    return faults


def unlisted(root: Path, navigation: str) -> list[str]:
    """Pages of the book's navigation that a list of pages lacks. Experiments have a list of their own."""
    book = [page for page in PAGE.findall(navigation) if not page.startswith("design/experiments/")]
    # Pages of the repository's top level are part of the book, under their own paths.
    files = [root / "docs" / page if (root / "docs" / page).exists() else root / page for page in book]
    index, architecture = root / "docs/index.md", root / "ARCHITECTURE.md"
    faults: list[str] = []
    for page, wanted in (
        (index, [file for file in files if file != index]),
        (architecture, [file for file in files if file.parent == root / "docs/design"]),
    ):
        links = LINK.findall(prose(page.read_text()))
        linked = {(page.parent / unquote(link.partition("#")[0])).resolve() for link in links}
        faults += [
            f"{page.relative_to(root)}: no link to {file.relative_to(root)}, which is in docs/book/mkdocs.yml"
            for file in wanted
            if file not in linked
        ]
    return faults


def untold(root: Path, sources: list[Path], documents: list[Path]) -> list[str]:
    """Environment variables that sources read and no document names."""
    told = "\n".join((root / document).read_text() for document in documents)
    faults: list[str] = []
    for source in sources:
        found = {name or expanded for name, expanded in VARIABLE.findall((root / source).read_text())}
        faults += [
            f"{source}: `{name}` is neither in CONTRIBUTING.md nor in docs/guide"
            for name in sorted(found)
            if not re.search(rf"\b{name}\b", told)
        ]
    return faults


def files_of(root: Path, *patterns: str) -> list[Path]:
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *patterns]
    listed = subprocess.run(words, cwd=root, capture_output=True, text=True, check=True)
    return [Path(line) for line in listed.stdout.splitlines() if (root / line).exists()]


def main() -> int:
    root = Path(__file__).resolve().parents[2]
    pages = files_of(root, "*.md")
    faults = [fault for page in pages for fault in faults_of(root, page)]
    faults += unlisted(root, (root / "docs/book/mkdocs.yml").read_text())
    sources = files_of(root, "*.rs", "*.py", "*.sh", "*.c")
    faults += untold(root, sources, [Path("CONTRIBUTING.md"), *files_of(root, "docs/guide/*.md")])
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    print(f"{len(pages)} pages and the variables of {len(sources)} sources checked, {len(faults)} faults")
    return 1 if faults or not pages or not sources else 0


if __name__ == "__main__":
    sys.exit(main())
