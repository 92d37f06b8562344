"""The description of an archive has its files, authors, licence and fits; a missing or wrong entry is reported."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_lab.config.people import People, Person
from eimi_lab.dataset.layout import PROGRAM
from eimi_lab.process.errors import InputError
from eimi_lab.publishing import archive, contents, metadata
from eimi_lab.publishing.contents import PublishedFile, gather, without_dataset


class Fit:
    # A fit of one or two datasets, with the attributes that an archive states.

    def __init__(self, model: str, value: float, interval: tuple[float, float] | None, *hashes: str) -> None:
        self.model, self.versions = model, {"eimi-lab": "0.2", "numpy": "2"}
        self.initial_shear_modulus = SimpleNamespace(value=value, unit="Pa", interval_95=interval)
        self.datasets = [SimpleNamespace(sha256=sha256, path=f"{sha256}.h5") for sha256 in hashes]


@pytest.fixture(autouse=True)
def _replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "FitRecord", Fit)
    monkeypatch.setattr(contents, "FitRecord", Fit)
    monkeypatch.setattr(metadata, "now", lambda: "2026-01-02")
    monkeypatch.setattr(metadata, "version", lambda name: f"version of {name}")


def published(place: str, kind: Any = "other", sha256: str = "f" * 64, **more: Any) -> PublishedFile:
    return PublishedFile(PurePosixPath(place), None, kind, 7, sha256, "2025", **{"about": "", **more})


FILES = (
    published("bench/µ run.h5", "dataset", "aa", about="A run."),
    published("bench/b/fits.json", "fits", fits=(Fit("yeoh", 5.0, (4.0, 6.0), "aa"), Fit("ogden", 7.0, None, "bb"))),
    published("notes.md"),
)
ADA = Person(
    given_name="Ada", family_name="van Dyke", orcid="0000-0002-1825-0097", affiliation="Lab A", email="a@b.org"
)
BEN = Person(given_name="Ben", family_name="Ås", affiliation="Lab A")


def graph(**changes: Any) -> dict[str, Any]:
    given = {"files": FILES, "title": "study", "people": People(person=(ADA, BEN)), "licence": "CC-BY-4.0"} | changes
    made = metadata.metadata(**given)
    assert made["@context"] == "https://w3id.org/ro/crate/1.1/context"
    return {node["@id"]: node for node in made["@graph"]}


def test_the_root_names_its_parts_authors_and_licence() -> None:
    nodes = graph()
    assert nodes["./"] == {
        "@id": "./",
        "@type": "Dataset",
        "name": "study",
        "description": "Bending tests of soft beams and the laws that were identified from them: 1 dataset(s), "
        "2 fit(s), 3 files.",
        "datePublished": "2026-01-02",
        "license": {"@id": "https://spdx.org/licenses/CC-BY-4.0"},
        "hasPart": [{"@id": "./bench/"}, {"@id": "./notes.md"}],
        "author": [{"@id": "https://orcid.org/0000-0002-1825-0097"}, {"@id": "#Ben-%C3%85s"}],
    }
    assert nodes["./bench/"]["hasPart"] == [{"@id": "./bench/b/"}, {"@id": "./bench/%C2%B5%20run.h5"}]
    assert nodes["./bench/b/"] == {
        "@id": "./bench/b/",
        "@type": "Dataset",
        "name": "b",
        "hasPart": [{"@id": "./bench/b/fits.json"}],
    }
    descriptor = nodes["ro-crate-metadata.json"]
    assert descriptor["about"] == {"@id": "./"}
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert descriptor["sdPublisher"] == {"@id": f"#{PROGRAM}"}
    assert nodes[f"#{PROGRAM}"]["softwareVersion"] == nodes[f"#{PROGRAM}"]["version"] == f"version of {PROGRAM}"


def test_a_file_has_its_size_hash_type_and_fits() -> None:
    nodes = graph()
    assert nodes["./bench/%C2%B5%20run.h5"] == {
        "@id": "./bench/%C2%B5%20run.h5",
        "@type": "File",
        "name": "µ run.h5",
        "encodingFormat": "application/x-hdf5",
        "contentSize": "7",
        "sha256": "aa",
        "dateModified": "2025",
        "description": "A run.",
    }
    first = "#bench/b/fits.json-fit-0-initial-shear-modulus"
    second = "#bench/b/fits.json-fit-1-initial-shear-modulus"
    assert nodes["./bench/b/fits.json"]["variableMeasured"] == [{"@id": first}, {"@id": second}]
    assert nodes[first] == {
        "@id": first,
        "@type": "PropertyValue",
        "name": "initial shear modulus, yeoh",
        "value": 5.0,
        "unitText": "Pa",
        "minValue": 4.0,
        "maxValue": 6.0,
        "measurementTechnique": "The limits are the limits of the 95 % interval.",
    }
    assert "minValue" not in nodes[second]
    assert not {"variableMeasured", "description"} & nodes["./notes.md"].keys()
    assert nodes["#identification-bench/b/fits.json"] == {
        "@id": "#identification-bench/b/fits.json",
        "@type": "CreateAction",
        "name": "Identification of the laws",
        "description": "Computed with eimi-lab 0.2, numpy 2.",
        "instrument": {"@id": f"#{PROGRAM}"},
        "object": [{"@id": "./bench/%C2%B5%20run.h5"}],
        "result": {"@id": "./bench/b/fits.json"},
    }
    assert sum(name.startswith("#identification") for name in nodes) == 1


def test_people_and_their_affiliation_are_described_once() -> None:
    nodes = graph()
    assert nodes["https://orcid.org/0000-0002-1825-0097"] == {
        "@id": "https://orcid.org/0000-0002-1825-0097",
        "@type": "Person",
        "givenName": "Ada",
        "familyName": "van Dyke",
        "name": "Ada van Dyke",
        "affiliation": {"@id": "#Lab-A"},
        "email": "a@b.org",
    }
    assert "email" not in nodes["#Ben-%C3%85s"]
    assert nodes["#Lab-A"] == {"@id": "#Lab-A", "@type": "Organization", "name": "Lab A"}
    alone = graph(people=People(person=(Person(given_name="A", family_name="B"),)))
    assert "affiliation" not in alone["#A-B"]
    nobody = graph(people=None, licence=None)
    assert "author" not in nobody["./"]
    assert nobody["./"]["license"] == "No licence is given: all rights are reserved."


def test_a_licence_is_an_identifier_or_an_address() -> None:
    nodes = graph()
    assert nodes["https://spdx.org/licenses/CC-BY-4.0"] == {
        "@id": "https://spdx.org/licenses/CC-BY-4.0",
        "@type": "CreativeWork",
        "name": "CC-BY-4.0",
        "identifier": "CC-BY-4.0",
    }
    for address in ("https://example.org/x", "http://example.org/x"):
        node = metadata.licence_node(address)
        assert node == {"@id": address, "@type": "CreativeWork", "name": address}
    assert metadata.licence_node(None) is None
    for wrong in ("", "CC BY", "-x", "ftp://x"):
        with pytest.raises(InputError, match=rf"^--licence {wrong}: should be an SPDX identifier"):
            metadata.licence_node(wrong)


def test_a_published_file_is_printed_without_its_fits() -> None:
    assert "about='A run.'" in repr(FILES[0])
    assert "fits=(" not in repr(FILES[1])


def test_a_fit_whose_dataset_is_missing_is_named_once() -> None:
    twice = published("more.json", "fits", fits=(Fit("a", 1.0, None, "c" * 64), Fit("b", 1.0, None, "c" * 64)))
    assert without_dataset([*FILES, twice]) == (
        "bench/b/fits.json: the archive does not contain the dataset of this fit, bb.h5 with the SHA-256 bb...",
        "more.json: the archive does not contain the dataset of this fit, "
        f"{'c' * 64}.h5 with the SHA-256 {'c' * 16}...",
    )
    assert without_dataset(FILES[:1]) == ()


@pytest.mark.parametrize(
    ("name", "media_type"),
    [
        ("a.H5", "application/x-hdf5"),
        ("a.toml", "application/toml"),
        ("a.png", "image/png"),
        ("a", "application/octet-stream"),
    ],
)
def test_the_type_of_a_file_follows_from_its_ending(name: str, media_type: str) -> None:
    assert published(name).media_type == media_type


# Gathering


def test_visible_files_are_gathered_below_the_name_of_their_folder(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    (folder / "b" / ".hidden").mkdir(parents=True)
    for name in ("b/x.txt", "a.txt", ".h", "b/.hidden/y"):
        (folder / name).write_bytes(name.encode())
    os.utime(folder / "a.txt", (1e9, 1e9))
    (tmp_path / "link").symlink_to(folder)
    alone = tmp_path / "alone.txt"
    alone.write_bytes(b"12345")
    files = gather([tmp_path / "link", alone])
    assert [str(file.place) for file in files] == ["runs/a.txt", "runs/b/x.txt", "alone.txt"]
    assert [file.kind for file in files] == ["other"] * 3
    assert files[0].changed == "2001-09-09T01:46:40+00:00"
    assert (files[2].size_bytes, files[2].sha256, files[2].source) == (5, hashlib.sha256(b"12345").hexdigest(), alone)
    with pytest.raises(InputError, match=r"alone\.txt: the archive has a file alone\.txt already; rename one"):
        gather([alone, alone])
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / ".h").touch()
    with pytest.raises(InputError, match=r"empty: the folder has no files$"):
        gather([tmp_path / "empty"])
    with pytest.raises(InputError, match=r"nothing: there is no such file or folder$"):
        gather([tmp_path / "nothing"])


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*given: object) -> None:
        raise OSError(5, "Input/output error")

    path = tmp_path / "notes.txt"
    path.write_text("notes")
    monkeypatch.setattr(contents.hashlib, "file_digest", fail)
    with pytest.raises(InputError, match=r"notes\.txt: cannot be read \(Input/output error\)$"):
        list(contents._described(path, PurePosixPath("notes.txt")))


def test_a_file_of_results_is_described_by_its_models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "fits.JSON"
    source.write_text("{}")
    monkeypatch.setattr(contents, "read_fits_file", lambda path: [Fit(m, 1.0, None) for m in ("yeoh", "ogden", "yeoh")])
    (file,) = gather([source])
    assert (file.kind, file.about, len(file.fits)) == ("fits", "Identified laws: yeoh, ogden.", 3)
    (other,) = gather([source.rename(tmp_path / "fits.txt")])
    assert (other.kind, other.about, other.fits) == ("other", "", ())

    def wrong(path: Path) -> None:
        raise InputError("no result")

    monkeypatch.setattr(contents, "read_fits_file", wrong)
    (other,) = gather([(tmp_path / "fits.txt").rename(tmp_path / "x.json")])
    assert other.kind == "other"


@pytest.mark.parametrize(("kind", "words"), [("frames", "frames"), ("points", "tracked points")])
def test_a_dataset_is_described_with_its_texts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, words: str
) -> None:
    class Dataset:
        finished, states = True, (1, 2, 3)
        specimen = SimpleNamespace(specimen=SimpleNamespace(name="type1", material="Ecoflex"))

        def __enter__(self) -> Dataset:
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def start_time(self) -> Any:
            return SimpleNamespace(isoformat=lambda timespec: f"2026 in {timespec}")

        def text(self, name: str) -> str | None:
            return {"specimen": "µ", "rig": "r"}.get(name)

    Dataset.kind = kind  # type: ignore[attr-defined]
    monkeypatch.setattr(contents, "is_dataset", lambda path: True)
    monkeypatch.setattr(contents, "open_dataset", lambda path: Dataset())
    source = tmp_path / "run.h5"
    source.write_bytes(b"123")
    files = gather([source])
    assert [(str(file.place), file.kind) for file in files] == [
        ("run.h5", "dataset"),
        ("run_specimen.toml", "text of a dataset"),
        ("run_rig.toml", "text of a dataset"),
    ]
    assert files[0].about == f"The beam type1 of Ecoflex in 3 states: {words}, as NeXus in HDF5."
    assert (files[0].size_bytes, files[0].source) == (3, source)
    assert {file.changed for file in files} == {"2026 in seconds"}
    assert (files[1].size_bytes, files[1].text, files[1].source) == (2, b"\xc2\xb5", None)
    assert files[1].sha256 == hashlib.sha256(b"\xc2\xb5").hexdigest()
    assert files[1].about == "specimen.toml of the run, as run.h5 contains it."
    Dataset.finished = False
    with pytest.raises(InputError, match=r"run\.h5: is still being written, or its run crashed"):
        gather([source])


# Writing and checking


@pytest.fixture
def made(tmp_path: Path) -> Path:
    (tmp_path / "a.txt").write_bytes(b"content " * 1000)
    (tmp_path / "b.png").write_bytes(b"content " * 1000)
    output = tmp_path / "study.eln"
    done = archive.publish([tmp_path / "a.txt", tmp_path / "b.png"], output)
    assert done.path == output
    assert [str(file.place) for file in done.files] == ["a.txt", "b.png"]
    assert done.remarks == (
        "no authors are given; --people people.toml gives a file with their names",
        "no licence is given, so that nobody may use the data; --licence CC-BY-4.0 gives a licence",
    )
    return output


def test_files_that_are_compressed_already_are_stored(made: Path) -> None:
    with zipfile.ZipFile(made) as opened:
        kinds = {info.filename: info.compress_type for info in opened.infolist()}
        nodes = json.loads(opened.read("study/ro-crate-metadata.json"))["@graph"]
    assert kinds["study/a.txt"] == zipfile.ZIP_DEFLATED
    assert kinds["study/b.png"] == zipfile.ZIP_STORED
    assert next(node["name"] for node in nodes if node["@id"] == "./") == "study"
    assert archive.check(made) == 2


def test_authors_licence_and_title_leave_no_remark(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"x")
    done = archive.publish(
        [tmp_path / "a.txt"], tmp_path / "study.ZIP", title="T", people=People(person=(ADA,)), licence="MIT"
    )
    assert done.remarks == ()
    with zipfile.ZipFile(done.path) as opened:
        nodes = json.loads(opened.read("study/ro-crate-metadata.json"))["@graph"]
    assert next(node["name"] for node in nodes if node["@id"] == "./") == "T"


def test_the_archive_itself_is_not_published(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"x")
    with pytest.raises(InputError, match=r"a\.zip: cannot be written, because the same command already reads"):
        archive.publish([tmp_path / "a.zip"], tmp_path / "a.zip", force=True)
    with pytest.raises(InputError, match=r"a\.zip: exists already"):
        archive.publish([tmp_path / "a.zip"], tmp_path / "a.zip")
    with pytest.raises(InputError, match=r"a\.tar: the name of an archive should end in \.eln or \.zip"):
        archive.publish([tmp_path / "a.zip"], tmp_path / "a.tar")


def rewritten(path: Path, change: Callable[[dict[str, bytes]], None]) -> None:
    with zipfile.ZipFile(path) as opened:
        parts = {name: opened.read(name) for name in opened.namelist()}
    change(parts)
    with zipfile.ZipFile(path, "w") as opened:
        for name, content in parts.items():
            opened.writestr(name, content)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda parts: parts.update({"study/a.txt": b"other"}), "a.txt changed while the archive was written"),
        (lambda parts: parts.update({"study/a.txt": b"Content " * 1000}), "a.txt changed while"),
        (lambda parts: parts.pop("study/b.png"), "b.png is in the archive but not in its description, or the reverse"),
        (lambda parts: parts.update({"study/c": b""}), "c is in the archive but not in its description"),
        (
            lambda parts: parts.update(
                {"study/ro-crate-metadata.json": parts["study/ro-crate-metadata.json"].replace(b'"8000"', b'"8001"')}
            ),
            "a.txt changed while",
        ),
    ],
)
def test_a_file_that_differs_from_its_description_is_noticed(
    made: Path, change: Callable[[dict[str, bytes]], None], words: str
) -> None:
    rewritten(made, change)
    with pytest.raises(OSError, match=rf"study\.eln: {words}"):
        archive.check(made)
