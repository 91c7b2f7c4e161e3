#!/usr/bin/env bash
# Runs a script that reads records with h5py and xarray: python.sh SCRIPT [ARGUMENT…]. A script of the shell gets the
# interpreter as its last argument. Ends with 77 (skipped) where these are missing; `./bootstrap --dev` installs them.
set -euo pipefail
python=/usr/bin/python3
if ! "$python" -c 'import h5py, xarray, h5netcdf' 2>/dev/null; then
  echo 'skipped: no Python with h5py, xarray and h5netcdf'
  exit 77
fi
case $1 in
  *.py) exec "$python" "$@" ;;
  *) exec bash "$@" "$python" ;;
esac
