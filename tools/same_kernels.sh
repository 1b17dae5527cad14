#!/usr/bin/env bash
# same_kernels.sh [REV [REV]]: builds the kernels of two revisions and compares the optimised SPIR-V byte for byte.
# The first revision is by default the last commit (HEAD), the second the working tree. Needs git, cargo and glslc.
#
# The optimiser strips names and comments, so a change of these alone leaves every file as it was. A kernel that has
# another file name than before is paired with the one that has the same bytes. Exit status: 0 if all are the same.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
before=${1:-HEAD}
after=${2:-}

work=$(mktemp -d)
clean_up() {
    for tree in "$work"/tree-*; do
        [ -d "$tree" ] && git worktree remove --force "$tree"
    done
    rm -rf "$work"
}
trap clean_up EXIT

# Builds the kernels of the source tree $1 and copies them to the folder $2.
build_kernels() {
    local target out
    target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
    # The build script compiles the kernels; cargo reports its folder, the rest of the crate is only checked.
    out=$(cd "$1" && CARGO_TARGET_DIR="$target" cargo check --quiet --locked -p esaac-engine --message-format=json |
        sed -n 's/.*"reason":"build-script-executed".*esaac-engine.*"out_dir":"\([^"]*\)".*/\1/p' | tail -n 1)
    [ -n "$out" ] || { echo "same_kernels: the build of $1 named no output folder" >&2; exit 2; }
    mkdir "$2"
    cp "$out"/*.spv "$2"
}

# The kernels of revision $1 (empty: the working tree) in the folder $work/$2.
kernels_of() {
    local tree=.
    if [ -n "$1" ]; then
        tree="$work/tree-$2"
        git worktree add --quiet --detach "$tree" "$1"
    fi
    build_kernels "$tree" "$work/$2"
}

kernels_of "$before" before
kernels_of "$after" after

different=0
for new in "$work"/after/*.spv; do
    name=$(basename "$new")
    old="$work/before/$name"
    if [ -f "$old" ] && cmp --quiet "$old" "$new"; then
        echo "same       $name"
        rm "$old"
        continue
    fi
    for old in "$work"/before/*.spv; do
        if cmp --quiet "$old" "$new"; then
            echo "same       $name (was $(basename "$old"))"
            rm "$old"
            continue 2
        fi
    done
    echo "different  $name ($(stat -c %s "$new") bytes)"
    different=1
done
for old in "$work"/before/*.spv; do
    [ -f "$old" ] || continue
    [ -f "$work/after/$(basename "$old")" ] || echo "gone       $(basename "$old")"
    different=1
done
exit "$different"
