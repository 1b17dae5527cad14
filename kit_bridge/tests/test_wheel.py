"""The tools that make and check wheels for release."""

import pathlib
import subprocess
import sys
import zipfile

import pytest

import esaac._native

TOOLS = pathlib.Path(__file__).parents[2] / "tools"
sys.path.insert(0, str(TOOLS))

import check_wheel
import notices

TARGET = "x86_64-unknown-linux-gnu"
LIBRARY = pathlib.Path(esaac._native.__file__)


@pytest.fixture(scope="module")
def text():
    command = [sys.executable, TOOLS / "notices.py", "esaac-python"]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=TOOLS.parent).stdout


def test_the_licences_of_all_that_is_linked_are_told(text):
    for crate in ("pyo3", "ash", "cyclors", "numpy"):
        assert f"\n{crate} " in text
    assert "Apache License" in text and "Eclipse Public License" in text
    for inside in ("cyclonedds/LICENSE", "fonts/OFL.txt", "fonts/UFL.txt"):
        assert f"({inside})" in text
    # Neither what only builds the package nor what only tests it.
    for crate in ("bindgen", "proptest", "syn", "esaac-engine"):
        assert f"\n{crate} " not in text


def test_the_wheel_links_the_command_and_no_test_code():
    names = {entry["name"] for entry in notices.linked(notices.metadata(TARGET), "esaac-python")}
    assert {"esaac-engine", "esaac-cli", "esaac-model"} <= names
    assert not names & {"esaac-tests", "proptest"}, names


def crate(tmp_path, licence, **files):
    for name, words in files.items():
        (tmp_path / name).write_text(words)
    return {
        **{"name": "own", "version": "1.0.0", "authors": [], "repository": None, "license_file": None},
        **{"license": licence, "source": "registry", "manifest_path": str(tmp_path / "Cargo.toml")},
    }


@pytest.mark.parametrize(("licence", "named"), [("MIT OR GPL-3.0", True), ("MPL-2.0", False), (None, False)])
def test_a_crate_without_a_licence_text_is_told_unless_its_licence_is_a_well_known_one(
    tmp_path, licence, named
):
    _, missing = notices.notices([crate(tmp_path, licence)])
    assert (missing == []) == named
    text, missing = notices.notices([crate(tmp_path, licence, COPYING="Do as you like.")])
    assert not missing and "Do as you like." in text and "own 1.0.0 (COPYING)" in text


def wheel(folder, tag, licences=("LICENSE", "THIRD-PARTY-NOTICES.txt"), words="cyclonedds/LICENSE"):
    path = folder / f"esaac-9.9.9-cp310-abi3-{tag}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(LIBRARY, "esaac/_native.abi3.so")
        for name in licences:
            archive.writestr(f"esaac-9.9.9.dist-info/licenses/licenses/{name}", words)
    return path


def test_a_wheel_is_held_against_the_symbols_that_its_library_needs(tmp_path):
    needed = check_wheel.glibc_of(LIBRARY)
    major, minor = map(int, needed.split("."))
    newer, older = f"{major}.{minor + 1}", f"{major}.{minor - 1}"
    fits = f"manylinux_{major}_{minor}_x86_64"
    assert check_wheel.faults(wheel(tmp_path, fits), needed) == ([], needed)
    assert check_wheel.faults(wheel(tmp_path, f"manylinux_{major}_{minor + 1}_x86_64"), newer)[0] == []
    for tag, newest, fault in (
        (fits, older, f"it needs glibc {needed}, expected {older} or older"),
        (f"manylinux_{major}_{minor - 1}_x86_64", needed, f"its name admits glibc {older}"),
        (f"manylinux_{major}_{minor + 1}_x86_64", needed, f"its name admits glibc {newer}"),
        ("linux_x86_64", needed, "does not say which glibc"),
    ):
        assert any(fault in told for told in check_wheel.faults(wheel(tmp_path, tag), newest)[0]), fault
    (told,) = check_wheel.faults(wheel(tmp_path, fits, licences=("LICENSE",)), needed)[0]
    assert "no THIRD-PARTY-NOTICES" in told
    (told,) = check_wheel.faults(wheel(tmp_path, fits, words="nothing"), needed)[0]
    assert "Cyclone DDS" in told


def test_a_wrong_wheel_ends_the_script_with_an_error(tmp_path):
    command = [sys.executable, TOOLS / "check_wheel.py", wheel(tmp_path, "linux_x86_64")]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert ran.returncode == 1 and "does not say which glibc" in ran.stderr and not ran.stdout
