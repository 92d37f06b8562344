"""Datasets of material points that were tracked elsewhere: motion capture, image correlation, video analysis.

`points_csv` reads this suite's own table. Of another tool's file (`dice`, `ncorr`, `mudic`, `dltdv`, `tracker`,
`deeplabcut`, `c3d`; `formats` lists them) the points become `tracks.Tracks` in that tool's own unit and axes;
`placing` puts them into the beam frame by what a person says of both, and `importing` makes the dataset.
"""
