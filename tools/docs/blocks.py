"""Fenced blocks of a Markdown page, and what the page says about running them."""

from dataclasses import dataclass
from pathlib import Path

#: A paragraph of this form right above a block says why the tests do not run it.
NOT_RUN = "*Not run by the tests: "

#: Every block has one of these languages. An untagged block would be Rust to rustdoc and plain text to MkDocs.
LANGUAGES = ("sh", "python", "rust", "toml", "c", "json", "text")


class PageError(Exception):
    """A page that cannot be read as it is meant."""


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    page: Path
    line: int
    language: str
    text: str
    #: Why the tests do not run it; empty if they do.
    not_run: str

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(page: Path, text: str) -> list[Block]:
    """All fenced blocks of a page, in order."""
    found: list[Block] = []
    note = ""
    start: int | None = None
    language = ""
    body: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        if start is not None:
            if line.rstrip() == "```":
                found.append(Block(page, start, language, "\n".join(body) + "\n", note))
                start, note = None, ""
            else:
                body.append(line)
        elif line.startswith("```"):
            start, language, body = number, line[3:].strip(), []
            if language not in LANGUAGES:
                raise PageError(
                    f"{page}:{number}: language `{language}`, expected one of {', '.join(LANGUAGES)}"
                )
        elif line.lstrip().startswith("```"):
            raise PageError(f"{page}:{number}: an indented fence, which MkDocs does not read as a block")
        elif line.startswith(NOT_RUN):
            note = line[len(NOT_RUN) :].rstrip("*. ")
            if not line.rstrip().endswith("*") or not note:
                raise PageError(f"{page}:{number}: expected `{NOT_RUN}REASON.*` on one line")
        elif line.strip():
            if note:
                raise PageError(f"{page}:{number}: expected a fenced block after `{NOT_RUN}{note}.*`")
    if start is not None:
        raise PageError(f"{page}:{start}: the fence is not closed")
    if note:
        raise PageError(f"{page}: `{NOT_RUN}{note}.*` has no block after it")
    return found
