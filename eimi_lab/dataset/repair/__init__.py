"""Correct flipped bits of an HDF5 file by its checksums, for a reader; the file itself is never changed.

mended_file  a file to read with some of its bytes replaced, which h5py takes for a file
checksums    lookup3 of the metadata and fletcher32 of the chunks, and the one bit that explains a wrong one
blocks       one block of metadata: sound, or one flipped bit away from it
metadata     every block of metadata in a file, found by its signature
superblock   the first block, which says whether the file was closed
chunks       the chunks of one dataset
probing      another process that finds out whether a file that was never closed can be read at all
"""
