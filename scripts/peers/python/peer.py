#!/usr/bin/env python3
"""Simplifies one PLY file with one peer from PyPI, as a competent user would write it.

Prints one line of JSON: the seconds of reading, simplifying and writing, and the triangles left.
Runs in the environment that bench.py makes from requirements.txt. Each peer reads and writes with
its own functions where it has some.
"""

import argparse
import json
import time


class Clock:
    """Measures the seconds between laps."""

    def __init__(self):
        self.last = time.monotonic()

    def lap(self):
        """Returns the seconds since the lap before."""
        last, self.last = self.last, time.monotonic()
        return self.last - last


def pymeshlab(source, out, ratio, clock):
    """MeshLab's edge collapse by quadrics (vcglib)."""
    import pymeshlab as ml

    meshes = ml.MeshSet(verbose=False)
    meshes.load_new_mesh(source)
    read = clock.lap()
    target = int(meshes.current_mesh().face_number() * ratio)
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=target)
    simplify = clock.lap()
    meshes.save_current_mesh(out, save_vertex_color=False, save_vertex_quality=False)
    return read, simplify, clock.lap(), meshes.current_mesh().face_number()


def vtk_any(made):
    """A simplification of VTK: `made` takes VTK and the ratio or divisions, and returns the filter."""

    def simplify_with_vtk(source, out, measure, clock):
        import vtk

        reader = vtk.vtkPLYReader()
        reader.SetFileName(source)
        reader.Update()
        mesh = reader.GetOutput()
        read = clock.lap()
        one = made(vtk, measure)
        one.SetInputData(mesh)
        one.Update()
        result = one.GetOutput()
        simplify = clock.lap()
        writer = vtk.vtkPLYWriter()
        writer.SetFileName(out)
        writer.SetInputData(result)
        writer.Write()
        return read, simplify, clock.lap(), result.GetNumberOfCells()

    return simplify_with_vtk


def vtk_quadric(vtk, ratio):
    """VTK's edge collapse by quadrics."""
    one = vtk.vtkQuadricDecimation()
    one.SetTargetReduction(1 - ratio)
    return one


def vtk_binned(vtk, divisions):
    """VTK's fastest clustering, which takes the number of cells along each axis."""
    one = vtk.vtkBinnedDecimation()
    one.AutoAdjustNumberOfDivisionsOff()
    one.SetNumberOfDivisions(*[int(divisions)] * 3)
    return one


def open3d(source, out, ratio, clock):
    """Open3D's edge collapse by quadrics."""
    import open3d as o3d

    mesh = o3d.io.read_triangle_mesh(source)
    read = clock.lap()
    small = mesh.simplify_quadric_decimation(int(len(mesh.triangles) * ratio))
    simplify = clock.lap()
    o3d.io.write_triangle_mesh(out, small, write_vertex_normals=False)
    return read, simplify, clock.lap(), len(small.triangles)


def fast_simplification(source, out, ratio, clock):
    """fast-simplification: edge collapse by quadrics with a rising threshold."""
    import fast_simplification as fast

    points, faces = read_ply(source)
    read = clock.lap()
    points, faces = fast.simplify(points, faces, 1 - ratio)
    simplify = clock.lap()
    write_ply(out, points, faces)
    return read, simplify, clock.lap(), len(faces)


def read_ply(source):
    """Reads a PLY of float positions and triangles, little-endian, as meshmill writes it."""
    import numpy as np

    with open(source, "rb") as file:
        counts = {}
        while (line := file.readline().split()) != [b"end_header"]:
            if line[0] == b"element":
                counts[line[1]] = int(line[2])
        points = np.fromfile(file, "<f4", 3 * counts[b"vertex"]).reshape(-1, 3)
        faces = np.fromfile(file, [("n", "u1"), ("v", "<i4", 3)], counts[b"face"])
    return points, np.ascontiguousarray(faces["v"])


def write_ply(out, points, faces):
    """Writes a PLY such as :func:`read_ply` reads."""
    import numpy as np

    rows = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    with open(out, "wb") as file:
        file.write(head.encode())
        np.asarray(points, "<f4").tofile(file)
        rows.tofile(file)


PEERS = {
    "pymeshlab": pymeshlab,
    "vtk-quadric": vtk_any(vtk_quadric),
    "vtk-binned": vtk_any(vtk_binned),
    "open3d": open3d,
    "fast-simplification": fast_simplification,
}


def main():
    """Runs one peer on one file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("input")
    parser.add_argument("output")
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--target-ratio", type=float)
    wanted.add_argument("--divisions", type=float, help="for vtk-binned")
    told = parser.parse_args()
    read, simplify, write, left = PEERS[told.peer](
        told.input, told.output, told.target_ratio or told.divisions, Clock())
    print(json.dumps({"read_s": read, "simplify_s": simplify, "write_s": write,
                      "out_triangles": left}))


if __name__ == "__main__":
    main()
