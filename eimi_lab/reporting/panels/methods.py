"""Write a methods paragraph for a paper, and the references to cite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eimi_fitting.laws import LAWS
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.citation import METHOD, SUITE, bibtex
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.findings import findings, scatter_of
from eimi_lab.reporting.panel import ReportPanel

_SECTIONS = {
    "solid": "as a solid in three dimensions",
    "plane-stress": "in plane stress",
    "plane-strain": "in plane strain",
}


def paragraph(report: ReportContents) -> str:
    """Return a methods paragraph: the measurement, the identification of the law, and the results."""
    sentences = [_measured(shown) for shown in report.datasets]
    bending = [shown.fit for shown in report.bending if isinstance(shown.fit, FitRecord)]
    if bending:
        sentences += [_identified(bending, report.datasets), _intervals(bending, scatter_of(report.datasets))]
    if report.tensile:
        windows = ", ".join(dict.fromkeys(shown.origin.removeprefix("tensile ") for shown in report.tensile))
        sentences.append(
            f"For comparison, laws were fitted by least squares to uniaxial tensile tests (window: {windows})."
        )
    for finding in findings(report):
        sentences.append(
            f"{finding.subject or 'The material'}: initial shear modulus {finding.value} "
            f"(95 % interval: {finding.interval})."
        )
    return " ".join(sentences)


def _measured(shown: DatasetContents) -> str:
    dataset, file = shown.dataset, shown.dataset.specimen
    beam, magnet = file.specimen, file.magnet
    words = f"A beam of {beam.material} ({beam.length_mm:g} × {beam.width_mm:g} × {beam.depth_mm:g} mm"
    if magnet:
        sizes = f"{magnet.length_mm:g} × {magnet.width_mm:g} × {magnet.depth_mm:g} mm"
        words += f", with a magnet of {sizes} and {magnet.remanence_T:g} T at its tip"
    fields = [abs(state.field_mT) for state in dataset.states]
    words += (
        f") was {'photographed' if dataset.kind == 'frames' else 'tracked'} at rest in {len(dataset.states)} states"
    )
    if max(fields, default=0) > 0:
        words += f" in magnetic fields up to {max(fields):.3g} mT"
    if dataset.calibration is not None:
        words += f" at {dataset.calibration.pixels_per_mm:.4g} pixels/mm"
    virtual = " The rig was virtual." if dataset.truth() is not None else ""
    return f"{words}; {shown.evidence.used.in_words()}.{virtual}"


def _identified(bending: Sequence[FitRecord], datasets: Sequence[DatasetContents]) -> str:
    laws = ", ".join(f"{name} ({LAWS[name].formula})" for name in dict.fromkeys(fit.model for fit in bending))
    sections = " and ".join(_SECTIONS[s] for s in dict.fromkeys(d.section for fit in bending for d in fit.datasets))
    seeds = ", ".join(dict.fromkeys(str(fit.seed) for fit in bending))
    has_edges = not datasets or any(shown.dataset.kind == "frames" for shown in datasets)
    located = "Edges were located to a fraction of a pixel. " if has_edges else ""
    simulated = "the outline of a finite-element simulation" if has_edges else "a finite-element simulation"
    return (
        f"{located}The parameters of a hyperelastic law were searched by CMA-ES (seed {seeds}) and refined by "
        f"Gauss-Newton, such that {simulated} ({sections}) matches the measured {'edges' if has_edges else 'points'} "
        f"(Evolutionary Inverse Material Identification, {METHOD.short}). "
        f"The software was eimi-lab {bending[0].versions['eimi-lab']}. Laws: {laws}."
    )


def _intervals(bending: Sequence[FitRecord], scatter: str) -> str:
    sources = list(dict.fromkeys(entry.words for fit in bending for entry in fit.budget))
    words = f"The 95 % intervals include the {scatter} and the error of the mesh"
    if sources:
        words += f", and these uncertainties: {', '.join(sources)}"
    exact = list(dict.fromkeys(word for fit in bending for word in fit.taken_as_exact))
    priors = list(dict.fromkeys(f"{fit.model}: {words}" for fit in bending for words in fit.priors_in_words()))
    prior_words = "".join(f" {words}" for words in priors)
    return f"{words}.{prior_words}" + (f" Taken as exact: {', '.join(exact)}." if exact else "")


def _values(report: ReportContents) -> dict[str, Any]:
    return {"paragraph": paragraph(report), "suite": SUITE, "method": METHOD, "bibtex": bibtex()}


PANEL = ReportPanel(
    place=40,
    after_datasets=True,
    title="Methods and references",
    template="""
<p>{{ paragraph }}</p>
<p class="note">References for the method and for eimi-lab:</p>
<ul><li>{{ method.text }}</li><li>{{ suite.text }}</li></ul>
<pre>{{ bibtex }}</pre>
""",
    values=_values,
)
