"""Runs every command of the README and the guide, and checks the commands of all other pages.

Blocks of a page run in order, in one temporary folder that looks like the checkout: shell blocks with `bash -euo
pipefail`, Python blocks in one interpreter. The program is the debug build, also where a page builds it with
`--release`. A block below the note `*Not run by the tests: REASON.*` is checked and not run.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import process_group
from blocks import Block, PageError, blocks
from commands import Checker, CommandError

#: Pages whose blocks are run. Blocks of all other pages are only checked.
RUN = ("README.md", "docs/guide/*.md")
CHECKED = ("ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/design/*.md", "docs/reference/*.md")

#: A page whose Rust blocks are run is a doctest of this file.
RUST_DOCTESTS = "tests/src/lib.rs"

BLOCK_LIMIT_S = 180

# Stands in for cargo where a page builds the program with `--release`, which takes minutes: the debug build is there
# already. Any other use of cargo is an error.
CARGO = """#!/usr/bin/env bash
set -euo pipefail
export PATH="$DOCS_PATH"
case "$*" in
    --version) exec cargo --version ;;
    build*--release*"-p esaac-cli") cargo pkgid --locked --quiet -p esaac-cli >/dev/null ;;
    *) echo "cargo $*: expected cargo build --release ... -p esaac-cli; say why the block is not run" >&2; exit 1 ;;
esac
"""

# Bash forgets a job that has ended once the next command begins, unless it is asked by number. So all are noted.
NOTE_JOBS = "true & noted_jobs=; trap 'noted_jobs+=\" $!\"' DEBUG; "
WAIT_FOR_JOBS = '\n:\nfor job in $noted_jobs $(jobs -p); do wait "$job"; done\n'

# Runs blocks that come as JSON strings on standard input; answers on descriptor 3.
INTERPRETER = """
import json, os, sys, traceback
answers, names = os.fdopen(3, "w"), {"__name__": "__main__"}
for line in sys.stdin:
    try:
        block = json.loads(line)
        exec(compile(block["text"], block["place"], "exec"), names)
        answer = ""
    except BaseException:
        answer = traceback.format_exc()
    sys.stdout.flush()
    answers.write(json.dumps(answer) + "\\n")
    answers.flush()
"""


class RunError(Exception):
    """A block that failed."""


class Runner:
    """Runs the blocks of one page."""

    def __init__(self, root: Path, target: Path, python: Path | None):
        self.root, self.target, self.python = root, target, python
        self.interpreter: subprocess.Popen | None = None
        self.answers = None

    @contextmanager
    def page(self) -> Iterator[None]:
        """A fresh folder that looks like the checkout; `target` in it holds the debug build under both names."""
        with tempfile.TemporaryDirectory(prefix="esaac-docs-") as folder:
            self.folder = Path(folder) / "checkout"
            (self.folder / "target").mkdir(parents=True)
            for entry in self.root.iterdir():
                if entry.name not in ("target", ".git", "out", "bench", "run"):
                    (self.folder / entry.name).symlink_to(entry)
            for profile in ("debug", "release"):
                (self.folder / "target" / profile).symlink_to(self.target / "debug")
            tools = Path(folder) / "bin"
            tools.mkdir()
            (tools / "cargo").write_text(CARGO)
            (tools / "cargo").chmod(0o755)
            path = [str(tools), str(self.target / "debug"), os.environ["PATH"]]
            if self.python:
                # After the build: the wheel has an `esaac` too.
                path.insert(2, str(self.python.parent))
            self.environment = {
                **os.environ,
                "PATH": os.pathsep.join(path),
                "DOCS_PATH": os.environ["PATH"],
                "CARGO_TARGET_DIR": str(self.folder / "target"),
                # What is published stays on this machine.
                "ROS_LOCALHOST_ONLY": "1",
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            }
            self.environment.pop("ESAAC_DEVICE", None)
            try:
                yield
            finally:
                self._close_interpreter()

    def shell(self, block: Block) -> None:
        words = ["bash", "-euo", "pipefail", "-c", NOTE_JOBS + block.text + WAIT_FOR_JOBS]
        with tempfile.TemporaryFile("w+") as output:
            process = subprocess.Popen(
                words,
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                code = process.wait(BLOCK_LIMIT_S)
                fault = "" if code == 0 else f"exit code {code}, expected 0"
            except subprocess.TimeoutExpired:
                fault = f"still running after {BLOCK_LIMIT_S} s"
            finally:
                # Also ends what the block left in the background.
                process_group.end(process)
            if fault:
                output.seek(0)
                raise RunError(f"{fault}\n{output.read()[-4000:]}")

    def python_block(self, block: Block) -> None:
        if self.python is None:
            raise RunError("no Python with the package `esaac`; give one with --python")
        if self.interpreter is None:
            read, write = os.pipe()
            # Descriptor 3 in the child, whatever number the pipe has here.
            words = ["bash", "-c", f'exec 3>&{write} "$0" -c "$1"', str(self.python), INTERPRETER]
            self.interpreter = subprocess.Popen(
                words,
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.PIPE,
                pass_fds=[write],
                text=True,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
            os.close(write)
            self.answers = os.fdopen(read)
        signal.signal(signal.SIGALRM, self._late)
        signal.alarm(BLOCK_LIMIT_S)
        try:
            self.interpreter.stdin.write(json.dumps({"text": block.text, "place": block.place}) + "\n")
            self.interpreter.stdin.flush()
            answer = self.answers.readline()
        finally:
            signal.alarm(0)
        if not answer:
            raise RunError(f"Python ended with code {self.interpreter.wait()}")
        if fault := json.loads(answer):
            raise RunError(fault)

    def _late(self, *_: object) -> None:
        raise RunError(f"still running after {BLOCK_LIMIT_S} s")

    def _close_interpreter(self) -> None:
        if self.interpreter is not None:
            process_group.end(self.interpreter)
            self.answers.close()
            self.interpreter.stdin.close()
            self.interpreter = None


def expanded(root: Path, patterns: tuple[str, ...]) -> list[Path]:
    """Files of the patterns, relative to the root. A pattern without a file is an error."""
    pages: list[Path] = []
    for pattern in patterns:
        found = sorted(path.relative_to(root) for path in root.glob(pattern))
        if not found:
            raise PageError(f"{pattern}: no such page")
        pages += found
    return pages


def check(block: Block, checker: Checker) -> None:
    """What every block must hold, whether it is run or not."""
    if block.language == "sh":
        checker.check(block.text)
    elif block.language == "python":
        compile(block.text, block.place, "exec")
    elif block.language == "toml":
        tomllib.loads(block.text)
    elif block.language == "json":
        json.loads(block.text)


def run_page(page: Path, runs: bool, runner: Runner, checker: Checker) -> list[str]:
    """Runs or checks a page and returns its faults."""
    faults: list[str] = []
    found = blocks(page, (runner.root / page).read_text())
    doctests = (runner.root / RUST_DOCTESTS).read_text()
    with runner.page():
        for block in found:
            began, done = time.monotonic(), "checked"
            try:
                check(block, checker)
                if runs and not block.not_run and block.language in ("sh", "python"):
                    {"sh": runner.shell, "python": runner.python_block}[block.language](block)
                    done = "ran"
                elif runs and block.language == "rust" and str(page) not in doctests:
                    raise RunError(
                        f"{RUST_DOCTESTS} does not include {page}, so that nothing runs this block"
                    )
            except (RunError, CommandError, SyntaxError, ValueError) as error:
                faults.append(f"{block.place}: {error}")
                done = "FAILED"
                # Later blocks of the page may need what this one makes.
                if runs:
                    break
            finally:
                print(
                    f"{time.monotonic() - began:6.1f} s  {done:7}  {block.place} {block.language}", flush=True
                )
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[2])
    parser.add_argument("--target", type=Path, help="build folder [default: ROOT/target]")
    parser.add_argument("--python", type=Path, help="Python that has the package `esaac`")
    parser.add_argument("pages", nargs="*", type=Path, help="pages to run [default: all]")
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    target = (arguments.target or root / "target").resolve()
    esaac = target / "debug" / "esaac"
    if not esaac.exists():
        sys.exit(f"error: no {esaac}; run: cargo build -p esaac-cli")
    if shutil.which("bash") is None:
        sys.exit("error: no bash")
    # Absolute, but not resolved: a virtual environment's python is a link.
    runner = Runner(root, target, arguments.python.absolute() if arguments.python else None)
    checker = Checker(root, esaac)
    faults: list[str] = []
    try:
        pages = [(page, True) for page in expanded(root, RUN)] + [
            (page, False) for page in expanded(root, CHECKED)
        ]
        asked = {path.as_posix() for path in arguments.pages}
        if unknown := asked - {page.as_posix() for page, _ in pages}:
            sys.exit(f"error: {', '.join(sorted(unknown))}: not among {', '.join(str(p) for p, _ in pages)}")
        for page, runs in pages:
            if not asked or page.as_posix() in asked:
                faults += run_page(page, runs, runner, checker)
    except PageError as error:
        faults.append(str(error))
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
