"""From camera frames to the beam's two edges in millimetres.

`edges` finds them, `following` where there is no back-light, and `calibration` measures the map between pixels and
millimetres. They stand on what is here: `image_files` reads pictures, `image_sizes` asks how large one says that it is
and `image_wholeness` whether it is all there, `intensity` makes one image of a state's frames, `projection` one grey
value of colours, `beam_frame` holds that map. `flags` is the table of all that may be wrong with a state,
`frame_checks` asks a state's frames for lost and repeated ones, and `settling_statistic` whether the beam was at rest.
docs/why/edges.md holds the measured figures; `benchmarks/edges.py` prints them and `benchmarks/flag_pictures.py`
renders a picture for every flag.
"""
