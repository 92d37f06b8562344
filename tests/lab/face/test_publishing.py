"""An archive of datasets and results is complete, has the right hashes, and is readable by an independent library."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

import eimi_lab as eimi
from eimi_lab.fits.fits_file import Fits
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.publishing.archive import check

PEOPLE = """
[[person]]
given_name = "Josiah"
family_name = "Carberry"
orcid = "0000-0002-1825-0097"
affiliation = "Brown University"

[[person]]
given_name = "Änne"
family_name = "Müller"
"""


@pytest.fixture(scope="module")
def results(bench: Path, fitted: FitRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A folder with a dataset, its fit, a material card whose file name has an umlaut, and a hidden file.
    folder = tmp_path_factory.mktemp("published") / "run 1"
    folder.mkdir()
    shutil.copy(bench / "run.h5", folder)
    Fits.of([fitted]).write(folder / "fits.json")
    (folder / "härte.inp").write_text("*HYPERELASTIC, NEO HOOKE\n")
    (folder / ".hidden").write_text("")
    (folder.parent / "people.toml").write_text(PEOPLE, encoding="utf-8")
    return folder


def graph(archive: Path) -> dict[str, Any]:
    with zipfile.ZipFile(archive) as opened:
        content = json.loads(opened.read(f"{archive.stem}/ro-crate-metadata.json"))
    return {node["@id"]: node for node in content["@graph"]}


def test_every_file_is_in_the_archive_with_its_hash(results: Path, tmp_path: Path) -> None:
    published = eimi.publish(results, tmp_path / "study.eln", people=results.parent / "people.toml", licence="CC0-1.0")
    assert published.path == tmp_path / "study.eln"
    assert published.remarks == ()
    described = {node["name"]: node for node in graph(tmp_path / "study.eln").values() if node["@type"] == "File"}
    texts = {f"run_{name}.toml" for name in ("specimen", "calibration", "protocol", "rig")}
    assert described.keys() == {"run.h5", "fits.json", "härte.inp"} | texts
    with zipfile.ZipFile(tmp_path / "study.eln") as opened:
        for name, node in described.items():
            content = opened.read(f"study/run 1/{name}")
            assert node["sha256"] == hashlib.sha256(content).hexdigest()
            assert node["contentSize"] == str(len(content))
        assert opened.read("study/run 1/run.h5") == (results / "run.h5").read_bytes()
        packing = {info.filename.rpartition("/")[2]: info.compress_type for info in opened.infolist()}
        assert packing["run.h5"] == zipfile.ZIP_STORED  # its frames are compressed already
        assert packing["härte.inp"] == packing["fits.json"] == zipfile.ZIP_DEFLATED
    assert check(tmp_path / "study.eln") == len(described)


def test_the_description_states_authors_licence_modulus_and_origin(results: Path, tmp_path: Path) -> None:
    eimi.publish(
        results, tmp_path / "s.eln", title="Two beams", people=results.parent / "people.toml", licence="CC-BY-4.0"
    )
    nodes = graph(tmp_path / "s.eln")
    root = nodes["./"]
    assert root["name"] == "Two beams"
    for at in (root["datePublished"], nodes["ro-crate-metadata.json"]["dateCreated"]):
        assert abs(datetime.fromisoformat(at) - datetime.now(UTC)) < timedelta(hours=24)
    assert root["license"] == {"@id": "https://spdx.org/licenses/CC-BY-4.0"}
    assert [nodes[author["@id"]]["name"] for author in root["author"]] == ["Josiah Carberry", "Änne Müller"]
    fit = eimi.open_fits(results / "fits.json")[0]
    (modulus,) = nodes["./run%201/fits.json"]["variableMeasured"]
    stated = nodes[modulus["@id"]]
    low, high = fit.initial_shear_modulus.interval_95
    assert (stated["value"], stated["minValue"], stated["maxValue"]) == (fit.initial_shear_modulus.value, low, high)
    (action,) = [node for node in nodes.values() if node["@type"] == "CreateAction"]
    assert action["object"] == [{"@id": "./run%201/run.h5"}]
    assert f"numpy {fit.versions['numpy']}" in action["description"]


def test_an_independent_library_reads_the_archive(results: Path, tmp_path: Path) -> None:
    rocrate = pytest.importorskip("rocrate.rocrate", reason="needs `pip install rocrate`")
    eimi.publish(results, tmp_path / "study.eln", people=results.parent / "people.toml", licence="CC-BY-4.0")
    with zipfile.ZipFile(tmp_path / "study.eln") as opened:
        opened.extractall(tmp_path / "unpacked")
    crate = rocrate.ROCrate(tmp_path / "unpacked" / "study")
    assert {entity.type for entity in crate.data_entities} == {"File", "Dataset"}
    assert crate.get("run%201/run.h5")["sha256"] == hashlib.sha256((results / "run.h5").read_bytes()).hexdigest()
    assert [author["name"] for author in crate.root_dataset["author"]] == ["Josiah Carberry", "Änne Müller"]


def test_a_changed_file_is_noticed(results: Path, tmp_path: Path) -> None:
    eimi.publish(results, tmp_path / "study.eln")
    with zipfile.ZipFile(tmp_path / "study.eln") as opened, zipfile.ZipFile(tmp_path / "other.eln", "w") as changed:
        for name in opened.namelist():
            content = opened.read(name)
            changed.writestr(name, content.replace(b"NEO", b"new") if name.endswith(".inp") else content)
    with pytest.raises(OSError, match=r"härte\.inp changed"):
        check(tmp_path / "other.eln")


def test_a_message_names_what_a_reader_of_the_archive_would_miss(results: Path, tmp_path: Path) -> None:
    remarks = eimi.publish([results / "fits.json"], tmp_path / "study.eln").remarks
    assert len(remarks) == 3
    assert "the archive does not contain the dataset of this fit" in remarks[0]
    assert "no authors are given" in remarks[1]
    assert "no licence is given" in remarks[2]


@pytest.mark.parametrize(
    ("runs", "options", "words"),
    [
        (("missing.h5",), {}, "there is no such file"),
        (("run.h5", "run.h5"), {}, "already"),
        (("run.h5",), {"licence": "my own"}, "SPDX identifier such as CC-BY-4.0"),
        (("run.h5",), {"people": "wrong.toml"}, "check digit"),
        (("run.h5",), {"output": "study.txt"}, "should end in .eln"),
    ],
)
def test_wrong_input_gives_one_line_and_no_archive(
    results: Path, tmp_path: Path, runs: tuple[str, ...], options: dict[str, Any], words: str
) -> None:
    (tmp_path / "wrong.toml").write_text(PEOPLE.replace("0097", "0096"), encoding="utf-8")
    chosen = {"output": "study.eln", **options}
    if "people" in chosen:
        chosen["people"] = tmp_path / chosen["people"]
    output = tmp_path / chosen.pop("output")
    with pytest.raises(InputError, match=words):
        eimi.publish([results / run for run in runs], output, **chosen)
    assert not output.exists()


def test_an_existing_archive_is_kept(results: Path, tmp_path: Path) -> None:
    (tmp_path / "study.eln").write_text("older")
    with pytest.raises(InputError, match="exists already"):
        eimi.publish(results, tmp_path / "study.eln")
    assert (tmp_path / "study.eln").read_text() == "older"
    eimi.publish(results, tmp_path / "study.eln", force=True)
    assert check(tmp_path / "study.eln")
