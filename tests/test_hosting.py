"""Files that a hosting service reads are valid, and the versions and commands in these files exist."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def read(path: str) -> Any:
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def settings() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_workflow_tests_every_python_and_every_system() -> None:
    jobs = read(".github/workflows/ci.yml")["jobs"]
    oldest = settings()["project"]["requires-python"].removeprefix(">=")
    assert jobs["tests"]["strategy"]["matrix"]["python"] == [oldest, "3.12", "3.13"]
    steps = [step for step in jobs["elsewhere"]["steps"] if "run" in step]
    assert [step["run"] for step in steps if step.get("continue-on-error")] == [
        "python -m pytest -n auto --continue-on-collection-errors"
    ]
    assert "python -m eimi_lab demo --quick" in [step["run"] for step in steps]
    assert jobs["elsewhere"]["strategy"]["matrix"]["system"] == ["windows-latest", "macos-latest"]
    for job in jobs.values():
        assert job["timeout-minutes"] <= 90
        assert all(("uses" in step) != ("run" in step) for step in job["steps"])


def test_the_workflow_and_the_hooks_check_what_the_script_checks() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    lint = [step.get("run", "") for step in read(".github/workflows/ci.yml")["jobs"]["lint"]["steps"]]
    hooks = {hook["entry"].split()[0] for hook in read(".pre-commit-config.yaml")["repos"][0]["hooks"]}
    checks = {
        line.removeprefix(".venv/bin/") for line in map(str.strip, script.splitlines()) if line.startswith(".venv/bin/")
    }
    for check in ("ruff check", "ruff format --check", "mypy", "lint-imports"):
        assert check in checks
        assert check in lint
        assert check.split()[0] in hooks


@pytest.mark.parametrize("form", [form for form in FORMS if form.name != "config.yml"], ids=lambda form: form.name)
def test_an_issue_form_has_its_labels_and_fields(form: Path) -> None:
    form_fields = yaml.safe_load(form.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= form_fields.keys()
    fields = [field for field in form_fields["body"] if field["type"] != "markdown"]
    assert len({field["id"] for field in fields}) == len(fields)
    assert all(field["attributes"]["label"] for field in fields)


def test_a_release_has_the_same_version_everywhere() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest, day = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)$", changelog, re.M)[0]
    citation = read("CITATION.cff")
    assert citation["version"] == newest == settings()["tool"]["setuptools_scm"]["fallback_version"]
    assert str(citation["date-released"]) == day


def test_zenodo_gets_the_data_of_the_citation_file() -> None:
    citation, record = read("CITATION.cff"), json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert record["title"] == citation["title"]
    assert record["license"] == citation["license"]
    assert record["keywords"] == citation["keywords"] == settings()["project"]["keywords"]
    assert [creator["name"] for creator in record["creators"]] == [author["name"] for author in citation["authors"]]
    assert " ".join(citation["abstract"].split()) in record["description"]
    assert [related["identifier"] for related in record["related_identifiers"]] == [citation["references"][0]["doi"]]
    assert not {"version", "publication_date"} & record.keys()
