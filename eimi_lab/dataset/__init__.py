"""The dataset: one NeXus HDF5 file that holds a run and everything needed to understand it.

layout      where things are in the file
writing     `DatasetWriter`: appends a state at a time; what it acknowledged survives a crash
recordings  frames between the states: transients, release, conditioning
file_system whether a folder lies on a network
points      datasets of tracked material points instead of frames
reading     `open_dataset`: finished, live and crashed files alike
state       one loading, as a dataset tells it; labelled makes an xarray.Dataset of all
stored_edges what segmentation found, stored beside the frames
default_plots, plotting, upright    what viewers and notebooks draw of it, the beam as it hangs
dark_and_flat the dark frame and the flat field that correct the frames, stored beside them
restating   specimen and calibration corrected after a run; the former ones stay in the file
recovery    a crashed file made whole again; the folder repair puts flipped bits right
importing   frames or tracked points that a lab already has; csv_tables and videos read them
"""
