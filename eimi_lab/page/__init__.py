"""The live page for the bench, which `eimi dashboard` serves to a browser on the same computer.

server         the routes of the page (addresses with the functions that answer), and its socket
admission      decide which requests are answered: the token, Host and Origin
redirect_file  a private file that opens the page without the token in a command line
data_folder    the folder that the page may read and write
tabs           the open tabs: one controls the run, the others watch
run_desk       the routes that begin, pause, end and stop a run
choices        the protocols, specimens and rigs that a person may choose
bench_run      start, watch and end the process of a run; part of the server
instructions   in the messages of a run, replace instructions for the terminal by instructions for the page
watched_run    send frames and events of a run to the page; part of the process of the run
frame_memory   the newest frame, in memory that server and run share
opened_eyes    start and end the processes of `eye`; part of the server
camera_desk    the routes of the live camera before a run
camera_alone   the process of the live camera
eye            a process that compresses frames, and a process that finds the edges in frames
stored_runs    a dataset as the page shows it
stored_fits    the fits of a result file as the page shows them
fit_desk       the routes that fit a dataset, and the process of the fit
phone_desk     the routes of the page "Weights and a phone": photographs of a beam with weights
by_weights     make a dataset from photographs, clicks and typed numbers
picture_desk   the routes for pictures without instruments
states_table   read and write states.csv in a folder of images
by_hand        edges in images; a person drags the marks of the calibration into place
report_links   links that open a report in a new tab
worker         a separate process for work that takes long or may crash
"""
