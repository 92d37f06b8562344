"""From stored datasets to identified materials.

experiments        a dataset's states, edges or points, and loads, as the mechanics takes them
auxiliary          what a fit takes beside datasets: freed nuisances, a free bulk modulus, tensile curves
fitting            one identification over any number of datasets
grid               many of them: laws, datasets, seeds, bootstrap replicates
workers            who does these: this process, others, a dask cluster; benchmark measures a second one
checkpoint         the log of all generations, from which a killed run goes on
records            what stands in a result file
fits               fits.json: made, written, read; its laws compared
fit_summary        a fit in lines to print; fit_tables in tables for a notebook
assumptions        what a fit assumes of a dataset beside its law: what was freed
validation         the error of any fit on any dataset, seen or not; validation_tables prints it
tensile            tensile tests and the laws fitted to them
cards              fits as material cards of other programs

Nothing here reads the truth that a virtual rig stores; only `eimi_lab.demonstration` does, to score.
"""
