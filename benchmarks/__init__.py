"""Measuring scripts: each prints figures that the documentation states. `python -m benchmarks.NAME` in the top folder;
`python -m benchmarks` runs those of docs/benchmarks.md.

speed               what one simulated curve costs, and how cost grows
peer, felupe_beam   the same curve in FElupe
solid               the solid model: orders of convergence, what the plane leaves out, cost
solid_mesh          what the mesh of the solid leaves in the modulus
hidden_solids       fits of hidden solids under every section, and the bias foretold
mesh_convergence    error of the tip against the mesh
edges               error of the edges on rendered frames
real_pictures       edges of other people's photographs against traced ones
photographs         error of the edges in rendered photographs of coloured beams
lab_photographs     photographs with one difficulty of a bench each
flag_pictures       a picture for every flag
report_pictures     a report in a browser, wide and narrow, and on paper
report_cost         time and memory of a report of three datasets
fit_cost            time and memory of `eimi fit`
page_delays         delays of the live page
picture_overlays    pictures of edges for the documentation
seeds               error of the modulus by law and seed
coverage            how many 95 % intervals hold the truth
plan                what a planned choice of states is worth, and whether it comes out as foretold
discover            terms of hidden laws found, left open, and wrong
second_worker       what a second worker brings to many fits
storage             frames stored a second
first_frame         from the start of the program to the first frame
kill_campaign       runs killed at random moments: the coil off, states kept
off_campaign        every fault that can keep a coil on, at full current
spoilt_bench        a run at full current on an emulated supply in another process
spoilt_run          `eimi` with a camera that can be disturbed from outside
emulated_supply     an emulated supply in a process of its own
fuzz_files          mutated HDF5 and TOML files: no traceback, no hang
mutants             small mistakes in a copy of the code, and which of them the tests notice
numbers             results of whole cases before and after a change
timing              seconds, as the others take them

What they share with tests is in `tests/shared`.

All figures are of one thread: more do not help matrices this small.
"""

import os

# In time here, before any of the scripts has loaded numpy.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_variable] = "1"
