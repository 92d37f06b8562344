"""Correct single flipped bits of an HDF5 file by its checksums. Only the bytes read are corrected, never the file.

mended_file  a file object for h5py that replaces some bytes of a file when they are read
checksums    the checksums lookup3 (metadata) and fletcher32 (chunks), and the bit whose flip explains a wrong checksum
blocks       check one block of metadata, and correct one flipped bit in it
metadata     find every block of metadata of a file by its signature, and correct it
superblock   the first block of a file, which states whether the file was closed
chunks       correct the chunks of one dataset
probing      check in another process whether a file that was never closed can be read
"""
