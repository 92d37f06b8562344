"""Every command of the documentation runs in order, generated pages are up to date, and the site builds.

A comment before a block of commands gives an exception: `<!-- not run: why -->`, `<!-- refused -->` (exit status 2), or
`<!-- short: command -->` (a replacement, unless slow tests run).
"""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
ROOMS = ("drivers", "eimi_lab", "examples", "fitting")
WITH_COMMANDS = ("tutorials", "howto")
PAGES = [page for room in WITH_COMMANDS for page in sorted((DOCS / room).glob("*.md")) if "```sh" in page.read_text()]
BLOCK = re.compile(
    r"(?:<!-- (?P<note>[^>]*) -->\n)?```(?P<kind>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)```", re.S
)
FIRST = "tutorials/first_beam.md"
TRUE_PA = {"first_beam": 46390, "your_own_pictures": 46e3, "weights": 46e3, "tracked_points": 88e3}
SHORTER = {
    "dragon_skin_10_quick": "short.toml",
    "--rig virtual": "--rig coarse.toml",
    "--specimen type1": "--specimen planar.toml",
    ".h5 --model": ".h5 --section plane-stress --model",
    "'297,322 587,338 867,360'": "'148,161 293,169 433,180'",  # the film has half of the size
}


@dataclass(frozen=True)
class Block:
    # A block of commands, or of the text of a file, on a page of the documentation.
    # note : text of the comment before the block
    # title : name of the file; empty for commands

    note: str
    title: str
    text: str


def blocks(page: Path) -> list[Block]:
    # Return the blocks of commands and files on a page.
    matches = BLOCK.finditer(page.read_text(encoding="utf-8"))
    every = [(match["kind"], Block(match["note"] or "", match["title"] or "", match["text"])) for match in matches]
    return [block for kind, block in every if kind == "sh" or block.title]


def follow(page: Path, folder: Path, shortened: bool) -> None:
    # Run the commands of a page in a folder with its files.
    # shortened : whether short runs and fits replace those of the page
    for name in ("examples", "protocols", "benchmarks", "tests"):
        (folder / name).symlink_to(ROOT / name)
    if shortened:
        shorten(folder)
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    for block in blocks(page):
        if block.title:
            (folder / block.title).parent.mkdir(exist_ok=True)
            (folder / block.title).write_text(block.text, encoding="utf-8")
        elif not block.note.startswith("not run"):
            script = block.text
            if shortened:
                script = block.note.removeprefix("short: ") if block.note.startswith("short: ") else script
                for words, shorter in SHORTER.items():
                    script = script.replace(words, shorter)
            done = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", script],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                timeout=PATIENCE_S,
                check=False,
            )
            transcript = f"{page.name}:\n{script}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
            assert done.returncode == (2 if block.note == "refused" else 0), transcript


def shorten(folder: Path) -> None:
    # Write files for short runs: three load steps, a rig with a coarse mesh, and a specimen in plane stress.
    protocols = ROOT / "protocols"
    protocol = (protocols / "dragon_skin_10_quick.toml").read_text(encoding="utf-8")
    protocol = re.sub(r"start_A = .*\nstop_A = .*\nstep_A = .*\n", "values_A = [0.0, 0.8, 1.5]\n", protocol, count=1)
    specimen = (protocols / "specimens" / "type1.toml").read_text(encoding="utf-8")
    (folder / "planar.toml").write_text(specimen.replace('section = "solid"', 'section = "plane-stress"'))
    (folder / "short.toml").write_text(protocol.replace("frames_per_state = 12", "frames_per_state = 0"))
    for path in (protocols / "rigs").glob("virtual*.toml"):
        name = "coarse.toml" if path.stem == "virtual" else path.name
        text = path.read_text(encoding="utf-8")
        (folder / name).write_text(re.sub(r"^mesh = \[.*\]", "mesh = [13, 1, 1]", text, flags=re.M), encoding="utf-8")


@pytest.fixture(scope="session")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # The folder after the first tutorial in its short form.
    folder = tmp_path_factory.mktemp("first_beam")
    follow(DOCS / FIRST, folder, shortened=True)
    return folder


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_page_runs(page: Path, begun: Path, tmp_path: Path) -> None:
    assert blocks(page)
    if page == DOCS / FIRST:
        assert (begun / "report.html").is_file()
        return
    if page.parent.name == "howto":
        for made in ("run.h5", "fits.json"):
            shutil.copy(begun / made, tmp_path)
    follow(page, tmp_path, shortened=True)


@pytest.mark.parametrize("page", sorted((DOCS / "tutorials").glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_names_its_requirements_and_the_next_steps(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert page in PAGES, "its commands are not run"
    assert re.search(r"^- \*\*Time\*\*: .*(minutes|hour)", text, re.M)
    assert "- **You need**: " in text
    assert re.search(r"\n## What to do next\n\n(?:.*\]\(.*\n|.+\n)+\Z", text)


@pytest.mark.parametrize("path", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_is_committed_with_its_outputs(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]
    assert outputs
    assert not [output for output in outputs if output["output_type"] == "error"]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_runs_without_shortening(page: Path, begun: Path, tmp_path: Path) -> None:
    if page.parent.name == "howto":
        for made in ("run.h5", "fits.json"):
            shutil.copy(begun / made, tmp_path)
    follow(page, tmp_path, shortened=False)
    for name in tmp_path.glob("*.json"):
        for fit in json.loads(name.read_text(encoding="utf-8")).get("fits", ()):
            low, high = fit["initial_shear_modulus"]["interval_95"]
            true_Pa = TRUE_PA.get(page.stem)
            assert true_Pa is None or low * 0.995 < true_Pa < high * 1.005, name


@pytest.mark.parametrize("path", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    namespace: dict[str, object] = {}
    exec(compile(code, str(path), "exec"), namespace)
    if "fit" in namespace:
        assert namespace["fit"].initial_shear_modulus.value == pytest.approx(46e3, rel=0.02)  # type: ignore[attr-defined]
    assert capsys.readouterr().out


@pytest.mark.parametrize("script", ["file_formats.py", "gallery.py", "events_table.py", "faults_table.py"])
def test_a_generated_page_is_up_to_date(script: str) -> None:
    written = runpy.run_path(str(DOCS / "scripts" / script))
    again = f"python docs/scripts/{script} writes it anew"
    assert written["PAGE"].read_text(encoding="utf-8") == written["page"](), again


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    for package in ("material", "mkdocstrings"):
        pytest.importorskip(package, reason="needs pip install '.[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "-d", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "file_formats" / "index.html").is_file()


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *sorted(path for room in ROOMS for path in (ROOT / room).rglob("README.md"))],
    ids=lambda page: page.parent.name,
)
def test_links_of_the_repository_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    missing = [
        link
        for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
        if "://" not in link and not (page.parent / link).exists()
    ]
    assert missing == []
