# SPDX-License-Identifier: Apache-2.0
"""libnearmesh by dlopen, with Python's own FFI: nothing is compiled. Structs as nearmesh.h has them."""
import ctypes
import math

BODY, STATUS, TEXT, HANDLE = ctypes.c_uint32, ctypes.c_int32, ctypes.c_char_p, ctypes.c_void_p
FREE, CONTACT, PARTIAL, UNCERTAIN, CONTAINED = range(5)
CERTIFIED = 2


class Error(ctypes.Structure):
    _fields_ = [("status", STATUS), ("message", ctypes.c_char * 1020)]


class Pose(ctypes.Structure):
    _fields_ = [("rotation", ctypes.c_double * 9), ("translation_m", ctypes.c_double * 3)]


class Motion(ctypes.Structure):
    _fields_ = [("pose", Pose), ("linear_velocity_mps", ctypes.c_double * 3),
                ("angular_velocity_radps", ctypes.c_double * 3)]


class BodyOptions(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("name", TEXT), ("model", TEXT), ("content", TEXT),
                ("max_pose_age_s", ctypes.c_double), ("own", ctypes.c_int32), ("solid", ctypes.c_int32),
                ("group", ctypes.c_uint32), ("mask", ctypes.c_uint32)]


class DdsOptions(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("transport", TEXT), ("name", TEXT), ("prefix", TEXT),
                ("network_interface", TEXT), ("security", TEXT), ("initial_peers", ctypes.POINTER(TEXT)),
                ("initial_peer_count", ctypes.c_size_t), ("discovery_server", TEXT), ("domain", ctypes.c_uint32),
                ("listen_port", ctypes.c_uint32), ("participants_per_peer", ctypes.c_uint32),
                ("reserved", ctypes.c_uint32), ("lease_s", ctypes.c_double), ("silence_s", ctypes.c_double),
                ("announcement_s", ctypes.c_double), ("identity_period_s", ctypes.c_double),
                ("heartbeat_s", ctypes.c_double)]


class Answer(ctypes.Structure):  # as much of it as is read here: more may follow
    _fields_ = [("status", ctypes.c_int32), ("is_certified", ctypes.c_int32), ("contained", ctypes.c_int32),
                ("truncated", ctypes.c_int32), ("pair_count", ctypes.c_size_t),
                ("pairs", ctypes.POINTER(ctypes.c_uint32 * 4)), ("pair_total", ctypes.c_uint64),
                ("clearance_m", ctypes.c_double)]


class PairAnswer(ctypes.Structure):
    _fields_ = [("a", BODY), ("b", BODY), ("answer", ctypes.POINTER(Answer)), ("reason", TEXT), ("awaited", TEXT),
                ("asked", ctypes.c_int32)]


class Frame(ctypes.Structure):
    _fields_ = [("answer_count", ctypes.c_size_t), ("unknown_count", ctypes.c_size_t),
                ("complaint_count", ctypes.c_size_t), ("all_certified", ctypes.c_int32), ("reserved", ctypes.c_int32),
                ("free", ctypes.c_uint64 * 5), ("seconds", ctypes.c_double * 5), ("more", ctypes.c_uint64 * 4),
                ("contact_event_count", ctypes.c_size_t), ("came_count", ctypes.c_size_t),
                ("went_count", ctypes.c_size_t)]


class BodyFacts(ctypes.Structure):
    _fields_ = [("name", TEXT), ("model", TEXT), ("content", TEXT), ("own", ctypes.c_int32), ("solid", ctypes.c_int32)]


class Readiness(ctypes.Structure):
    _fields_ = [("stage", ctypes.c_int32), ("reserved", ctypes.c_int32), ("pairs", ctypes.c_uint64),
                ("certified", ctypes.c_uint64), ("reason", TEXT)]


class Refused(Exception):
    def __init__(self, error):
        super().__init__(error.message.decode())
        self.status = error.status


class Nearmesh:
    """call("session_watch", session, a, b): nearmesh_session_watch() with an error behind; Refused where it fails."""

    def __init__(self, path):
        self.library = ctypes.CDLL(path)
        for name, result in (("version", TEXT), ("session_answer", ctypes.POINTER(PairAnswer)),
                             ("session_find", ctypes.POINTER(PairAnswer)), ("session_complaint", TEXT),
                             ("session_came", BODY), ("session_went", BODY)):
            getattr(self.library, "nearmesh_" + name).restype = result
        self.library.nearmesh_session_destroy.restype = None

    def call(self, name, *arguments):
        error = Error()
        if getattr(self.library, "nearmesh_" + name)(*arguments, ctypes.byref(error)) != 0:
            raise Refused(error)

    def options(self, kind, struct, /, **fields):
        options = kind()
        assert getattr(self.library, f"nearmesh_{struct}_options_init")(ctypes.byref(options), ctypes.c_size_t(
            ctypes.sizeof(options))) == 0
        for field, value in fields.items():
            setattr(options, field, value)
        return options

    def bake_sphere(self, path, slices=24, stacks=12):
        """Of radius 1."""
        points = [(0.0, 0.0, 1.0)]
        points += [(math.sin(math.pi * i / stacks) * math.cos(2 * math.pi * j / slices),
                    math.sin(math.pi * i / stacks) * math.sin(2 * math.pi * j / slices), math.cos(math.pi * i / stacks))
                   for i in range(1, stacks) for j in range(slices)]
        points.append((0.0, 0.0, -1.0))
        faces = []
        for j in range(slices):
            k = (j + 1) % slices
            faces.append((0, 1 + j, 1 + k))
            for ring in range(1, 1 + slices * (stacks - 2), slices):
                faces += [(ring + j, ring + slices + j, ring + slices + k), (ring + j, ring + slices + k, ring + k)]
            last = 1 + slices * (stacks - 2)
            faces.append((len(points) - 1, last + k, last + j))
        flat = [x for point in points for x in point], [v for face in faces for v in face]
        self.call("bake", (ctypes.c_double * len(flat[0]))(*flat[0]), ctypes.c_size_t(len(points)),
                  (ctypes.c_uint32 * len(flat[1]))(*flat[1]), ctypes.c_size_t(len(faces)), path.encode(), None)

    def local_session(self):
        session = HANDLE()
        self.call("session_create_local", None, ctypes.byref(session))
        return session

    def dds_session(self, **options):
        session = HANDLE()
        self.call("session_create_dds", ctypes.byref(self.options(DdsOptions, "dds", **options)), None,
                  ctypes.byref(session))
        return session

    def add_body(self, session, **options):
        body = BODY()
        self.call("session_add_body", session, ctypes.byref(self.options(BodyOptions, "body", **options)),
                  ctypes.byref(body))
        return body

    def update(self, session, frame_number, time_s, motions, budget_s=0.01):
        """`motions`: by body, where it is. Out: the frame."""
        bodies = (BODY * len(motions))(*[body.value for body, _ in motions])
        where = (Motion * len(motions))(*[motion for _, motion in motions])
        frame = ctypes.POINTER(Frame)()
        self.call("session_update", session, ctypes.c_uint64(frame_number), ctypes.c_double(time_s), bodies, where,
                  ctypes.c_size_t(len(motions)), ctypes.c_double(budget_s), ctypes.byref(frame))
        return frame.contents

    def find(self, session, a, b):
        found = self.library.nearmesh_session_find(session, a, b)
        return found.contents if found else None


def at(x, y, z):
    motion = Motion()
    motion.pose.rotation[:] = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    motion.pose.translation_m[:] = (x, y, z)
    return motion
