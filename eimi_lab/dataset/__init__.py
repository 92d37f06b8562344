"""The dataset: one NeXus HDF5 file that holds a run and everything needed to understand it.

layout            groups, columns and attributes of the file
writing           `DatasetWriter`, which appends one state after another; a stored state survives a crash
empty_file        a dataset of frames before its first state
recordings        frames between the states: transients, ring-downs and conditioning
frame_chunk       a frame as one compressed chunk of HDF5
frame_stream      frames that are compressed in threads and written while they arrive
recorded_frames   the frames of a ring-down, read one at a time
steps             the set-points of a run, and the steps of its ring-downs
state             the value `State`: the loads and flags of one state
points            datasets of tracked material points instead of frames
tip_force_angles  directions of tip forces in the file
opened_file       open an HDF5 file that is finished, in use or crashed
reading           `open_dataset`, for finished files, for files in use and for crashed files
containment       check that a file holds all its data itself and claims no absurd amounts
rewriting         safe change of a finished file by way of a copy
restating         correction of specimen and calibration after a run; the replaced files stay in the dataset
segmentation      search for the edges of every state
logged_sensor     the values `LoggedSensor` and `SensorLog`: a sensor and what it measured
sensor_logs       the logs of sensors in the file
measured_heating  the measured temperature of the coil against the model of its heat
measured_field    the line of the field against the current, with its uncertainties
measured_columns  measured fields' uncertainties and temperatures of imported states
stored_edges      the edges in the file
dark_and_flat     the dark frame and the flat field in the file, which correct the frames
labelled          edges and tracked points as an xarray.Dataset
default_plots     the plots that a viewer of NeXus files shows first
plotting          edges and tracked points as a figure for a notebook
upright           rotation from the beam frame to the orientation in which the beam is seen
importing         datasets from the images or the video of a laboratory
listing           the pictures that a table of states lists
state_loads       the loads of each state in a table of states
videos            frames and times of a video file
moving            ring-downs and creep: points with the time of each
tracked           import of tracked points in the formats of tracking programs
recovery          repair of crashed or damaged files
repair            correction of flipped bits by HDF5's checksums
file_system       check whether a folder is on a network file system
"""
