"""The live page for the bench: what `eimi dashboard` serves to a browser on the same machine.

server        the routes, and the socket that they listen on
admission     who may ask: token, cookie, Host, Origin, and what a browser may do with the answer
data_folder   the folder that the page may see, and nothing outside it
stored_runs   a dataset as the page shows it: states, pictures, edges
run_desk      the routes by which a run is begun, paused, ended and stopped
choices       what a run may be made of, and what it would do
bench         the run's process, seen from the server
watched_run   the page, seen from the run's process
frame_memory  the newest frame, in memory that both share
eye           processes that make pictures of frames, and find the edges in them
tabs          who looks on, who steers, and what each gets
picture_desk  the routes for pictures without instruments
by_hand       their edges by a calibration that is dragged into place, and the files that come of it
fit_desk      the routes by which a dataset is fitted, and the fit's process
stored_fits   what a result file says of its fits
worker        one process beside the server for whatever takes long or may break

The server itself does next to nothing, so that it answers at once. What the browser gets is in `static`.
"""
