# SPDX-License-Identifier: Apache-2.0
"""
Embree from Python by ctypes, as a script without umbrage would ask it: one occlusion ray a point towards a sun.
"""
import ctypes
import sys

import numpy as np

TRIANGLES, INDEX, VERTEX, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003  # rtcore_geometry.h, rtcore_buffer.h, rtcore_common.h
COHERENT = 1
RAY = np.dtype([("origin", "f4", 3), ("tnear", "f4"), ("direction", "f4", 3), ("time", "f4"), ("tfar", "f4"),
                ("mask", "u4"), ("id", "u4"), ("flags", "u4")])


class Context(ctypes.Structure):
    """struct RTCIntersectContext of Embree 3 with one instance level."""

    _fields_ = [("flags", ctypes.c_int), ("filter", ctypes.c_void_p), ("instance", ctypes.c_uint)]


def read_ply(path):
    """Vertices and triangles of a binary PLY file of scenegen."""
    with open(path, "rb") as file:
        head, _, data = file.read().partition(b"end_header\n")
    words = head.decode().split()
    vertices, faces = (int(words[words.index(name) + 1]) for name in ("vertex", "face"))
    kind = "<f8" if "double" in words else "<f4"
    size = 3 * np.dtype(kind).itemsize * vertices
    table = np.frombuffer(data[size:], np.dtype([("n", "u1"), ("v", "<u4", 3)]), faces)
    assert (table["n"] == 3).all()
    return np.frombuffer(data[:size], kind).reshape(-1, 3).astype(np.float32), np.ascontiguousarray(table["v"])


class Scene:
    """Triangles in Embree, and occlusion rays through them. Raises OSError where libembree3 is not installed."""

    def __init__(self, vertices, triangles):
        self._rtc = rtc = ctypes.CDLL("libembree3.so.3")
        pointer, number = ctypes.c_void_p, ctypes.c_uint
        for name, result, arguments in (
                ("rtcNewDevice", pointer, [ctypes.c_char_p]), ("rtcNewScene", pointer, [pointer]),
                ("rtcNewGeometry", pointer, [pointer, ctypes.c_int]), ("rtcCommitGeometry", None, [pointer]),
                ("rtcSetNewGeometryBuffer", pointer, [pointer, ctypes.c_int, number, ctypes.c_int, ctypes.c_size_t, ctypes.c_size_t]),
                ("rtcAttachGeometry", number, [pointer, pointer]), ("rtcCommitScene", None, [pointer]),
                ("rtcOccluded1", None, [pointer, ctypes.POINTER(Context), pointer]),
                ("rtcOccluded1M", None, [pointer, ctypes.POINTER(Context), pointer, number, ctypes.c_size_t])):
            function = getattr(rtc, name)
            function.restype, function.argtypes = result, arguments
        device = rtc.rtcNewDevice(None)
        self._scene, geometry = rtc.rtcNewScene(device), rtc.rtcNewGeometry(device, TRIANGLES)
        for kind, form, array in ((VERTEX, FLOAT3, vertices), (INDEX, UINT3, triangles.astype(np.uint32))):
            room = rtc.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(array))
            ctypes.memmove(room, np.ascontiguousarray(array).ctypes.data, array.nbytes)
        rtc.rtcCommitGeometry(geometry)
        rtc.rtcAttachGeometry(self._scene, geometry)
        rtc.rtcCommitScene(self._scene)

    @staticmethod
    def _rays(points, towards):
        raw = np.empty(len(points) * RAY.itemsize + 16, np.uint8)
        begin = -raw.ctypes.data % 16
        rays = raw[begin:begin + len(points) * RAY.itemsize].view(RAY)
        rays["origin"], rays["direction"], rays["tnear"], rays["time"] = points, towards, 1e-3, 0
        rays["tfar"], rays["mask"], rays["id"], rays["flags"] = np.inf, 0xFFFFFFFF, 0, 0
        return rays

    def lit_by_call(self, points, towards):
        """One call of rtcOccluded1 a point, in a Python loop."""
        rays, context = self._rays(points, towards), Context(0, None, 0xFFFFFFFF)
        address, occluded = rays.ctypes.data, self._rtc.rtcOccluded1
        by_reference = ctypes.byref(context)
        for i in range(len(points)):
            occluded(self._scene, by_reference, address + i * RAY.itemsize)
        return rays["tfar"] > 0

    def lit_by_batch(self, points, towards):
        """One call of rtcOccluded1M with rays that numpy makes."""
        rays, context = self._rays(points, towards), Context(COHERENT, None, 0xFFFFFFFF)
        self._rtc.rtcOccluded1M(self._scene, ctypes.byref(context), rays.ctypes.data, len(points), RAY.itemsize)
        return rays["tfar"] > 0


if __name__ == "__main__":
    sys.exit(__doc__)
