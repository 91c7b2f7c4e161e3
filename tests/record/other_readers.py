"""Reads a record with h5py and xarray alone, as a user would. Exit status 77: they are not installed.

Usage: other_readers.py PATH_OF_TEST_PROGRAM
"""
import math
import os
import subprocess
import sys
import tempfile

try:
    import h5py
    import xarray
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)


def close(value, expected):
    """To some roundings: the cosine of one library is not the cosine of another."""
    return abs(float(value) - expected) <= 1e-15


def engines():
    found = []
    for name in ("netCDF4", "h5netcdf"):
        try:
            __import__(name)
            found.append(name.lower())
        except ImportError:
            pass
    return found


def read_with_h5py(path):
    with h5py.File(path, "r") as record:
        assert record.attrs["format"] == "rubato-1"
        assert record.attrs["title"] == "A pendulum — Γ, θ̇"
        assert record.attrs["finished"] == 1
        u = record["states/u"]
        assert [d.label for d in u.dims] == ["t", "y", "x"], [d.label for d in u.dims]
        assert u.dims[2][0] == record["grid/x"]
        assert u.dims[0][0] == record["states/t"]
        assert record["levels/h"].dims[0][0] == record["levels/step"]
        assert list(record["states/coordinate"].asstr()) == ["θ", "q2"]
        assert record["levels/t"].attrs["description"] == "time of every level"
        assert u.chunks is not None and u.compression == "gzip" and u.shuffle
        assert u.maxshape[0] is None


def read_with_xarray(path, engine):
    levels = xarray.open_dataset(path, group="levels", engine=engine)
    assert levels.h.dims == ("step",) and levels.gamma.dims == ("t",), levels
    assert levels.sizes["t"] == levels.sizes["step"] + 1 == 31
    assert close(levels.gamma.sel(t=0.5, method="nearest"), math.cos(5.0))

    states = xarray.open_dataset(path, group="states", engine=engine)
    assert states.u.dims == ("t", "y", "x") and states.q.dims == ("t", "coordinate"), states
    assert float(states.x[0]) == -20.0
    assert list(states.coordinate.values) == ["θ", "q2"], states.coordinate
    assert close(states.q.sel(coordinate="θ")[1], math.sin(3.0))
    assert states.attrs == {}

    previous = xarray.open_dataset(path, group="states/previous", engine=engine)
    assert previous.q.dims == ("t", "coordinate") and previous.sizes["t"] == states.sizes["t"], previous

    laws = xarray.open_dataset(path, group="laws", engine=engine)
    assert laws.energy.dims == ("t", "y", "x"), laws
    assert (laws.t.values == states.t.values).all() and (laws.x.values == states.x.values).all()

    root = xarray.open_dataset(path, engine=engine)
    assert root.attrs["title"] == "A pendulum — Γ, θ̇"


with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, "sample.h5")
    subprocess.run([sys.argv[1], "[.other-readers]"], check=True, stdout=subprocess.DEVNULL,
                   env=dict(os.environ, RUBATO_SAMPLE_RECORD=path))
    read_with_h5py(path)
    for engine in engines():
        print("xarray with", engine)
        read_with_xarray(path, engine)
    if not engines():
        print("skipped: xarray has no engine for HDF5 here")
        sys.exit(77)
