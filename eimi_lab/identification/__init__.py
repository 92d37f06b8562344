"""From stored datasets to identified materials.

experiments   a dataset's states, edges or points, and loads, as the mechanics takes them
fits          fits.json: what an identified law is, written and read in one place
fitting       the identification itself, over any number of datasets and models
tensile       tensile tests and the laws fitted to them
validation    the error of any fit on any dataset, seen or not; validation_tables prints it
assumed       what a fit assumes of a dataset beside its law: what was freed
fit_tables    a fit as a notebook shows it
cards         fits as material cards of other solvers

Nothing here reads the truth that a virtual rig stores; only `eimi_lab.demonstration` does, to score.
"""
