#!/usr/bin/env bash
# Tests the documents: links, the book, and every command of the README and the guide.
#
#   tools/docs.sh            everything; needs the debug build of `esaac`, and the wheel that tools/test.sh installs
#   tools/docs.sh --links    links and the book alone
#   tools/docs.sh --serve    shows the book at http://127.0.0.1:8000 and follows edits
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/setup.sh

target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
environment="$target/docs-python"
install_python "$environment" docs

if [ "${1:-}" = --serve ]; then
    exec "$environment/bin/mkdocs" serve --config-file docs/book/mkdocs.yml
fi

say "links"
python3 tools/docs/links.py

say "mkdocs build"
"$environment/bin/mkdocs" build --quiet --strict --config-file docs/book/mkdocs.yml --site-dir "$target/book"

if [ "${1:-}" = --links ]; then
    exit
fi

say "tests of the checks"
[ -x "$target/debug/esaac" ] || fail "no $target/debug/esaac; run: cargo build -p esaac-cli"
"$environment/bin/python" tools/docs/test_docs.py

say "commands of the documents"
python="$target/python/bin/python"
"$python" -c 'import esaac' || fail "$python has no package \`esaac\`; tools/test.sh installs it there"
"$environment/bin/python" tools/docs/examples.py --target "$target" --python "$python"
