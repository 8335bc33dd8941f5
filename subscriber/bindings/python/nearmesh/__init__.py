# SPDX-License-Identifier: Apache-2.0
"""Certified collision detection over progressive meshes: models, queries, peers on DDS, recordings.

    import numpy as np, nearmesh as nm
    ball = nm.bake(vertices, faces, "ball.spm")
    answers = nm.Pair(ball, ball).query(np.eye(4), poses)      # (n, 4, 4) in, a structured array out
    answers["certified"].all(), answers["status"] == nm.Status.CONTACT

Units are metres, seconds and radians; poses are matrices (4, 4), x_world = M x_model. A certified answer is never wrong;
one that is not certified says so. Objects may be shared between threads: calls on one wait for each other.
"""
from enum import IntEnum

from . import errors
from ._nearmesh import (Contacts, Depth, FrameReport, FreeByBounds, Model, Motion, Pair, RecordedBody, RecordedScene,
                        Recording, Session, World, __version__, bake, pose)
from .errors import Error


class ContactChange(IntEnum):
    """What an update says of a contact. UNCONFIRMED: it was not found, but the answer is not certified."""
    BEGIN = 0
    PERSIST = 1
    END = 2
    UNCONFIRMED = 3


class Status(IntEnum):
    """What an answer says. FREE, CONTACT and CONTAINED are certified."""
    FREE = 0
    CONTACT = 1
    PARTIAL = 2
    UNCERTAIN = 3
    CONTAINED = 4


class Contained(IntEnum):
    """Which body has a part inside which."""
    NONE = 0
    A_IN_B = 1
    B_IN_A = 2
    BOTH = 3


class ProbeStatus(IntEnum):
    """What a probe met: MISS and HIT are certified."""
    MISS = 0
    HIT = 1
    UNCERTAIN = 2


__all__ = ["ContactChange", "Contacts", "Contained", "Depth", "Error", "FrameReport", "FreeByBounds", "Model", "Motion", "Pair",
           "ProbeStatus", "RecordedBody", "RecordedScene", "Recording", "Session", "Status", "World", "__version__", "bake",
           "errors", "pose"]
