"""Compare the results of `eimi demo` and of eight simulated measurements before and after a change of the code.

    python -m benchmarks.numbers -o before.json [--quick]
    python -m benchmarks.numbers --against before.json [--rtol 1e-9] [--quick] [-o after.json]

The script prints the largest relative difference of each quantity (infinite for different texts), and the missing and
new quantities. The exit status is 1 if a difference is larger than --rtol or a quantity is missing. --quick runs only a
short `eimi demo`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eimi_lab.dataset.reading import open_dataset

RIGS = Path(__file__).parents[1] / "protocols" / "rigs"
SPECIMENS = ("type1", "type2", "type3", "type4")
HIDDEN = {
    "neo-hookean": ("mu_Pa = 46390.0", ("neo-hookean", "mooney-rivlin", "yeoh", "ogden")),
    "yeoh": ("C10_Pa = 19530.0, C20_Pa = 7410.0, C30_Pa = -3117.0", ("yeoh", "ogden")),
}
# Keys of values that describe the run of the program, not the result.
OF_THE_RUN = {"wall_s", "sha256", "path", "dataset", "versions"}

Json = Any


def eimi(folder: Path, *arguments: str | Path) -> None:
    """Run an `eimi` command in a folder; exit if it fails."""
    command = [sys.executable, "-m", "eimi_lab", *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"eimi {' '.join(map(str, arguments))}: {done.stderr}")


def demonstration(folder: Path, *more: str) -> dict[str, Json]:
    """Run `eimi demo` in a folder, and return its results as JSON values."""
    eimi(folder, "demo", "-o", "demo", *more)
    return results(folder, Path("demo") / "dataset.h5", Path("demo") / "fits.json")


def case(folder: Path, specimen: str, hidden: str) -> dict[str, Json]:
    """Simulate the measurement of a specimen of the material `hidden`, fit it, and return the results as JSON.

    `specimen` and `hidden` are names; the files are written into `folder`.
    """
    parameters, models = HIDDEN[hidden]
    for file in RIGS.glob("virtual*.toml"):
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "virtual_materials.toml").write_text(
        f'[silicone."Dragon Skin 10"]\nmodel = "{hidden}"\nparameters = {{ {parameters} }}\n', encoding="utf-8"
    )
    eimi(folder, "acquire", "dragon_skin_10", "--specimen", specimen, "--rig", folder / "virtual.toml", "-o", "run.h5")
    eimi(folder, "fit", "run.h5", *(w for model in models for w in ("--model", model)), "-o", "fits.json")
    return results(folder, Path("run.h5"), Path("fits.json"))


def results(folder: Path, dataset: Path, fits: Path) -> dict[str, Json]:
    # Return the results of a dataset as JSON values: edges, and the fit and its errors for each law.
    eimi(folder, "validate", dataset, "--fit", fits, "-o", "validation.json")
    with open_dataset(folder / dataset) as opened:
        edges = [
            {side: getattr(edge_set, side).points_mm.tolist() for side in ("left", "right")}
            for edge_set in opened.edges() or ()
        ]
    fits_file = json.loads((folder / fits).read_text(encoding="utf-8"))
    validations = json.loads((folder / "validation.json").read_text(encoding="utf-8"))["validations"]
    fits_of_file = {fit["model"]: fit for fit in fits_file.pop("fits")}
    return {
        "edges": edges,
        "fits": fits_of_file,
        **fits_file,
        "validations": dict(zip(fits_of_file, validations, strict=True)),
    }


def measure(quick: bool) -> dict[str, Json]:
    """Compute all results, or only a short `eimi demo` if `quick` is true; return them by name."""
    every: dict[str, Json] = {}
    for case_name, options in {"quick demonstration": ["--quick"], "demonstration": []}.items():
        if options or not quick:
            print(case_name, file=sys.stderr, flush=True)
            with tempfile.TemporaryDirectory() as name:
                every[case_name] = demonstration(Path(name), *options)
    for hidden, specimen in [] if quick else [(h, s) for h in HIDDEN for s in SPECIMENS]:
        print(f"{hidden}, {specimen}", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory() as name:
            every[f"{hidden}, {specimen}"] = case(Path(name), specimen, hidden)
    return every


def leaves(node: Json, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Json]]:
    """Yield pairs (path, value) for the numbers, lists of numbers and texts in a JSON structure.

    The path contains keys and indices. Values that describe the run, such as times and file paths, are left out.
    """
    if isinstance(node, dict):
        for key, value in node.items():
            if key not in OF_THE_RUN:
                yield from leaves(value, (*path, key))
    elif isinstance(node, list) and not all(isinstance(value, int | float) for value in node):
        for index, value in enumerate(node):
            yield from leaves(value, (*path, str(index)))
    else:
        yield path, node


def difference(before: Json, after: Json) -> float:
    """Return the largest difference of two numbers or lists of numbers, divided by the largest absolute number in them.

    The result is infinite for lists of different length and for different texts.
    """
    if before == after:
        return 0.0
    one, other = (value if isinstance(value, list) else [value] for value in (before, after))
    if len(one) != len(other) or not all(type(value) in (int, float) for value in (*one, *other)):
        return float("inf")
    scale = max(abs(value) for value in (*one, *other))
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) / scale


def quantity(path: tuple[str, ...]) -> str:
    """Return the name of a quantity, such as fits.seed, from its keys and indices in the JSON structure."""
    rest = path[1:]
    named = rest[:1] + rest[2:] if rest[0] in ("fits", "validations") else rest
    return ".".join(key for key in named if not key.isdigit())


def compare(before: dict[str, Json], after: dict[str, Json], rtol: float) -> bool:
    """Print the differences of two results; return whether all relative differences are at most ``rtol``."""
    first, second = dict(leaves(before)), dict(leaves(after))
    largest: dict[str, tuple[float, tuple[str, ...]]] = {}
    for path in first.keys() & second.keys():
        relative = difference(first[path], second[path])
        if relative >= largest.get(quantity(path), (-1.0, path))[0]:
            largest[quantity(path)] = relative, path
    for name, (relative, path) in sorted(largest.items(), key=lambda item: (-item[1][0], item[0])):
        where = f"  {', '.join(path)}: {first[path]} and {second[path]}"[:160] if relative > rtol else ""
        print(f"{relative:9.1e}  {name}{where}")
    for words, paths in (("gone", first.keys() - second.keys()), ("new", second.keys() - first.keys())):
        for name in sorted({quantity(path) for path in paths}):
            print(f"{words:>9}  {name}")
    return first.keys() <= second.keys() and all(relative <= rtol for relative, _ in largest.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="file to write")
    parser.add_argument("--against", type=Path, help="earlier file to compare with")
    parser.add_argument("--rtol", type=float, default=1e-9, help="largest relative difference")
    parser.add_argument("--quick", action="store_true", help="quick demonstration only")
    options = parser.parse_args()
    if options.output is None and options.against is None:
        parser.error("give -o FILE, --against FILE or both")
    before = json.loads(options.against.read_text(encoding="utf-8")) if options.against else None
    after = measure(options.quick)
    if options.output:
        options.output.write_text(json.dumps(after), encoding="utf-8")
    if before is not None:
        if options.quick:
            before = {name: before[name] for name in after}
        sys.exit(0 if compare(before, json.loads(json.dumps(after)), options.rtol) else 1)


if __name__ == "__main__":
    main()
