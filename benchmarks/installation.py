"""Print the sizes on the disk of eimi-lab and of each package that eimi-lab needs, without optional extras.

    python -m benchmarks.installation

Run the script in a fresh environment into which the wheel was installed (as `.ci/package` makes it).
"""

from __future__ import annotations

import platform
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

OF_INSTRUMENTS = ("ifaddr", "pyserial", "pyvisa", "pyvisa-py", "zeroconf")
LEAST_MB = 2.5  # packages that are smaller than this size are summed in one row


def needed(name: str, packages: dict[str, Distribution]) -> None:
    """Add the package `name`, and all packages that it needs, to `packages`."""
    try:
        package = distribution(name)
    except PackageNotFoundError:
        return
    key = str(package.metadata["Name"]).lower().replace("_", "-")
    if key in packages:
        return
    packages[key] = package
    for line in package.requires or []:
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            needed(requirement.name, packages)


def size_MB(package: Distribution) -> float:
    """Return the size on the disk of a package, MB."""
    paths = [Path(str(package.locate_file(file))) for file in package.files or []]
    # A block of stat(2) has 512 bytes.
    return sum(512 * path.stat().st_blocks for path in paths if path.exists()) / 1e6


def main() -> None:
    packages: dict[str, Distribution] = {}
    needed("eimi-lab", packages)
    sizes = {name: size_MB(package) for name, package in packages.items()}
    total = sum(sizes.values())
    print(f"Python {platform.python_version()}, {platform.system()} {platform.machine()}\n")
    print("| package | MB | share, % |\n| --- | --- | --- |")
    for name, size in sorted(sizes.items(), key=lambda item: -item[1]):
        if size >= LEAST_MB:
            print(f"| {name} {packages[name].version} | {size:.0f} | {100 * size / total:.0f} |")
    small = [size for size in sizes.values() if size < LEAST_MB]
    print(f"| {len(small)} smaller packages | {sum(small):.0f} | {100 * sum(small) / total:.0f} |")
    print(f"| {len(sizes)} packages | {total:.0f} | 100 |")
    print(f"\nof these, for instruments alone: {sum(sizes.get(name, 0.0) for name in OF_INSTRUMENTS):.0f} MB")


if __name__ == "__main__":
    main()
