"""Select the terms of the strain energy of a material from datasets and tensile tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.face.given import AnyDataset, AnyPath, SectionName, closed_meanwhile, named_options, output_of, several
from eimi_lab.face.results import Discovered
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fitting import check_section


@named_options
def discover(
    datasets: AnyDataset | Sequence[AnyDataset],
    *,
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str = "full",
    term: str | Sequence[str] = (),
    most_terms: int = 3,
    lot: float = 0.02,
    section: SectionName | None = None,
    include_flagged: bool = False,
    seed: int = 1,
    output: AnyPath | None = None,
    force: bool = False,
) -> Discovered:
    """Select the terms of the strain energy of a material by cross-validation.

    Laws with different terms are fitted to a part of the data, and are compared by their errors on the other data.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of these types
        Datasets of beams of one material.
    tensile : str or Path, or a sequence of these types
        Tensile curves of the same material.
    tensile_window : float or str
        Largest strain of the tensile curves in per cent, or ``"full"`` for the whole curves.
    term : str or sequence of str
        Terms of the strain energy among which the program selects, such as ``"i1"``, ``"i2"``, ``"i1^2"``,
        ``"gent=20"``, ``"fung=0.2"`` or ``"ogden=-4"``. `eimi_fitting.laws.sum_of_terms` defines the terms.
    most_terms : int
        Largest number of terms in a law.
    lot : float
        Standard deviation of the difference between the moduli of the beam and of the tensile specimen, as a fraction
        of the modulus.
    section, include_flagged, seed
        See `eimi_lab.fit`.
    output : str or Path
        File discovery.json to write.
    force : bool
        Replace an existing file.

    Returns
    -------
    Discovered
        The result in words, and all sets of terms that agree with the data equally well.

    Raises
    ------
    InputError
        If a term or section does not exist, or if the data cannot be used.
    """
    from eimi_lab.fits.discovering import content, discovered, library_of
    from eimi_lab.fits.tensile_files import check_windows, read_curve

    library, chosen = library_of(several(term)), check_section(section)
    (percent,) = check_windows([f"{tensile_window}"], "--tensile-window")
    curve_paths = [Path(path) for path in several(tensile)]
    with closed_meanwhile(several(datasets)) as paths:
        path = output_of(output, [*paths, *curve_paths], force)
        curves = tuple(read_curve(path, percent, 1.0) for path in curve_paths)
        evidence = tuple(load_evidence(path, section=chosen, flagged=include_flagged) for path in paths)
        numbers = {"most_terms": most_terms, "lot": lot, "seed": seed}
        discovery = discovered(evidence, curves, library=library, **numbers)
    result = Discovered(discovery, content(discovery, evidence, curves, **numbers))
    if path:
        result.write(path, force)
    return result
