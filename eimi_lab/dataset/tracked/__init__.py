"""Import material points that another program tracked by motion capture, image correlation or video analysis.

points_csv      the table points.csv of tracked points
tracked_states  a dataset from the file of another program and a table of load steps
formats         the programs whose files can be read, by their names on the command line
tracks          the class `Tracks`: positions of points in frames, in the unit and axes of the program
axes            conversion of tracks into mm along and across the beam
numbers_table   tables of numbers in text files, with decimal points or decimal commas
dice            files of DICe (image correlation)
ncorr           files of Ncorr (image correlation)
mudic           files of µDIC (image correlation)
dltdv           files of DLTdv (video analysis)
tracker         files of Tracker (video analysis)
deeplabcut      files of DeepLabCut (video analysis)
c3d             C3D files (motion capture)
"""
