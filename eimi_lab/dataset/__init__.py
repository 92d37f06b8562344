"""The dataset: one NeXus HDF5 file with the load steps of a run, and all data needed to understand them.

layout            groups, columns and attributes of the file
writing           `DatasetWriter`, which appends one load step after another
empty_file        the contents of a dataset of frames before its first load step
recordings        frames outside the load steps: settling, creep, free oscillations, load cycles before the run
frame_chunk       storage of a frame as one compressed chunk of HDF5
lost_name         copying of an open dataset that another program moved, deleted or replaced
storage_failure   the error for a dataset that can no longer be written
frame_stream      compression and writing of frames in threads while the camera takes further frames
recorded_frames   the frames of a free oscillation or of creep, read one at a time
steps             the set-points of a run, and the steps of the current with which free oscillations began
state             the class `State`: the loads and flags (defects) of one load step
stored_states     the loads and flags of the load steps in the file
stored_frames     the frames of the load steps in the file
points            datasets of tracked material points instead of frames
tip_force_angles  the directions of the tip forces in the file
opened_file       open an HDF5 file that is finished, in use or left open by a crash
reading           `open_dataset`, for finished files, for files in use and for crashed files
containment       refusal of files that refer to other files, or whose data would not fit into memory
rewriting         safe change of a finished file: a copy is changed, and then replaces the file
restating         correction of specimen and calibration after a run
segmentation      search for the edges of the beam in every load step
neighbouring_states  repeated search in load steps in which the beam was not found
logged_sensor     the classes `LoggedSensor` (a sensor) and `SensorLog` (the readings of a sensor)
sensor_logs       the readings of the sensors in the file
measured_heating  comparison of the measured coil temperature with a thermal model of the coil
measured_field    a straight line through the measured fields against the current, with uncertainties
measured_columns  uncertainties of measured fields, and measured temperatures, of imported load steps
stored_edges      the edges in the file
dark_and_flat     the dark frame (no light) and the flat field (no beam), which correct the frames
labelled          edges and tracked points as an xarray.Dataset
default_plots     the plots that a viewer of NeXus files shows when it opens the file
plotting          a figure of edges or tracked points
upright           rotation of points into the axes of the camera's picture
importing         conversion of existing images or an existing video into a dataset
listing           the pictures that a table of load steps lists
state_loads       the loads of each load step in a table
videos            frames and times of a video file
moving            free oscillations and creep as positions of points at measured times
tracked           import of tracked points in the formats of tracking programs
recovery          repair of crashed or damaged files
rebuilding        repair of the damaged tables of a recovered file from its other tables
repair            correction of flipped bits by HDF5's checksums
file_system       check whether a folder is on a network file system
"""
