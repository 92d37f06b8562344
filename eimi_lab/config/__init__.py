"""The TOML files that a person edits, as checked values: specimen, protocol, rig, calibration.

Every file has its own module with a pydantic model and a `load_…` function that takes a path, or the name of a shipped
file. Whatever is wrong in a file becomes one `InputError` that names the file, the key, the value and what would be
right. The models keep the text that they came from, so that a dataset can store it comments and all.
"""
