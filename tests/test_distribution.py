"""The source archive and the wheel contain every file of the packages, and the wheel works alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
FOLDERS = {
    "eimi_lab.protocols": "protocols",
    "eimi_drivers": "drivers/eimi_drivers",
    "eimi_fitting": "fitting/eimi_fitting",
}


def folder_of(package: str) -> Path:
    # Return the folder of a package, from the entries in pyproject.toml.
    parents = [name for name in FOLDERS if f"{package}.".startswith(f"{name}.")]
    if not parents:
        return ROOT / package.replace(".", "/")
    return ROOT / FOLDERS[parents[0]] / package.removeprefix(parents[0]).lstrip(".").replace(".", "/")


def test_every_file_of_a_package_is_in_the_wheel() -> None:
    assert SETTINGS["include-package-data"] is False
    packages = {folder_of(package): package for package in SETTINGS["packages"]}
    left_out = []
    for top in ("eimi_lab", "protocols", "drivers/eimi_drivers", "fitting/eimi_fitting"):
        for path in (ROOT / top).rglob("*"):
            if path.is_dir() or path.suffix == ".py" or "__pycache__" in path.parts:
                continue
            folder = next(parent for parent in path.parents if parent in packages)
            patterns = SETTINGS["package-data"]["*"] + SETTINGS["package-data"].get(packages[folder], [])
            if not any(fnmatch(path.relative_to(folder).as_posix(), pattern) for pattern in patterns):
                left_out.append(str(path.relative_to(ROOT)))
    assert left_out == []


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt" or not (ROOT / ".git").exists(), reason="needs bash and a clone")
def test_archive_and_wheel_without_a_checkout(tmp_path: Path) -> None:
    # The script `.ci/package` needs a package index.
    command = [shutil.which("bash") or "bash", str(ROOT / ".ci" / "package"), str(tmp_path / "package")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert "absent from the `packages`" not in done.stdout + done.stderr
