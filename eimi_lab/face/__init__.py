"""The Python interface `import eimi_lab as eimi`: one function for each command, with Python objects as arguments.

given          types and conversion of arguments: paths, names of shipped files, or loaded objects
acquiring      open, acquire
segmenting     import_pictures, import_points, segment
moving         import_motion
identifying    open_fits, fit, tensile
discovering    discover
using          simulate, validate, plan, report, publish, export
results        classes of results, which are printed as tables
demonstrating  all steps on the virtual rig, and the comparison of the fits with the true law (`eimi demo`)

A function writes a file only if the argument `output` is given, or if its result is a file.
"""
