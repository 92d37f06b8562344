"""The dataset: one NeXus HDF5 file that holds a run and everything needed to understand it.

layout      where things are in the file
writing     `DatasetWriter`: appends a state at a time; what it acknowledged survives a crash
file_system whether a folder lies on a network
points      datasets of tracked material points instead of frames
reading     `open_dataset`: finished, live and crashed files alike
probing     whether a file that was never closed can be read at all
edges       what segmentation found, stored beside the frames
recovery    a crashed file made whole again
importing   frames or tracked points that a lab already has; tables and images read them
"""
