#!/usr/bin/env bash
# Installs the Debian packages in a bare system, and runs the program, the C++ example of docs/cpp.md and Python there.
# Usage, as root: packages.sh FOLDER TREE, with the packages in FOLDER, and TREE made by
#   debootstrap --variant=minbase bookworm TREE
# whose apt reaches a mirror. Afterwards the packages are removed again, and must leave no file.
set -euo pipefail
folder=$(realpath "$1")
tree=$(realpath "$2")
sources=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../..")
inside() { chroot "$tree" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
say() { printf '\n== %s\n' "$*"; }

mkdir -p "$tree/packages" "$tree/example"
cp "$folder"/{rubato,librubato-dev,python3-rubato}_*.deb "$tree/packages/"
mountpoint -q "$tree/proc" || mount -t proc proc "$tree/proc"
trap 'umount "$tree/proc"' EXIT

say 'the program alone'
inside sh -c 'apt-get install -qq --no-install-recommends -y /packages/rubato_*.deb >/dev/null'
inside rubato --version
inside sh -c 'cd /example && rubato run kepler --force && rubato check kepler.h5 --replay && rubato report kepler.h5 --force'
for file in man/man1/rubato.1.gz bash-completion/completions/rubato zsh/vendor-completions/_rubato \
    fish/vendor_completions.d/rubato.fish doc/rubato/copyright; do
  # A bare tree may leave manual pages and documents out (path-exclude of dpkg).
  inside test -s "/usr/share/$file" || inside sh -c 'grep -rq path-exclude /etc/dpkg/dpkg.cfg.d'
done
if inside python3 -c 'import rubato' 2>/dev/null; then
  echo 'Python has the package before it is installed' >&2
  exit 1
fi

say 'the C++ library'
inside sh -c 'apt-get install -qq --no-install-recommends -y /packages/librubato-dev_*.deb cmake make >/dev/null'
for block in cmake:CMakeLists.txt cpp:orbit.cpp; do
  awk -v begin="^\`\`\`${block%%:*}\$" '$0 ~ begin && !done { inside = 1; next } inside && /^```$/ { inside = 0; done = 1 } inside' \
    "$sources/docs/cpp.md" >"$tree/example/${block#*:}"
done
inside sh -c 'cd /example && cmake -S . -B build -DCMAKE_BUILD_TYPE=Release >/dev/null && cmake --build build >/dev/null && build/orbit'

say 'the Python package'
inside sh -c 'apt-get install -qq --no-install-recommends -y /packages/python3-rubato_*.deb >/dev/null'
inside python3 -c '
import numpy as np, rubato as rb
pendulum = rb.Hamiltonian(q="q", p="p", H=lambda q, p: p**2/2 - np.cos(q))
r = rb.integrate(pendulum, [0, 1.9], (0, 100), step=0.1)
print(r.verdict, np.ptp(r.energy))
assert r.verdict == "good"'

say 'removed again'
inside sh -c 'apt-get purge -qq -y rubato librubato-dev python3-rubato >/dev/null'
if inside sh -c 'ls -d /usr/bin/rubato /usr/include/rubato /usr/share/doc/rubato 2>/dev/null'; then
  echo 'files of the packages are left' >&2
  exit 1
fi
