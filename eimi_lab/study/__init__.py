"""Repeat the evaluation of Di Lecce et al. 2022 (Front. Robot. AI 8:790571) on virtual specimens.

hidden_materials   the laws of the simulated specimens; the fits use other laws
extent             the extent of the evaluation: the full evaluation or a quick part
stored_parts       store each result, so that an interrupted study can continue
observed           simulate the edges of the specimens, with the noise of the edge finder
routes             identify laws by bending of one specimen and by tensile tests
errors_by_route    compute the errors of each law on each specimen
open_questions     compressibility, magnetic moment, number of states, choice of the optimiser
optimisers         compare CMA-ES with other optimisers
claims             compare the claims of the paper with the results
paper_tables       the tables, in the form of the paper
figures            the figures, in the form of the paper
pages              write all results on one page
whole_study        compute all parts in order
"""
