"""Scripts that measure errors, times and faults of the program, and modules that these scripts share.

Run a script in the top folder: `python -m benchmarks.NAME`. `python -m benchmarks` runs the scripts whose results are
in docs/benchmarks.md. All these results were measured with one thread.

speed               time of one simulated curve of tip positions, and of one fit
peer, felupe_beam   the same curve in FElupe, another finite element program
felupe_strip        a cantilever that is bent and tapered without load, in FElupe
solid               the three-dimensional (solid) beam model, compared with other solutions
solid_mesh          error of the modulus due to the mesh of the solid model
hidden_solids       error of the modulus if a solid beam is fitted in plane strain or plane stress
imperfect_rigs      error of the modulus if one property of a bench differs from its files
ranked_causes       how often the fits of `imperfect_rigs` find the true cause of their residuals
rendered_rigs       pictures of the benches of `imperfect_rigs`, and the edges in these pictures
rate_of_doubts      how often a fit warns although the files of the bench are right
usual_imperfections  share of 95 % intervals that contain the true modulus if all inputs have usual errors
mesh_convergence    error of the tip's position for several meshes
edges               error of the edges found in rendered pictures
real_pictures       edges found in real photographs, compared with edges that a person traced
perturbed_pictures  edges found in real photographs that were scaled, brightened, blurred or compressed
photographs         error of the edges in rendered photographs of coloured beams
published_strips    fits of two silicone bodies that other authors photographed
phone               fits of rendered phone photographs of a beam with weights
flick               fits of rendered phone videos of a strip that a finger flicks
lab_photographs     edges in rendered photographs with one difficulty each, such as glare
flag_pictures       a picture for every flag (warning about the edges)
report_pictures     pictures of a report in a browser and on paper
report_cost         time and memory of a report of three datasets
fit_cost            time and memory of `eimi fit`
page_delays         delays of the live page, which shows a running measurement in a browser
picture_overlays    pictures of edges for the documentation
seeds               error of the modulus for every material law and five seeds of the noise
coverage            share of 95 % intervals that contain the true modulus
time_coverage       share of 95 % intervals of viscoelastic quantities that contain the true values
time_tables         tables of frequencies for the fits of `time_coverage`
plan                width of the modulus interval from planned and from equally spaced magnetic fields
time                errors of computed frequencies and of fitted viscoelastic laws
discover            how often `eimi discover` names the true terms of a simulated law
second_worker       time that a second worker process saves
storage             camera frames stored per second
recording           recorded and lost frames of a fast camera
first_frame         time from the start of the program to the first frame
settling            time of the check whether a beam still moves
kill_campaign       measurements killed at random moments: the coil and the stored states
off_campaign        time to switch the coil off, for every fault that can keep a coil on
off_faults          the faults of `off_campaign`, and the required reactions
spoilt_bench        a measurement at full current with a fault
spoilt_run          `eimi` with faults of the camera and the clock
camera_faults       an emulated camera that loses packets, vanishes or is replaced
emulated_supply     an emulated power supply in a separate process
fuzz_files          reading of randomly changed files
mutants             small mistakes in a copy of the code, and whether the tests detect them
generated_mistakes  random mistakes in randomly drawn lines
tests_by_line       the tests that execute each line of the code
installation        size of an installation on the disk
numbers             results before and after a change of the code
timing              duration of a function

Code that the benchmarks share with the tests is in `tests/shared`.
"""

import os

# These variables must be set before a script imports numpy.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_variable] = "1"
