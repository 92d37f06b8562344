"""Benchmarks: each script prints figures that the documentation quotes.

Run a script with `python -m benchmarks.NAME` in the top folder. `python -m benchmarks` runs the scripts of
docs/benchmarks.md.

speed               the cost of one simulated curve, and how this cost grows
peer, felupe_beam   the same curve in FElupe
felupe_strip        a beam that is bent and tapered at rest in FElupe
solid               the solid model: orders of convergence, difference from the planar model, cost
solid_mesh          the error of the modulus due to the mesh of the solid
hidden_solids       fits of hidden solids under every section, and the predicted bias
imperfect_rigs      the error of the modulus due to one mistake on a bench
rendered_rigs       pictures of imperfect benches, and the edges found in these pictures
usual_imperfections  the share of 95 % intervals that contain the truth if every source has its usual uncertainty
mesh_convergence    error of the tip against the mesh
edges               error of the edges on rendered frames
real_pictures       edges found in other people's photographs, compared with traced edges
photographs         error of the edges in rendered photographs of coloured beams
phone               fits of rendered photographs of a phone, with weights
flick               fits of rendered videos of a phone: a flicked strip
lab_photographs     rendered photographs, each with one difficulty of a laboratory
flag_pictures       a picture for every flag
report_pictures     a report in a browser, wide and narrow, and on paper
report_cost         time and memory of a report of three datasets
fit_cost            time and memory of `eimi fit`
page_delays         delays of the live page
picture_overlays    pictures of edges for the documentation
seeds               error of the modulus by law and seed
coverage            the share of 95 % intervals that contain the true value
plan                interval widths of planned and of equally spaced states
time                frequencies, losses and Prony series against references and hidden materials
discover            terms of hidden laws: identified, left open, and wrong
second_worker       the gain in time by a second worker process
storage             frames stored per second
recording           frames of a fast camera recorded without loss
first_frame         the time from the start of the program to the first frame
settling            time of the settling statistic for a frame
kill_campaign       runs killed at random moments: coil and stored states afterwards
off_campaign        every fault that can keep a coil on, at full current
off_faults          the faults of off_campaign
spoilt_bench        a run at full current on an emulated supply in another process
spoilt_run          `eimi` with a camera that can be disturbed from outside
camera_faults       an emulated GigE camera that loses packets, vanishes or is replaced
emulated_supply     an emulated supply in a separate process
fuzz_files          mutated HDF5 and TOML files: no traceback, no hang
mutants             small mistakes in a copy of the code, and whether the tests detect them
generated_mistakes  mistakes that a generator makes in sampled lines
tests_by_line       the tests that execute each line
installation        the size of an installation on the disk
numbers             results of whole cases before and after a change
timing              measure the duration of a function

Code that the benchmarks share with the tests is in `tests/shared`.

All figures were measured with one thread, because more threads do not make matrices of this size faster.
"""

import os

# This has to precede the import of numpy in any script.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_variable] = "1"
