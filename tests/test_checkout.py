"""The tests run on this checkout, and not on a copy that is installed elsewhere."""

from __future__ import annotations

import importlib
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "eimi_lab": ROOT / "eimi_lab",
    "eimi_lab.protocols": ROOT / "protocols",
    "eimi_drivers": ROOT / "drivers" / "eimi_drivers",
    "eimi_fitting": ROOT / "fitting" / "eimi_fitting",
}
REMEDY = f"would be tested in place of {ROOT}; install that one: pip install -e '.[test]'"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_tests_import_the_checkout(package: str) -> None:
    folder = Path(str(importlib.import_module(package).__file__)).parent
    assert folder == PACKAGES[package], f"{folder} {REMEDY}"


@pytest.mark.parametrize("package", PACKAGES)
def test_a_command_imports_the_checkout(package: str, tmp_path: Path) -> None:
    script = f"import {package}; print({package}.__file__)"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    folder = Path(done.stdout.strip()).parent
    assert folder == PACKAGES[package], f"{folder} {REMEDY}"


def test_every_package_is_installed() -> None:
    # An editable install also contains packages that pyproject.toml lacks; a wheel does not.
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"])
    rooms = set()
    for package, folder in PACKAGES.items():
        rooms |= {".".join([package, *init.parent.relative_to(folder).parts]) for init in folder.rglob("__init__.py")}
    assert rooms == listed
