"""Builds wheels and source archives (PEP 517) with CMake, without a network.

`pip install .` configures build/wheel-TAG, builds the module there and packs it. The setting `folder` names another
build folder, which may have been configured before: pip install --config-settings folder=build .
"""

import base64
import gzip
import hashlib
import io
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[1]
TIME = (1980, 1, 1, 0, 0, 0)  # the same sources make the same files


def _version() -> str:
    return re.search(r"project\(rubato VERSION ([0-9.]+)", (SOURCES / "CMakeLists.txt").read_text(encoding="utf-8"))[1]


def _tag() -> str:
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def _metadata() -> str:
    readme = (SOURCES / "README.md").read_text(encoding="utf-8")
    return (f"Metadata-Version: 2.1\nName: rubato\nVersion: {_version()}\n"
            "Summary: Variational integration with variable time levels\n"
            "License-File: LICENSE\nRequires-Python: >=3.9\nRequires-Dist: numpy\n"
            "Provides-Extra: all\nRequires-Dist: matplotlib; extra == 'all'\nRequires-Dist: xarray; extra == 'all'\n"
            f"Description-Content-Type: text/markdown\n\n{readme}")


def _run(*command) -> None:
    subprocess.run([str(part) for part in command], check=True)


def _build(folder: Path) -> Path:
    """Builds the package; returns its folder."""
    if not (folder / "build.ninja").exists():
        _run("cmake", "-S", SOURCES, "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DRUBATO_PYTHON=ON",
             "-DRUBATO_TESTS=OFF", "-DRUBATO_EXAMPLES=OFF", f"-DPython_EXECUTABLE={sys.executable}")
    _run("cmake", "--build", folder, "--target", "rubato_python")
    package = folder / "python" / "rubato"
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    if not (package / f"_core{suffix}").exists():
        raise SystemExit(f"{package} is for another Python: this one wants _core{suffix}")
    return package


def _hash(data: bytes) -> str:
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def get_requires_for_build_wheel(config_settings=None) -> list:
    return []


def get_requires_for_build_sdist(config_settings=None) -> list:
    return []


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None) -> str:
    tag, version = _tag(), _version()
    folder = Path((config_settings or {}).get("folder", SOURCES / "build" / f"wheel-{tag.split('-')[0]}")).resolve()
    package = _build(folder)
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    files = {f"rubato/{path.name}": path.read_bytes() for path in sorted(package.iterdir())
             if path.suffix in (".py", ".pyi") or path.name in ("py.typed", f"_core{suffix}")}
    information = f"rubato-{version}.dist-info"
    files[f"{information}/METADATA"] = _metadata().encode()
    files[f"{information}/WHEEL"] = (f"Wheel-Version: 1.0\nGenerator: rubato\nRoot-Is-Purelib: false\n"
                                     f"Tag: {tag}\n").encode()
    files[f"{information}/LICENSE"] = (SOURCES / "LICENSE").read_bytes()
    record = "".join(f"{name},{_hash(data)},{len(data)}\n" for name, data in files.items())
    files[f"{information}/RECORD"] = f"{record}{information}/RECORD,,\n".encode()
    name = f"rubato-{version}-{tag}.whl"
    with zipfile.ZipFile(Path(wheel_directory) / name, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, data in files.items():
            entry = zipfile.ZipInfo(path, TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if path.endswith(".so") else 0o644) << 16
            wheel.writestr(entry, data)
    return name


def build_sdist(sdist_directory, config_settings=None) -> str:
    base = f"rubato-{_version()}"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=SOURCES, check=True, capture_output=True).stdout
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w", format=tarfile.PAX_FORMAT) as tar:
        def add(name: str, data: bytes, mode: int) -> None:
            entry = tarfile.TarInfo(f"{base}/{name}")
            entry.size, entry.mode = len(data), mode
            tar.addfile(entry, io.BytesIO(data))

        for name in sorted(listed.decode().split("\0")):
            path = SOURCES / name
            if name and path.is_file():
                add(name, path.read_bytes(), 0o755 if os.access(path, os.X_OK) else 0o644)
        add("PKG-INFO", _metadata().encode(), 0o644)
    name = f"{base}.tar.gz"
    with open(Path(sdist_directory) / name, "wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=0) as packed:
        packed.write(archive.getvalue())
    return name
