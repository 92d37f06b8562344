"""The last local optimisation of a fit finds the optimum on a finer mesh than the mesh of the search."""

from __future__ import annotations

import numpy as np

from eimi_fitting import LAWS, BeamModel, EdgeObservation, Experiment, Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence._coarse import on_coarse_mesh
from eimi_fitting.inference.evidence.corrections import polished
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.searching.modulus_range import within
from eimi_fitting.laws.search_space import search_space

MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(length_mm=30.0, width_mm=3.0, depth_mm=5.0, density_kg_m3=1070.0, section="solid", magnet=MAGNET)
STIFFENING_PA = np.array([[7000.0, 12000.0, 8000.0]])


def test_a_candidate_that_is_stable_on_the_coarse_mesh_only_leads_to_the_optimum() -> None:
    loads, law = Loads.along([3.0, 8.5]), LAWS["yeoh"]
    model = SolidBeside(BEAM, 20, 2)
    edges = points_on(outline(model, model.solve(law, STIFFENING_PA, loads))[0], 2)[:, :, 4:-2]
    observed = EdgeObservation(edges, np.full(edges.shape[:3], 1e-3))
    experiment = polished(Experiment(BeamModel(BEAM, plane=BEAM.planar_section), loads, observed))
    problem = within(Problem(law, Unknowns(search_space(law)), (experiment,)), (7e3, 30e3))
    softening = np.array([0.5, 0.2, 0.2])
    coarse = Problem(law, problem.unknowns, tuple(on_coarse_mesh([experiment])))
    assert coarse.evaluate(softening[None], 1.0).objective_mm[0] < 0.1
    assert problem.evaluate(softening[None], 1.0).objective_mm[0] == DISCARDED_MM
    end = refine(problem, softening, seed=1)
    assert end.optimum.evaluation.objective_mm[0] < 0.005
    low, high = end.estimate.initial_shear_modulus.interval_95
    assert low < 2 * STIFFENING_PA[0, 0] < high
