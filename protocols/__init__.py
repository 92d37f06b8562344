"""The files that a person edits: protocols here, specimens and rigs in their folders.

They are installed with the suite, so that `eimi acquire dragon_skin_10 --specimen type1 --rig virtual` finds them by
name from anywhere; a path of one's own works in the same places.
"""
