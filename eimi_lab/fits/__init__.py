"""From stored datasets to identified materials.

evidence           a dataset's states, edges or points, and loads, as the mechanics takes them
states_used        which states those are, and which were left out for which flags
lens               whether the edges look as if seen in perspective
named_causes       what is wrong with a dataset that no material could explain
options            what a fit may be asked for: an option is one field
fitting            one fit to any number of datasets
grid               many of them: laws, datasets, seeds, bootstrap replicates
checkpoint         the log of all generations, from which a killed run goes on
law_record         what every fit says of its law
bootstrap_record   a fit repeated on replicates of its data
residuals          distances by state, edge and arc length
records            what stands in a result file
fits_file          fits.json: its laws compared, written and read
fit_summary        a fit and the comparison of laws in lines to print
assumptions        what a fit assumes of a dataset beside its law: what was freed
prediction         any fit simulated on any dataset, seen or not; predicted_error, the interval of its error
validation         what that comes to, and validation.json; validation_tables prints it
tensile            tensile tests from files; tensile_fits, the laws fitted to them
cards              fits as material cards of other programs
plotting           a law and the errors of a validation as pictures for a notebook

Nothing here reads the truth that a virtual rig stores; only `eimi_lab.demonstration` and the report do, to score.
"""
