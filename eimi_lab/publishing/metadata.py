"""The description of an archive: ro-crate-metadata.json, a graph in JSON-LD (RO-Crate 1.1, sections 3 to 7)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote

from eimi_lab.config.people import People, Person
from eimi_lab.dataset.layout import PROGRAM, now
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError
from eimi_lab.publishing.contents import PublishedFile

NAME = "ro-crate-metadata.json"
CONTEXT = "https://w3id.org/ro/crate/1.1/context"
NO_LICENCE = "No licence is given: all rights are reserved."

_SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")  # the form of SPDX's short identifiers, such as CC-BY-4.0
_SOFTWARE = f"#{PROGRAM}"

Node = dict[str, Any]


def licence_node(licence: str | None) -> Node | None:
    """Return the JSON object that describes a licence in ro-crate-metadata.json; None without a licence.

    Raises InputError if the text is neither an SPDX identifier nor a URL.
    """
    if licence is None:
        return None
    if licence.startswith(("https://", "http://")):
        return {"@id": licence, "@type": "CreativeWork", "name": licence}
    if not _SPDX.fullmatch(licence):
        raise InputError(f"--licence {licence}: should be an SPDX identifier such as CC-BY-4.0, or a URL")
    url = f"https://spdx.org/licenses/{licence}"
    return {"@id": url, "@type": "CreativeWork", "name": licence, "identifier": licence}


def metadata(files: Sequence[PublishedFile], title: str, people: People | None, licence: str | None) -> Node:
    """Return the content of ro-crate-metadata.json.

    Parameters
    ----------
    files
        The files of the archive.
    title
        Name of the archive.
    people
        The authors; None if unknown.
    licence
        SPDX identifier or URL; None without a licence.

    Raises
    ------
    InputError
        If the licence is neither an SPDX identifier nor a URL.
    """
    written = now()
    stated = licence_node(licence)
    authors = [_person(person) for person in people.person] if people else []
    root: Node = {
        "@id": "./",
        "@type": "Dataset",
        "name": title,
        "description": _summary(files),
        "datePublished": written,
        "license": _reference(stated) if stated else NO_LICENCE,
        "hasPart": [],
    }
    if authors:
        root["author"] = [_reference(author) for author in authors]
    folders = _folders(files)
    entities = [*(_file(file) for file in files), *folders.values()]
    _nest(root, folders, files)
    descriptor = {
        "@id": NAME,
        "@type": "CreativeWork",
        "about": {"@id": "./"},
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "dateCreated": written,
        "sdPublisher": {"@id": _SOFTWARE},
        "version": "1.0",
    }
    software = {
        "@id": _SOFTWARE,
        "@type": "SoftwareApplication",
        "name": PROGRAM,
        "version": version(PROGRAM),
        "softwareVersion": version(PROGRAM),
    }
    made = [node for file in files for node in (*_modulus_nodes(file), *_action(file, files))]
    named = [node for person in people.person if (node := _affiliation(person))] if people else []
    affiliations = {node["@id"]: node for node in named}.values()
    licences = [stated] if stated else []
    graph = [descriptor, root, *entities, software, *authors, *affiliations, *licences, *made]
    return {"@context": CONTEXT, "@graph": graph}


def _reference(node: Node) -> Node:
    return {"@id": node["@id"]}


def _id(place: PurePosixPath) -> str:
    return f"./{quote(str(place))}"


def _summary(files: Sequence[PublishedFile]) -> str:
    """Return one sentence with the numbers of datasets, fits and files."""
    runs = sum(file.kind == "dataset" for file in files)
    fits = sum(len(file.fits) for file in files)
    return (
        f"Bending tests of soft beams and the laws that were identified from them: {runs} dataset(s), {fits} fit(s), "
        f"{len(files)} files."
    )


def _person(person: Person) -> Node:
    name = f"{person.given_name} {person.family_name}"
    node: Node = {
        "@id": f"https://orcid.org/{person.orcid}" if person.orcid else f"#{quote(name.replace(' ', '-'))}",
        "@type": "Person",
        "givenName": person.given_name,
        "familyName": person.family_name,
        "name": name,
    }
    if affiliation := _affiliation(person):
        node["affiliation"] = _reference(affiliation)
    if person.email:
        node["email"] = person.email
    return node


def _affiliation(person: Person) -> Node | None:
    if person.affiliation is None:
        return None
    return {
        "@id": f"#{quote(person.affiliation.replace(' ', '-'))}",
        "@type": "Organization",
        "name": person.affiliation,
    }


def _folders(files: Sequence[PublishedFile]) -> dict[PurePosixPath, Node]:
    """Return the JSON object that describes each folder of the archive, by the path of the folder."""
    parents = {parent for file in files for parent in file.place.parents if parent.parts}
    return {
        folder: {"@id": f"{_id(folder)}/", "@type": "Dataset", "name": folder.name, "hasPart": []}
        for folder in sorted(parents)
    }


def _nest(root: Node, folders: dict[PurePosixPath, Node], files: Sequence[PublishedFile]) -> None:
    """Add each file and each folder to the list `hasPart` of the folder that contains it.

    `root` describes the whole archive, and `folders` describes the folders, by path.
    """
    places = {**folders, **{file.place: {"@id": _id(file.place)} for file in files}}
    for place, node in places.items():
        folders.get(place.parent, root)["hasPart"].append(_reference(node))


def _file(file: PublishedFile) -> Node:
    node: Node = {
        "@id": _id(file.place),
        "@type": "File",
        "name": file.place.name,
        "encodingFormat": file.media_type,
        "contentSize": str(file.size_bytes),
        "sha256": file.sha256,
        "dateModified": file.changed,
    }
    if file.about:
        node["description"] = file.about
    if file.fits:
        node["variableMeasured"] = [{"@id": _modulus_id(file, number)} for number in range(len(file.fits))]
    return node


def _modulus_id(file: PublishedFile, number: int) -> str:
    return f"#{quote(str(file.place))}-fit-{number}-initial-shear-modulus"


def _modulus_nodes(file: PublishedFile) -> list[Node]:
    """Return one JSON object for each fit of a result file: the initial shear modulus with its 95 % interval."""
    return [_modulus(file, number, fit) for number, fit in enumerate(file.fits)]


def _modulus(file: PublishedFile, number: int, fit: FitRecord | TensileRecord | RingDownRecord) -> Node:
    modulus = fit.initial_shear_modulus
    node: Node = {
        "@id": _modulus_id(file, number),
        "@type": "PropertyValue",
        "name": f"initial shear modulus, {fit.model}",
        "value": modulus.value,
        "unitText": modulus.unit,
    }
    if modulus.interval_95 is not None:
        node["minValue"], node["maxValue"] = modulus.interval_95
        node["measurementTechnique"] = "The limits are the limits of the 95 % interval."
    return node


def _action(file: PublishedFile, files: Sequence[PublishedFile]) -> list[Node]:
    """Return a list with the JSON object that describes the computation of a result file; empty for any other file."""
    if not file.fits:
        return []
    hashes = {d.sha256 for fit in file.fits if isinstance(fit, FitRecord) for d in fit.datasets}
    used = [{"@id": _id(other.place)} for other in files if other.kind == "dataset" and other.sha256 in hashes]
    versions = {f"{name} {number}": None for fit in file.fits for name, number in fit.versions.items()}
    return [
        {
            "@id": f"#identification-{quote(str(file.place))}",
            "@type": "CreateAction",
            "name": "Identification of the laws",
            "description": f"Computed with {', '.join(versions)}.",
            "instrument": {"@id": _SOFTWARE},
            "object": used,
            "result": {"@id": _id(file.place)},
        }
    ]
