#!/usr/bin/env python3
"""Prints the licences of everything that cargo links into a package: `tools/notices.py esaac-python`.

A crate may hold the work of others, as `cyclors` holds Cyclone DDS and `epaint_default_fonts` holds fonts. So licence
files are looked for in all folders of a crate. It is an error if a crate has no licence file and its licence needs
more than its name.
"""

import argparse
import collections
import hashlib
import json
import pathlib
import re
import subprocess
import sys

LICENCE_FILE = re.compile(
    r"(licen[cs]e|copying|copyright|notice|unlicense|patents)([-_.].*)?$|.*[-_](licen[cs]e)(\.(txt|md))?$|(ofl|ufl)\.txt$",
    re.IGNORECASE,
)
NOT_SHIPPED = {".git", ".github", "benches", "ci", "docs", "examples", "fuzz", "target", "test", "tests"}
"""Folders whose contents do not get into a program."""

STANDARD = (
    "Apache-2.0",
    "MIT",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "Unlicense",
    "CC0-1.0",
    "BSL-1.0",
)


def metadata(target):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def linked(told, package):
    """Packages that end up in `package`: normal dependencies, without those of compilers' plug-ins."""
    packages = {entry["id"]: entry for entry in told["packages"]}
    nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
    (first,) = (
        key for key, entry in packages.items() if entry["name"] == package and entry["source"] is None
    )
    seen, left = {first}, [first]
    while left:
        for dependency in nodes[left.pop()]["deps"]:
            key = dependency["pkg"]
            normal = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            plug_in = any("proc-macro" in target["kind"] for target in packages[key]["targets"])
            if normal and not plug_in and key not in seen:
                seen.add(key)
                left.append(key)
    return sorted((packages[key] for key in seen), key=lambda entry: (entry["name"], entry["version"]))


def licence_files(folder):
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder)
        # Fonts have theirs beside them, by the font's name.
        is_one = LICENCE_FILE.fullmatch(path.name) or path.with_suffix(".ttf") in path.parent.glob("*.ttf")
        if is_one and path.is_file() and not NOT_SHIPPED & set(inside.parts[:-1]):
            if path.suffix not in (".rs", ".c", ".h", ".py", ".toml", ".rtf", ".ttf"):
                yield str(inside), path.read_text(errors="replace").strip()


def alternatives(expression):
    """Licences of which one will do, of an SPDX expression or of the older `MIT/Apache-2.0`."""
    return [part.strip(" ()") for part in re.split(r"\bOR\b|/", expression)]


def notices(packages):
    """The text, and the names of crates without one."""
    texts, holders, listed, missing = {}, collections.defaultdict(list), [], []
    for entry in packages:
        # This project's own crates have the project's licence.
        if entry["source"] is None:
            continue
        name, licence = (
            f"{entry['name']} {entry['version']}",
            entry["license"] or entry["license_file"] or "unknown",
        )
        found = list(licence_files(pathlib.Path(entry["manifest_path"]).parent))
        for inside, text in found:
            key = hashlib.sha256(" ".join(text.split()).encode()).hexdigest()
            texts.setdefault(key, text)
            holders[key].append(f"{name} ({inside})")
        authors = ", ".join(entry["authors"]) or "its authors"
        listed.append(f"{name}: {licence}; by {authors}; {entry['repository'] or 'no repository named'}")
        if not found and not set(STANDARD) & set(alternatives(licence)):
            missing.append(f"{name}: {licence}")
    listed.append("Rust's standard library: MIT OR Apache-2.0; by The Rust Project Developers")
    parts = ["This product contains software of others, under these licences.\n", *listed]
    rule = "=" * 100
    for key, text in texts.items():
        parts += ["", rule, "Licence of:", *(f"  {holder}" for holder in holders[key]), rule, "", text]
    return "\n".join(parts) + "\n", missing


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("package")
    parser.add_argument("--target", default="x86_64-unknown-linux-gnu")
    arguments = parser.parse_args()
    text, missing = notices(linked(metadata(arguments.target), arguments.package))
    if missing:
        sys.exit("error: no licence text for " + "; ".join(missing))
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
