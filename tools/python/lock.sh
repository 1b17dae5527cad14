#!/usr/bin/env bash
# Writes the versions and hashes of every Python package that tools and tests use (*.in) into *.txt.
# Needs `uv` (PyPI).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
for name in tools tests ros wheel docs; do
    uv pip compile --quiet --universal --python-version 3.10 --generate-hashes --no-emit-index-url \
        --custom-compile-command tools/python/lock.sh "$@" "$name.in" --output-file "$name.txt"
done
