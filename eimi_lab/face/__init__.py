"""What `import eimi_lab as eimi` offers: a plain function for each command, which takes and returns Python objects.

given        what a caller gives: paths, names of shipped files, objects that are open or loaded already
acquiring    open, open_fits, acquire
segmenting   import_pictures, import_points, segment
identifying  fit, tensile, discover
using        simulate, validate, plan, report, export
results      what several of them return: tables that show themselves

Options have the names and the meaning that the command line gives them. A function that needs no file writes none
unless it is given an `output`.
"""
