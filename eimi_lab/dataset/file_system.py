"""Check whether a folder is on a network file system.

A network file system does not preserve the order of writes, so a dataset there may be unreadable after a crash.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

from eimi_lab.process.paths import followed

NETWORK = frozenset(
    {"nfs", "nfs4", "cifs", "smb3", "smbfs", "ncpfs", "afs", "9p", "ceph", "lustre", "gpfs", "beegfs", "glusterfs"}
    | {"fuse.sshfs", "fuse.glusterfs", "fuse.cephfs", "fuse.rclone", "fuse.davfs", "davfs"}
)
_DRIVE_REMOTE = 4
"""The number with which the Windows function GetDriveTypeW reports a network drive (Microsoft, Windows API, fileapi.h).
"""

MOUNTS = Path("/proc/self/mounts")


def network_file_system(folder: Path, mounts: Path = MOUNTS) -> str | None:
    """Return the type of the network file system of a folder, such as "nfs"; None for a local file system.

    Parameters
    ----------
    folder
        The folder.
    mounts
        Linux's table of mounts (manual page proc(5)). Other systems do not need it.
    """
    if sys.platform == "win32":
        share = followed(folder).anchor  # a drive, or a share of a server
        return "network drive" if ctypes.windll.kernel32.GetDriveTypeW(share) == _DRIVE_REMOTE else None
    if not mounts.is_file():
        return None
    kind, depth = "", -1
    for line in mounts.read_text(encoding="utf-8", errors="surrogateescape").splitlines():
        place, type_of_mount = line.split()[1:3]
        at = Path(place.replace("\\040", " "))
        if followed(folder).is_relative_to(at) and len(at.parts) >= depth:  # a later mount hides an earlier one
            kind, depth = type_of_mount, len(at.parts)
    return kind if kind in NETWORK else None
