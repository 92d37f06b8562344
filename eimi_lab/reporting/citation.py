"""The references that a user of eimi-lab should cite."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version


@dataclass(frozen=True)
class Citation:
    """An entry of a bibliography. Each author has the form `family name, given names`."""

    key: str
    authors: tuple[str, ...]
    title: str
    year: int
    where: str = ""
    doi: str = ""

    @property
    def short(self) -> str:
        """Return author and year of a reference, such as `Di Lecce et al. 2022`."""
        family = self.authors[0].split(",")[0]
        return f"{family}{' et al.' if len(self.authors) > 1 else ''} {self.year}"

    @property
    def text(self) -> str:
        """Return a reference as one line of a bibliography."""
        doi = f" doi:{self.doi}" if self.doi else ""
        return f"{'; '.join(self.authors)} ({self.year}). {self.title}. {self.where}.{doi}"


METHOD = Citation(
    "dilecce2022",
    ("Di Lecce, Michele", "Onaizah, Onaizah", "Lloyd, Peter", "Chandler, James H.", "Valdastri, Pietro"),
    "Evolutionary Inverse Material Identification: Bespoke Characterization of Soft Materials Using a Metaheuristic "
    "Algorithm",
    2022,
    "Frontiers in Robotics and AI 8:790571",
    "10.3389/frobt.2021.790571",
)
SUITE = Citation(
    "eimi-lab", ("The eimi-lab developers",), "eimi-lab", 2026, f"Software, version {version('eimi-lab')}, BSD-3-Clause"
)


def bibtex() -> str:
    """Return the references for the method and for eimi-lab in BibTeX."""
    journal, _, number = METHOD.where.rpartition(" ")
    volume, _, article = number.partition(":")
    return (
        f"@article{{{METHOD.key},\n  author = {{{' and '.join(METHOD.authors)}}},\n  title = {{{METHOD.title}}},\n"
        f"  journal = {{{journal}}},\n  volume = {{{volume}}},\n  pages = {{{article}}},\n  year = {{{METHOD.year}}},\n"
        f"  doi = {{{METHOD.doi}}}\n}}\n"
        f"@software{{{SUITE.key},\n  author = {{{{{SUITE.authors[0]}}}}},\n  title = {{{SUITE.title}}},\n"
        f"  version = {{{version('eimi-lab')}}},\n  year = {{{SUITE.year}}}\n}}"
    )
