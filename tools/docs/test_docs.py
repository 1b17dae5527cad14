"""Tests of the checks themselves: each must see what it is there to see."""

import os
import select
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parents[1])]

import process_group
from blocks import PageError, blocks
from commands import Checker, CommandError, commands
from examples import Runner, run_page
from links import anchors, faults_of, unlisted, untold

ROOT = Path(__file__).resolve().parents[2]
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()


def page_of(text: str) -> list:
    return blocks(Path("page.md"), text)


class Blocks(unittest.TestCase):
    def test_a_block_has_its_language_its_line_and_its_text(self):
        (block,) = page_of("# Title\n\n```sh\nesaac devices\n```\n")
        self.assertEqual(
            (block.language, block.line, block.text, block.not_run), ("sh", 3, "esaac devices\n", "")
        )

    def test_a_note_holds_for_the_next_block_alone(self):
        text = "*Not run by the tests: needs a GPU.*\n\n```sh\na\n```\n\n```sh\nb\n```\n"
        self.assertEqual([block.not_run for block in page_of(text)], ["needs a GPU", ""])

    def test_what_is_not_meant_is_an_error(self):
        for text in (
            "```\nuntagged\n```\n",
            "```bash\nunknown\n```\n",
            "```sh\nnot closed\n",
            "- item\n  ```sh\n  indented\n  ```\n",
            "*Not run by the tests: no reason why\n\n```sh\na\n```\n",
            "*Not run by the tests: a paragraph between.*\n\nWords.\n\n```sh\na\n```\n",
            "*Not run by the tests: nothing after it.*\n",
        ):
            with self.assertRaises(PageError, msg=text):
                page_of(text)


class Commands(unittest.TestCase):
    def setUp(self):
        self.checker = Checker(ROOT, TARGET / "debug" / "esaac")

    def test_words_of_a_script(self):
        script = "A=1 esaac demo --out x > log 2>&1 &\ncat > f <<'END'\nesaac nonesuch\nEND\nls | head  # esaac z\n"
        names = [words[0] for words in commands(script)]
        self.assertEqual(
            [name for name in names if not name.isdigit()], ["esaac", "log", "cat", "f", "ls", "head"]
        )

    def test_what_exists_passes(self):
        self.checker.check(
            "esaac demo --frames 2 \\\n    --sensor genx320\n./tools/test.sh\n"
            "cargo test -p esaac-tests --test corpus -- --nocapture\ncargo build -p esaac-cli --features tracy\n"
        )

    def test_what_does_not_exist_is_an_error(self):
        for script in (
            "esaac demo --frame 2",
            "ls && esaac demo --no-such-flag=1",
            "esaac paint",
            "./tools/nonesuch.sh",
            "python tools/nonesuch.py",
            "cargo test -p esaac-nonesuch",
            "cargo test -p esaac-tests --test nonesuch",
            "cargo build -p esaac-cli --features nonesuch",
        ):
            with self.assertRaises(CommandError, msg=script):
                self.checker.check(script)


class Examples(unittest.TestCase):
    def faults(self, text: str, runs: bool = True) -> list[str]:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            (root / "tests/src").mkdir(parents=True)
            (root / "tests/src/lib.rs").write_text("// includes guide.md\n")
            (root / "README.md").write_text(text)
            runner = Runner(root, TARGET, Path(sys.executable))
            checker = Checker(ROOT, TARGET / "debug" / "esaac")
            return run_page(Path("README.md"), runs, runner, checker)

    def test_blocks_that_work_have_no_faults(self):
        text = "```sh\nesaac sensors > list\ncommand -v esaac cargo >> list\n```\n\n"
        text += "```python\nlines = open('list').readlines()\n```\n\n"
        text += "```python\nassert len(lines) > 5 and lines[-2].endswith('/debug/esaac\\n'), lines\n```\n"
        self.assertEqual(self.faults(text), [])

    def test_a_flag_that_no_longer_exists_is_a_fault(self):
        (fault,) = self.faults("```sh\nesaac sensors --nonesuch\n```\n")
        self.assertIn("README.md:1", fault)
        self.assertIn("--nonesuch", fault)

    def test_so_it_is_in_a_block_that_is_not_run(self):
        text = "*Not run by the tests: needs a GPU.*\n\n```sh\nesaac sensors --nonesuch\n```\n"
        self.assertIn("--nonesuch", self.faults(text)[0])
        self.assertIn("--nonesuch", self.faults(text, runs=False)[0])

    def test_every_failure_in_a_block_is_a_fault(self):
        for text, part in (
            ("```sh\nfalse\n```\n", "exit code 1"),
            ("```sh\nfalse | true\n```\n", "exit code 1"),
            ("```sh\nesaac sensors davis\n```\n", "unknown sensor"),
            ("```sh\nesaac sensors davis &\n```\n", "unknown sensor"),
            ("```sh\nesaac sensors davis &\nsleep .5\necho done\n```\n", "unknown sensor"),
            ("```python\nassert 1 == 2\n```\n", "AssertionError"),
            ("```python\nimport os; os._exit(3)\n```\n", "code 3"),
            ("```python\na b\n```\n", "invalid syntax"),
            ("```toml\na = \n```\n", "Invalid value"),
            ("```rust\nfn main() {}\n```\n", "does not include README.md"),
        ):
            faults = self.faults(text)
            self.assertEqual(len(faults), 1, text)
            self.assertIn(part, faults[0])

    def test_blocks_run_beside_the_checkout_not_in_it(self):
        before = sorted(path.name for path in ROOT.iterdir())
        self.assertEqual(self.faults("```sh\ntouch left_behind\n```\n"), [])
        self.assertEqual(sorted(path.name for path in ROOT.iterdir()), before)


class ProcessGroup(unittest.TestCase):
    def test_a_process_ends_with_all_that_it_has_started(self):
        words = ["bash", "-c", "sleep 60 & echo started; wait"]
        process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
        with process.stdout as output:
            self.assertEqual(output.readline(), "started\n")
            process_group.end(process)
            self.assertEqual(process.returncode, -signal.SIGKILL)
            # The pipe ends with the last process that can write to it.
            self.assertEqual(select.select([output], [], [], 10)[0], [output])
            self.assertEqual(output.read(), "")
        process_group.end(process)


class Links(unittest.TestCase):
    def test_links_that_lead_nowhere_are_faults(self):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder).resolve()
            (root / "a.md").write_text(
                "# A title\n\n[b](b.md#two-words) [top](#a-title) ![x](https://example.org/x)\n"
            )
            (root / "b.md").write_text("## Two `words`\n\n```text\n# [no heading](and/no/link)\n```\n")
            self.assertEqual(faults_of(root, Path("a.md")), [])
            self.assertEqual(faults_of(root, Path("b.md")), [])
            (root / "a.md").write_text(
                "[1](c.md) [2](b.md#three) [3](#nowhere) [4](../../etc) [`5`](d/e.md)\n"
            )
            self.assertEqual(len(faults_of(root, Path("a.md"))), 5)

    def test_anchors_are_those_of_headings(self):
        text = "# One\n## It's `two`, [three](x)\n## One\n```sh\n# none\n```\n"
        self.assertEqual(anchors(text), {"one", "its-two-three", "one_1"})

    def test_a_page_that_a_list_lacks_is_a_fault(self):
        navigation = "nav:\n  - Home: index.md\n  - Design:\n      - Top: ARCHITECTURE.md\n"
        navigation += "      - One: design/one.md\n      - design/experiments/two.md\n"
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder).resolve()
            (root / "docs/design").mkdir(parents=True)
            (root / "docs/design/one.md").write_text("# One\n")
            (root / "docs/index.md").write_text("[a](../ARCHITECTURE.md) [b](design/one.md#one)\n")
            (root / "ARCHITECTURE.md").write_text("[b](docs/design/one.md)\n")
            self.assertEqual(unlisted(root, navigation), [])
            (root / "docs/index.md").write_text("[b](design/one.md)\n")
            (root / "ARCHITECTURE.md").write_text("# Nothing\n")
            self.assertEqual(
                unlisted(root, navigation),
                [
                    "docs/index.md: no link to ARCHITECTURE.md, which is in docs/book/mkdocs.yml",
                    "ARCHITECTURE.md: no link to docs/design/one.md, which is in docs/book/mkdocs.yml",
                ],
            )

    def test_a_variable_that_no_document_names_is_a_fault(self):
        prefix = "ESAAC"
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder).resolve()
            text = f'var("{prefix}_ONE"); env!("{prefix}_BUILT"); starts_with("{prefix}_MAX_");\n'
            (root / "a.rs").write_text(text)
            (root / "b.sh").write_text(f'echo "${{{prefix}_TWO:-}}" ${prefix}_THREE\n')
            (root / "page.md").write_text(f"`{prefix}_ONE=N` and {prefix}_TWO_MORE\n")
            sources = [Path("a.rs"), Path("b.sh")]
            self.assertEqual(
                untold(root, sources, [Path("page.md")]),
                [
                    f"b.sh: `{prefix}_{name}` is neither in CONTRIBUTING.md nor in docs/guide"
                    for name in ("THREE", "TWO")
                ],
            )


if __name__ == "__main__":
    unittest.main()
