"""The files of protocols, specimens and rigs that a person edits.

They are installed with the package, so that `eimi acquire dragon_skin_10 --specimen type1 --rig virtual` finds them by
name from every folder. A path can be given instead of a name.
"""
