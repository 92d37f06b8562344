"""Benchmarks: scripts that measure errors, times and faults of the program, and modules that these scripts share.

Run a script with `python -m benchmarks.NAME` in the top folder. `python -m benchmarks` runs the scripts whose results
are in docs/benchmarks.md. In this list, a beam, law or material is hidden if it is simulated with known parameters that
the fit does not know. A planar model has two dimensions, and a solid model has three dimensions.

speed               the time of one simulated curve of tip positions, and how this time grows
peer, felupe_beam   the same curve in FElupe, another program for finite elements
felupe_strip        a beam that is bent and tapered without load, in FElupe
solid               the solid model: orders of convergence, difference from the planar model, time
solid_mesh          the error of the modulus due to the mesh of the solid model
hidden_solids       fits of hidden solids in plane strain, in plane stress and as solids, and the predicted bias
imperfect_rigs      the error of the modulus due to one property of a bench that differs from the files
ranked_causes       the rank of the true cause of the residuals in many fits of imperfect benches, as a table
rendered_rigs       pictures of imperfect benches, and the edges found in these pictures
rate_of_doubts      how often a fit of a bench whose files are right has a doubt
usual_imperfections  the share of 95 % intervals that contain the truth if each input has its usual uncertainty
mesh_convergence    the error of the tip's position for several meshes
edges               the error of the edges that are found in rendered frames
real_pictures       edges found in other people's photographs, compared with traced edges
perturbed_pictures  the same in photographs that were scaled, brightened, blurred or compressed
photographs         the error of the edges in rendered photographs of coloured beams
published_strips    fits of two bodies of one silicone that other authors filmed
phone               fits of rendered photographs as a phone takes them: a beam with weights
flick               fits of rendered videos as a phone records them: a strip that a finger flicks
lab_photographs     rendered photographs, each with one difficulty of a laboratory
flag_pictures       a picture for every flag, a warning about the edges of a state
report_pictures     a report in a browser, wide and narrow, and on paper
report_cost         time and memory of a report of three datasets
fit_cost            time and memory of `eimi fit`
page_delays         delays of the live page, the page in the browser that shows a running measurement
picture_overlays    pictures of edges for the documentation
seeds               the error of the modulus, for every law and five seeds of noise and search
coverage            the share of 95 % intervals that contain the true value
time_coverage       the share of 95 % intervals of viscoelastic laws that contain the hidden values
time_tables         the tables of a viscoelastic fit, shared between the simulated measurements of time_coverage
plan                widths of the modulus intervals from planned and from equally spaced fields
time                frequencies, loss factors and Prony series, compared with references and hidden materials
discover            how often `eimi discover` names the terms of hidden laws
second_worker       the time that a second worker process saves
storage             frames stored per second
recording           frames of a fast camera that are recorded and lost
first_frame         the time from the start of the program to the first frame
settling            the time that the check for a motionless beam takes for each frame
kill_campaign       kill measurements at random moments, and check the coil and the stored states
off_campaign        cause every fault that can keep a coil on, at full current, and time the switching off
off_faults          each fault that off_campaign causes, and how a run must react to it
spoilt_bench        a measurement at full current on an emulated supply in another process
spoilt_run          `eimi` with a camera in which another program can cause faults
camera_faults       an emulated GigE camera that loses packets, vanishes or is replaced
emulated_supply     an emulated supply in a separate process
fuzz_files          read mutated HDF5 and TOML files, and count tracebacks and hangs
mutants             put small mistakes into a copy of the code, and check whether the tests detect them
generated_mistakes  mistakes that a generator makes in randomly drawn lines
tests_by_line       the tests that execute each line of the code
installation        the size of an installation on the disk
numbers             compare the results of whole cases before and after a change of the code
timing              measure the duration of a function

Code that the benchmarks share with the tests is in `tests/shared`.

All results were measured with one thread, because more threads do not make matrices of this size faster.
"""

import os

# These variables must be set before a script imports numpy.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_variable] = "1"
