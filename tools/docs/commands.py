"""Checks a command line without running it: do the program, the flags, the packages and the files exist?"""

import json
import re
import shlex
import subprocess
from functools import cache
from itertools import pairwise
from pathlib import Path

SHELL_BREAKS = {"|", "||", "&&", ";", "&", ">", ">>", "<", "2>", "(", ")", "{", "}"}


class CommandError(Exception):
    """A command line that names something that does not exist."""


def logical_lines(script: str) -> list[str]:
    """Lines of a shell script, continued lines joined, comments and here-documents left out."""
    lines: list[str] = []
    joined, until = "", None
    for line in script.splitlines():
        if until is not None:
            until = None if line.strip() == until else until
            continue
        joined += line.removesuffix("\\") + " "
        if line.endswith("\\"):
            continue
        heredoc = re.search(r"<<-?'?(\w+)'?", joined)
        until = heredoc.group(1) if heredoc else None
        lines.append(joined)
        joined = ""
    return lines


def commands(script: str) -> list[list[str]]:
    """Simple commands of a script as words, without assignments and redirections."""
    found: list[list[str]] = []
    for line in logical_lines(script):
        lexer = shlex.shlex(line, posix=True, punctuation_chars="();|&<>{}")
        lexer.whitespace_split = True
        words: list[str] = []
        for word in [*lexer, ";"]:
            if word in SHELL_BREAKS:
                if words:
                    found.append(words)
                words = []
            elif words or not re.fullmatch(r"\w+=.*", word):
                words.append(word)
    return found


class Checker:
    """Holds commands against the programs and packages of a checkout."""

    def __init__(self, root: Path, esaac: Path):
        self.root = root
        self.esaac = esaac
        self.help_of = cache(self._help_of)
        self.packages = cache(self._packages)

    def check(self, script: str) -> None:
        for words in commands(script):
            name = Path(words[0]).name
            if name == "esaac":
                self._check_esaac(words)
            elif name == "cargo":
                self._check_cargo(words)
            elif words[0].startswith("./tools/"):
                self._check_file(words[0])
            elif name in ("python", "python3", "python.sh", "isaaclab.sh"):
                for word in words[1:]:
                    if word.endswith(".py"):
                        self._check_file(word)

    def _check_file(self, path: str) -> None:
        if not (self.root / path).exists():
            raise CommandError(f"`{path}` is not in the checkout")

    def _help_of(self, command: str) -> str:
        words = [str(self.esaac), *([command] if command else []), "--help"]
        result = subprocess.run(words, capture_output=True, text=True, timeout=60)
        if result.returncode != 0:
            raise CommandError(f"`esaac {command}`: {result.stderr.strip()}")
        return result.stdout

    def _check_esaac(self, words: list[str]) -> None:
        command = next((word for word in words[1:] if not word.startswith("-")), "")
        known = set(re.findall(r"(?<![\w-])--[\w-]+", self.help_of(command)))
        for word in words[1:]:
            if word == "--ros-args":
                return  # what follows is ROS's
            if word.startswith("--") and word.split("=")[0] not in known:
                raise CommandError(f"`esaac {command}` has no `{word.split('=')[0]}`")

    def _packages(self) -> dict[str, dict]:
        words = ["cargo", "metadata", "--format-version=1", "--no-deps", "--offline", "--locked"]
        result = subprocess.run(words, cwd=self.root, capture_output=True, text=True, timeout=60)
        if result.returncode != 0:
            raise CommandError(result.stderr.strip())
        return {package["name"]: package for package in json.loads(result.stdout)["packages"]}

    def _check_cargo(self, words: list[str]) -> None:
        words = words[1 : words.index("--")] if "--" in words else words[1:]
        packages = self.packages()
        options = list(pairwise(words))
        named = [value for key, value in options if key in ("-p", "--package")]
        for name in named:
            if name not in packages:
                raise CommandError(f"there is no package `{name}`")
        searched = [packages[name] for name in named] or list(packages.values())
        for key, value in options:
            if key in ("--test", "--bench", "--example", "--bin"):
                kind = key[2:]
                targets = {t["name"] for p in searched for t in p["targets"] if kind in t["kind"]}
                if value not in targets:
                    raise CommandError(
                        f"there is no {kind} `{value}` in {', '.join(named) or 'the workspace'}"
                    )
            elif key == "--features":
                features = {f for p in searched for f in p["features"]}
                for feature in re.split(r"[ ,]", value):
                    package, _, own = feature.rpartition("/")
                    of = packages[package]["features"] if package in packages else features
                    if own not in of:
                        raise CommandError(f"there is no feature `{feature}` in {', '.join(named)}")
            elif key == "--path":
                self._check_file(value)
