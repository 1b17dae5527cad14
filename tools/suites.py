#!/usr/bin/env python3
"""Runs test suites side by side: `tools/suites.py --suite packets --suite stages -- --skip rigid`.

A suite is a test program of cargo: a file in a `tests` folder, or the unit tests of a package. Most of a suite's
time is one thread's, the one that compiles a kernel for the software driver, and `cargo test` runs one suite after
the other. This runs as many at once as there are cores. What follows `--` goes to each suite. Prints each suite's
time; the output only of those that fail.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess
import sys
import time

LONGEST_FIRST = (
    "exact_paths",
    "process",
    "physical",
    "gpu_against_oracle",
    "layers",
    "gpu_policy",
    "reload",
    "random_rigs",
    "resting",
    "recover_physical",
    "readout",
    "stages",
)
"""Suites that begin first, so that none of them is left alone at the end."""


def build(wanted):
    """Builds the workspace's suites; returns (name, folder of the package, program) of those `wanted`, or of all.

    The workspace as a whole is named even for a single suite: a package alone would get its dependencies with other
    features, and they would be compiled once more.
    """
    command = ["cargo", "test", "--workspace", "--locked", "--no-run"]
    for name in wanted:
        command += ["--lib", "--bins"] if name == "unit" else ["--test", name]
    command.append("--message-format=json-render-diagnostics")
    told = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    suites = []
    for line in told.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["profile"]["test"]:
            folder, target = pathlib.Path(message["manifest_path"]).parent, message["target"]
            name = target["name"] if "test" in target["kind"] else f"unit tests of {target['name']}"
            suites.append((name, folder, message["executable"]))
    order = {name: number for number, name in enumerate(LONGEST_FIRST)}
    return sorted(suites, key=lambda suite: order.get(suite[0], len(order)))


def run(suite, arguments):
    """Runs a suite as cargo does; returns its name, its status, its output and its time in seconds."""
    name, folder, program = suite
    started = time.monotonic()
    environment = {**os.environ, "CARGO_MANIFEST_DIR": str(folder)}
    done = subprocess.run(
        [program, *arguments],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    return name, done.returncode, done.stdout, time.monotonic() - started


def wanted_tests(arguments):
    """The names among a suite's arguments that choose tests: those that are neither options nor left out."""
    skipped = {at + 1 for at, argument in enumerate(arguments) if argument == "--skip"}
    return [a for at, a in enumerate(arguments) if at not in skipped and not a.startswith("-")]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--suite", action="append", default=[], help="name of a suite, or `unit`; without, all"
    )
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count(), help="suites at once; default: one a core"
    )
    parser.add_argument("arguments", nargs="*", help="what each suite is given; after `--`")
    chosen = parser.parse_args()
    suites = build(chosen.suite)
    failed, outputs = [], []
    with concurrent.futures.ThreadPoolExecutor(chosen.jobs) as pool:
        running = [pool.submit(run, suite, chosen.arguments) for suite in suites]
        for done in concurrent.futures.as_completed(running):
            name, status, output, seconds = done.result()
            results = [line for line in output.splitlines() if line.startswith("test result: ")]
            said = results[-1].removeprefix("test result: ") if results else f"status {status}, no result"
            print(f"{seconds:6.1f} s  {name}: {said}", flush=True)
            if status != 0:
                failed.append(name)
                print(output, flush=True)
            outputs.append(output)
    if failed:
        sys.exit(f"{len(failed)} of {len(suites)} suites failed: {', '.join(sorted(failed))}")
    for name in wanted_tests(chosen.arguments):
        if not any(re.search(rf"^test \S*{re.escape(name)}", output, re.MULTILINE) for output in outputs):
            sys.exit(f"no test's name has `{name}` in it, expected one at least")


if __name__ == "__main__":
    main()
