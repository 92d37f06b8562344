"""Correct single flipped bits in an HDF5 file by means of its checksums. The file on the disk does not change.

mended_file  a file object that replaces some bytes of a file when they are read
checksums    the checksums lookup3 and fletcher32, and the search for one flipped bit
blocks       check of one block of metadata, and correction of one flipped bit in the block
metadata     search for all blocks of metadata (descriptions of groups and arrays), and their correction
superblock   the first block of a file, which tells whether the file was closed
chunks       correction of the stored pieces (chunks) of one array
probing      check, in a second process, whether a file that was never closed can be read
"""
