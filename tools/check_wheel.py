#!/usr/bin/env python3
"""Checks a wheel for release: `tools/check_wheel.py WHEEL`. Which glibc its library needs is read from the library's
symbol versions; the wheel's name must promise no older one. The licences of what it contains must be inside."""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import zipfile

NEWEST_GLIBC = "2.35"
"""Of Ubuntu 22.04."""


def key(version):
    return tuple(map(int, version.split(".")))


def glibc_of(library):
    """The newest glibc whose symbols a shared library needs."""
    told = subprocess.run(["objdump", "-T", library], check=True, capture_output=True, text=True).stdout
    versions = set(re.findall(r"\bGLIBC_([0-9.]+)\b", told))
    if not versions:
        raise ValueError(f"{library} needs no versioned symbol of glibc")
    return max(versions, key=key)


def promised_glibc(name):
    """The oldest glibc that a wheel's name admits, or None."""
    found = re.search(r"manylinux_(\d+)_(\d+)_", name)
    return found and ".".join(found.groups())


def faults(wheel, newest):
    """What is wrong with a wheel, in words; and the glibc that it needs."""
    found = []
    with zipfile.ZipFile(wheel) as archive, tempfile.TemporaryDirectory() as folder:
        names = archive.namelist()
        libraries = [name for name in names if name.endswith(".so")]
        needed = max((glibc_of(archive.extract(name, folder)) for name in libraries), key=key)
        notices = [name for name in names if name.endswith("/THIRD-PARTY-NOTICES.txt")]
        if not any(name.endswith("/LICENSE") for name in names) or len(notices) != 1:
            found.append("it has no LICENSE or no THIRD-PARTY-NOTICES.txt")
        elif b"cyclonedds/LICENSE" not in archive.read(notices[0]):
            found.append("its notices do not have the licence of Cyclone DDS")
    promised = promised_glibc(pathlib.Path(wheel).name)
    if key(needed) > key(newest):
        found.append(f"it needs glibc {needed}, expected {newest} or older")
    if promised is None:
        found.append("its name does not say which glibc it needs, expected `manylinux_2_...`")
    elif key(promised) > key(newest) or key(promised) < key(needed):
        found.append(f"its name admits glibc {promised}, expected {needed} to {newest}")
    return found, needed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel")
    parser.add_argument("--newest-glibc", default=NEWEST_GLIBC, metavar="VERSION")
    arguments = parser.parse_args()
    found, needed = faults(arguments.wheel, arguments.newest_glibc)
    if found:
        sys.exit(f"error: {arguments.wheel}: " + "; ".join(found))
    print(f"{arguments.wheel}: needs glibc {needed}, as Ubuntu 22.04 has it or older")


if __name__ == "__main__":
    main()
