"""Write results into an archive that other programs can open: an RO-Crate in a zip file with the ending .eln.

contents   the files of an archive, with the kind, size and hash of each file
metadata   the description of the archive, ro-crate-metadata.json
archive    write the archive, and check every hash in it

The format is RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) in the layout of The ELN Consortium
(https://github.com/TheELNConsortium/TheELNFileFormat), which electronic laboratory notebooks read.
"""
