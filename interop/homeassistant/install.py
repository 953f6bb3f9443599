"""Home Assistant in a Debian of its own, below cargo's target folder, since each version needs a
Python of its own. Installed once, kept between runs, and removed with the target folder."""

import json
import os
import pathlib
import shutil
import subprocess
import sys

from rig import target

# The release of Debian for each of Home Assistant, by which everything else that it needs is
# pinned: a new one, and one from before the messages for whole devices (2024.11).
SUITES = {"2026.2.3": "trixie", "2024.3.3": "bookworm"}
# What it does not name as a dependency and does not start without. The old one names less.
ALSO = ("home-assistant-frontend", "paho-mqtt", "fnv-hash-fast", "janus", "pillow",
        "psutil-home-assistant", "securetar", "sqlalchemy")
# Integrations that have requirements of their own.
NEEDED = ("modbus",)
# The compiler is for packages that have no wheel.
DEBIAN = ("python3", "python3-venv", "python3-dev", "gcc", "libc6-dev")
# What root needs of this machine to reach a package index, where it is there.
SHARED = ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf", "/etc/ssl/certs/ca-certificates.crt")
PYTHON = "/venv/bin/python"
SITE = "venv/lib/python*/site-packages"
# What these integrations require: an earlier run may have installed without it.
THERE = ("pymodbus",)


def clear():
    """Removes versions of before, and what was not finished."""
    folder = target() / "homeassistant"
    folder.mkdir(parents=True, exist_ok=True)
    for each in folder.iterdir():
        if each.name not in SUITES:
            shutil.rmtree(each)


def root(version):
    """The root of the Debian of this Home Assistant, which is made if it is not there."""
    place = target() / "homeassistant" / version
    if not place.is_dir():
        unfinished = place.with_name(f"{version}.unfinished")
        unfinished.mkdir()
        # In one piece: the other one is installed at the same time.
        print(f"installing Home Assistant {version} in {place.relative_to(target())}: "
              "this takes some minutes, once\n", end="", flush=True)
        debian(unfinished, SUITES[version])
        packages(unfinished, version)
        unfinished.rename(place)
    elif not all(list(place.glob(f"{SITE}/{name}")) for name in THERE):
        packages(place, version)
    return place


def command(place, *words):
    """What runs a program in there."""
    return [shutil.which("chroot", path=path()), place, *words]


def path():
    """Debian has its programs for root where only root looks for them."""
    return os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])


def environment():
    """This machine's, where it says how a package index is reached, and nothing that is about
    another Python."""
    kept = {key: value for key, value in os.environ.items()
            if key.startswith(("PIP_", "SSL_", "REQUESTS_", "CURL_"))
            or key.lower().endswith("_proxy")}
    return {**kept, "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8"}


def mirror():
    """Where this machine has its Debian packages from."""
    targets = ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages",
               "Origin: Debian", "Label: Debian"]
    said = subprocess.run(targets, check=True, capture_output=True, text=True).stdout.split()
    if not said:
        raise RuntimeError("apt knows no mirror of Debian")
    return said[0]


def debian(place, suite):
    """The least of this Debian that has a Python."""
    # What it mounts is gone with it, even if it is killed.
    words = ["unshare", "--mount", "mmdebstrap", "--mode=root", "--variant=minbase",
             f"--include={','.join(DEBIAN)}", suite, place, mirror()]
    told = subprocess.run(words, check=False, capture_output=True, text=True,
                          env={**os.environ, "PATH": path()})
    if told.returncode:
        sys.exit(f"mmdebstrap failed: {told.stdout[-2000:]}{told.stderr[-2000:]}")
    for file in SHARED:
        if pathlib.Path(file).is_file():
            inside = place / file.lstrip("/")
            inside.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, inside)


def packages(place, version):
    """Home Assistant, with exactly what it was released with."""
    run = lambda *words: subprocess.run(command(place, *words), check=True, env=environment())
    pip = lambda *words: run(PYTHON, "-m", "pip", "-qq", "install", "--no-cache-dir", *words)
    run("python3", "-m", "venv", "/venv")
    itself = f"homeassistant=={version}"
    pip("--no-deps", itself)
    [there] = place.glob(f"{SITE}/homeassistant")
    manifests = [there / f"components/{name}/manifest.json" for name in NEEDED]
    needs = [each for file in manifests for each in json.loads(file.read_text())["requirements"]]
    pins = there / "package_constraints.txt"
    pip("--constraint", f"/{pins.relative_to(place)}", itself, *ALSO, *needs)
