#!/usr/bin/env python3
"""same_instructions.py A.spv CONSTANTS B.spv CONSTANTS: whether two permutations have the same instructions.

For kernels that were cut into files in another way, where tools/same_kernels.sh must find other bytes. CONSTANTS are
specialisation constants as "ID:VALUE ID:VALUE" (true, false or a number); both modules are frozen with them and
optimised. Needs spirv-opt and spirv-dis, of the package spirv-tools.

Ids are replaced by what they stand for (types, constants, bindings). Control flow and what only moves values about
are left out: drivers rebuild them. What remains are all loads, stores, atomics, barriers and arithmetic, each with
its type, its constants and whether it is precise. Prints each that only one module has; exit status 1 if there is
any.
"""

import collections
import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

TARGET = "--target-env=vulkan1.2"

ID = re.compile(r"%\d+")
LEFT_OUT = re.compile(
    r"Op(Phi|Label|Branch|BranchConditional|SelectionMerge|LoopMerge|Switch|CompositeExtract|Undef|Unreachable"
    r"|Function|FunctionEnd|Return)\b"
    # Conditions of branches and vectors in parts: the optimiser folds some of them and leaves others.
    r"|OpLogical|OpSelect \(OpTypeBool|OpSelect .*OpUndef|OpVectorShuffle .*OpUndef"
)


def frozen(path, constants, folder):
    """The module with its specialisation constants at these values, optimised."""
    fixed, optimised = folder / "fixed.spv", folder / "optimised.spv"
    values = [f"--set-spec-const-default-value={constants}"] if constants else []
    freeze = ["--freeze-spec-const", "--fold-spec-const-op-composite"]
    subprocess.run(["spirv-opt", TARGET, *values, *freeze, path, "-o", fixed], check=True)
    subprocess.run(["spirv-opt", TARGET, "-O", fixed, "-o", optimised], check=True)
    return optimised


def instructions(path):
    """Counts the instructions of a module."""
    command = ["spirv-dis", "--raw-id", "--no-color", "--no-header", path]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    decorations = collections.defaultdict(list)
    meaning = {}
    counts = collections.Counter()
    in_function = False
    for line in map(str.strip, text.splitlines()):
        decoration = re.fullmatch(r"Op(Member)?Decorate (%\d+) (.*)", line)
        if decoration:
            decorations[decoration[2]].append((decoration[1] or "") + decoration[3])
            continue
        in_function = in_function or " OpFunction " in line
        name, _, body = line.rpartition(" = ") if re.match(r"%\d+ = ", line) else ("", "", line)
        own = sorted(d for d in decorations[name] if not re.search("NonWritable|NonReadable|Restrict", d))
        if in_function:
            if not LEFT_OUT.match(re.sub(ID, lambda i: meaning.get(i[0], "%"), body)):
                precise = " precise" if "NoContraction" in own else ""
                counts[re.sub(ID, lambda i: meaning.get(i[0], "%"), body) + precise] += 1
        elif name:
            slot = [d for d in own if d.startswith(("Binding", "BuiltIn"))]
            said = "(" + re.sub(ID, lambda i: meaning.get(i[0], "%"), body) + " " + " ".join(own) + ")"
            if body.startswith("OpVariable") and slot:
                said = f"<{slot[0]}>"
            if len(said) > 80:
                said = said[:20] + hashlib.sha256(said.encode()).hexdigest()[:12] + ")"
            meaning[name] = said
    return counts


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as folder:
        pairs = (sys.argv[1:3], sys.argv[3:5])
        before, after = (instructions(frozen(*pair, Path(folder))) for pair in pairs)
    for sign, only in (("-", before - after), ("+", after - before)):
        for instruction, count in sorted(only.items()):
            print(f"  {sign}{count} {instruction}")
    print(f"  {before.total()} instructions before, {after.total()} after")
    sys.exit(0 if before == after else 1)


if __name__ == "__main__":
    main()
