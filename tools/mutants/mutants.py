#!/usr/bin/env python3
"""Makes one-line changes to the sources, one at a time, and reports which of them no test notices.

Each change (a mutant) is a search text and its replacement in `list.toml`. It is made in a scratch copy of the
checkout, never in the checkout itself. `docs/design/mutants.md` says how to run this and what came of it.
"""

import argparse
import datetime
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:
    sys.exit(f"Python {sys.version.split()[0]} has no tomllib; expected Python 3.11 or newer")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import process_group

REPOSITORY = Path(__file__).resolve().parents[2]
LIST = Path(__file__).resolve().with_name("list.toml")

KILLED, SURVIVED, BROKEN = "killed", "survived", "does not compile"


class Problem(Exception):
    """What the user has to mend."""


@dataclass(frozen=True)
class Suite:
    """Tests of one executable: a package, cargo's choice of target, and which of its tests run."""

    name: str
    package: str
    target: list[str]
    tests: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Mutant:
    """A change of one line. `survives` is the reason why no test can notice it, if that is known."""

    name: str
    file: str
    search: str
    replace: str
    about: str
    suites: list[str]
    survives: str = ""

    def change(self, text: str) -> str:
        """The text with the change made; the search text must stand there exactly once."""
        count = text.count(self.search)
        if count != 1:
            raise Problem(f"{self.name}: `{self.search}` is {count} times in {self.file}, expected once")
        if "\n" in self.search + self.replace or self.search == self.replace:
            raise Problem(f"{self.name}: expected another text within one line")
        return text.replace(self.search, self.replace)


@dataclass
class Result:
    """What became of a mutant; `by` is the suite that noticed it, or why it did not compile."""

    name: str
    outcome: str
    by: str
    seconds: float
    commit: str
    date: str
    entry: str


def read_list(path: Path) -> tuple[dict[str, Suite], list[Mutant]]:
    """The suites and the mutants of a list, each named once and whole."""
    table = tomllib.loads(path.read_text())
    try:
        suites = {name: Suite(name=name, **suite) for name, suite in table["suite"].items()}
        mutants = [Mutant(**mutant) for mutant in table["mutant"]]
    except (KeyError, TypeError) as error:
        raise Problem(f"{path}: {error}") from error
    for mutant in mutants:
        unknown = [suite for suite in mutant.suites if suite not in suites]
        if unknown or not mutant.suites:
            raise Problem(f"{mutant.name}: suites {mutant.suites}, expected some of {sorted(suites)}")
    names = [mutant.name for mutant in mutants]
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise Problem(f"{path}: {doubled} stand there more than once")
    return suites, mutants


def check(mutants: list[Mutant], sources: Path) -> None:
    """Fails, naming each, where an entry does not apply exactly once."""
    problems = []
    for mutant in mutants:
        try:
            mutant.change((sources / mutant.file).read_text())
        except (OSError, Problem) as problem:
            problems.append(str(problem))
    if problems:
        raise Problem("\n".join(problems))


def fingerprint(mutant: Mutant) -> str:
    """Changes with the entry, so that results of another entry are not taken for this one's."""
    text = "\0".join([mutant.file, mutant.search, mutant.replace, *mutant.suites])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def git(*arguments: str) -> str:
    command = ["git", "-C", str(REPOSITORY), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def copy_checkout(scratch: Path) -> None:
    """Makes `scratch` equal to the checkout. Files that are the same keep their times, and their builds."""
    listed = git("ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0")
    wanted = {name for name in listed if name and (REPOSITORY / name).is_file()}
    for old in [path for path in scratch.rglob("*") if path.is_file()]:
        if str(old.relative_to(scratch)) not in wanted:
            old.unlink()
    for name in wanted:
        source, target = REPOSITORY / name, scratch / name
        if not target.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
        elif target.read_bytes() != source.read_bytes():
            # With the present time: it is newer than whatever was built of the old content.
            target.write_bytes(source.read_bytes())


def run_limited(command: list[str], limit_s: float, **options) -> tuple[int | None, str]:
    """Exit status, `None` beyond the limit, and what the command said. Ends all that it started."""
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        **options,
    )
    try:
        said, complained = process.communicate(timeout=limit_s)
        return process.returncode, said + complained
    except subprocess.TimeoutExpired:
        return None, ""
    finally:
        process_group.end(process)


class Workshop:
    """The scratch copy and its build folder."""

    def __init__(self, folder: Path, cargo: str, limit_s: float):
        self.tree = folder / "tree"
        self.cargo = cargo
        self.limit_s = limit_s
        self.environment = {
            # Not the validation layer: kernels compile several times as fast without it.
            **{key: value for key, value in os.environ.items() if key != "ESAAC_VALIDATION"},
            "CARGO_TARGET_DIR": str(folder / "build"),
            "CARGO_INCREMENTAL": "1",
            "RUST_BACKTRACE": "0",
        }

    def build(self, suite: Suite) -> Path:
        """The suite's executable."""
        command = [
            self.cargo,
            "test",
            "--locked",
            "--no-run",
            "--message-format=json",
            "--package",
            suite.package,
        ]
        status, said = run_limited(
            [*command, *suite.target],
            self.limit_s * 10,
            cwd=self.tree,
            env=self.environment,
        )
        if status is None:
            raise Problem(f"building {suite.name} took more than {self.limit_s * 10:.0f} s")
        messages = [json.loads(line) for line in said.splitlines() if line.startswith('{"reason"')]
        built = [
            m["executable"] for m in messages if m.get("profile", {}).get("test") and m.get("executable")
        ]
        if status != 0:
            errors = [line for line in said.splitlines() if "error" in line and not line.startswith("{")]
            rendered = [m["message"]["message"] for m in messages if m["reason"] == "compiler-message"]
            raise BuildError((errors + rendered + ["no message"])[0])
        if len(built) != 1:
            raise Problem(f"suite {suite.name} has {len(built)} executables, expected 1")
        return Path(built[0])

    def passes(self, suite: Suite) -> tuple[bool, str]:
        """Whether all tests of a suite pass, and the first that does not."""
        executable = self.build(suite)
        folder = self.package_folder(suite.package)
        status, said = run_limited(
            [str(executable), *suite.tests],
            self.limit_s,
            cwd=folder,
            env=self.environment,
        )
        if status is None:
            return False, f"{suite.name}: beyond {self.limit_s:.0f} s"
        if status == 0:
            if "test result: ok. 0 passed" in said:
                raise Problem(f"suite {suite.name} has no test named {suite.tests}")
            return True, ""
        failed = [
            line.split()[1] for line in said.splitlines() if line.startswith("test ") and "FAILED" in line
        ]
        return False, f"{suite.name}: {failed[0] if failed else f'exit status {status}'}"

    def package_folder(self, package: str) -> Path:
        """Where cargo runs a package's tests."""
        for manifest in self.tree.rglob("Cargo.toml"):
            if tomllib.loads(manifest.read_text()).get("package", {}).get("name") == package:
                return manifest.parent
        raise Problem(f"no package {package} in {self.tree}")

    def judge(self, mutant: Mutant, suites: dict[str, Suite]) -> tuple[str, str]:
        """Outcome of a mutant, and who noticed it. The scratch copy is whole again afterwards."""
        path = self.tree / mutant.file
        original = path.read_text()
        path.write_text(mutant.change(original))
        try:
            for name in mutant.suites:
                passed, by = self.passes(suites[name])
                if not passed:
                    return KILLED, by
            return SURVIVED, ""
        except BuildError as error:
            return BROKEN, str(error)
        finally:
            path.write_text(original)


class BuildError(Exception):
    """The compiler's first words."""


def show(done: int, total: int, what: str) -> None:
    """A progress bar on a terminal, lines elsewhere."""
    if sys.stderr.isatty():
        filled = 40 * done // max(total, 1)
        print(f"\r\x1b[K[{'#' * filled}{'.' * (40 - filled)}] {done}/{total} {what}", end="", file=sys.stderr)
    else:
        print(f"{done}/{total} {what}", file=sys.stderr, flush=True)


def table(mutants: list[Mutant], results: dict[str, Result]) -> str:
    """The results as Markdown."""
    rows = ["| mutant | file | the change | result |", "|---|---|---|---|"]
    for mutant in mutants:
        result = results.get(mutant.name)
        outcome = (
            "not run" if result is None else f"{result.outcome}{f' by {result.by}' if result.by else ''}"
        )
        cells = [mutant.name, f"`{mutant.file}`", mutant.about, outcome]
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="only check that each entry applies exactly once"
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="TEXT", help="mutants whose name or file has it"
    )
    parser.add_argument(
        "--resume", action="store_true", help="keep earlier results of entries that are the same"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there, too")
    parser.add_argument(
        "--table", action="store_true", help="print all results so far as Markdown, and run nothing"
    )
    parser.add_argument(
        "--limit-s", type=float, default=300.0, help="longest run of a suite (default: %(default)s)"
    )
    parser.add_argument("--cargo", default="cargo", help="program to call in place of cargo")
    parser.add_argument(
        "--folder", type=Path, default=REPOSITORY / "target" / "mutants", help="scratch copy and build"
    )
    return parser.parse_args()


def main() -> int:
    options = arguments()
    suites, mutants = read_list(LIST)
    check(mutants, REPOSITORY)
    if options.check:
        print(f"{len(mutants)} mutants apply")
        return 0
    options.folder.mkdir(parents=True, exist_ok=True)
    saved = options.folder / "results.json"
    results = {}
    if (options.resume or options.only or options.table) and saved.exists():
        results = {entry["name"]: Result(**entry) for entry in json.loads(saved.read_text())["results"]}
    entries = {mutant.name: fingerprint(mutant) for mutant in mutants}
    results = {name: result for name, result in results.items() if entries.get(name) == result.entry}
    if options.table:
        print(table(mutants, results))
        return 0

    chosen = [m for m in mutants if not options.only or any(t in m.name or t in m.file for t in options.only)]
    if not chosen:
        raise Problem(f"no mutant has {options.only} in its name or file")
    to_run = [m for m in chosen if not (options.resume and m.name in results)]
    workshop = Workshop(options.folder, options.cargo, options.limit_s)
    copy_checkout(workshop.tree)
    commit = git("describe", "--always", "--dirty", "--exclude=*").strip()
    needed = sorted({suite for mutant in to_run for suite in mutant.suites})
    for number, name in enumerate(needed):
        show(number, len(needed), f"unchanged sources: {name}")
        try:
            passed, by = workshop.passes(suites[name])
        except BuildError as error:
            raise Problem(f"the unchanged sources do not compile: {name}: {error}") from error
        if not passed:
            raise Problem(f"the unchanged sources fail: {by}")
    for number, mutant in enumerate(to_run):
        show(number, len(to_run), mutant.name)
        began = time.monotonic()
        outcome, by = workshop.judge(mutant, suites)
        seconds = round(time.monotonic() - began, 1)
        date = datetime.date.today().isoformat()
        results[mutant.name] = Result(mutant.name, outcome, by, seconds, commit, date, entries[mutant.name])
        show(number + 1, len(to_run), f"{mutant.name}: {outcome} {by} ({seconds} s)")
        # After each, so that a run which is cut short can go on.
        text = json.dumps({"results": [asdict(result) for result in results.values()]}, indent=1)
        for path in [saved, options.json]:
            if path:
                path.write_text(text + "\n")
    return report(chosen, results)


def report(mutants: list[Mutant], results: dict[str, Result]) -> int:
    """Prints the counts and what is not as the list has it; the exit status is 1 if there is such."""
    print(file=sys.stderr)
    of = {
        outcome: [m for m in mutants if results[m.name].outcome == outcome]
        for outcome in (KILLED, SURVIVED, BROKEN)
    }
    print(", ".join(f"{len(found)} {outcome}" for outcome, found in of.items()))
    surprises = [f"{m.name} survived: {m.about}" for m in of[SURVIVED] if not m.survives]
    surprises += [
        f"{m.name} was killed, though the list says that it survives" for m in of[KILLED] if m.survives
    ]
    surprises += [f"{m.name} does not compile: {results[m.name].by}" for m in of[BROKEN]]
    print("\n".join(surprises))
    return 1 if surprises else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Problem as problem:
        sys.exit(f"mutants: {problem}")
