"""The evaluation of Di Lecce et al. 2022 (Front. Robot. AI 8:790571) as one command, on specimens of hidden materials.

hidden_materials   what the specimens are made of: none of the laws that are fitted
extent             how much is studied: the whole, or its quick form
stored_parts       results found so far, from which a study that was ended goes on
observed           the outlines of the hidden solids, as edges with the noise of the edge finder
routes             laws by bending of type 1, and by tensile tests
errors             what each of them is off by on every specimen
open_questions     compressibility, the moment, how many states, which optimiser
claims             what the paper says beside what came out
tables, figures    of it, in the paper's form; pages puts them on one
whole_study        all of it in order

Fits see edges and tensile curves alone; what the materials are is read to make these, and to score.
"""
