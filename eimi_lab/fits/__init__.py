"""Identify materials from stored datasets and from tensile tests.

evidence             read from a dataset what a fit needs: beam model, loads, and measured edges or points
measured_conditions  loads and uncertainties of a dataset whose field was measured
measured_record      the measured field and temperatures of a dataset in a result file
measured_remarks     sentences on measured fields and temperatures
states_used          the states (load steps) that a fit uses and leaves out
perspective          detect in the edges that the lens is not telecentric
before_search        check a dataset for errors that no material could explain
options              the options of a fit
fitting              check the options of a fit, and explain why a fit is refused
fit_grid             fit several laws to several datasets, with several seeds and bootstrap replicates
checkpoint           log a search, so that an interrupted search can be resumed
discovering          discover the terms of the strain energy of a material
law_record           the part of a result file that all fits have in common
bootstrap_record     the part of a result file on bootstrap replicates
residuals            distances of measured edge points from simulated edges
records              the fits of a result file
tensile_record       the fit of a law to a tensile test in a result file
fits_file            compare the laws of several fits; write and read fits.json
grades               grade how well a fit is supported
fit_summary          print a fit and the comparison of laws
assumptions          the bulk modulus and the uncertain inputs that a fit assumes for a dataset
simulated_fit        simulate the edges of a dataset with a fitted law
prediction           simulate several datasets with several fitted laws, in several processes
predicted_error      the interval of the error of the simulated edges
validation           the errors of a fit on a dataset, and validation.json
validation_tables    print validations
planning             plan the states, the mounting and the specimen of the next run
planned_ring_down    the gain in accuracy from a ring-down (free vibration) in a planned run
recorded_motions     read the ring-downs and the creep of a dataset
time_records         the record of a fit to ring-downs alone
time_fits            fit a viscoelastic (Prony) law to motions
tensile_files        read tensile tests
tensile_fits         fit a law to a tensile test
export               write fits as material cards of finite-element programs
fit_figures          figures of fits, residuals and errors for a notebook
"""
