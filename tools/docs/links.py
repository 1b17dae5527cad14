"""Checks every relative link of the documents: the file exists, and so does the heading after `#`."""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

LINK = re.compile(r"!?\[(?:[^\]\[]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
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


def main() -> int:
    root = Path(__file__).resolve().parents[2]
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"]
    listed = subprocess.run(words, cwd=root, capture_output=True, text=True, check=True)
    pages = [Path(line) for line in listed.stdout.splitlines() if (root / line).exists()]
    faults = [fault for page in pages for fault in faults_of(root, page)]
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    print(f"links of {len(pages)} pages checked, {len(faults)} lead nowhere")
    return 1 if faults or not pages else 0


if __name__ == "__main__":
    sys.exit(main())
