"""Rows of the matrix about what a daemon has begun and has to end, about stale values, and about
a line that another program has or that stalls."""

import re
import subprocess
import threading
import time

# How soon after its time a pulse or lease has ended: without faults, and if the module was away and
# the end has to be retried.
ENDED = 2.0
TRIED_AGAIN = 8.0
# How long a stalling line holds a reply up: longer than any timeout.
STALL = 1.5
# How long a value that is no longer read may be reported, and a line that stalled may take to
# recover.
OLD = 2.0
BACK = 2.0
# How many requests, 0.1 s apart, until a line that was lent is back: on a busy machine each takes
# longer.
ASKED = 18

# The address is taken.
TAKEN = "E0440"

WRONG = "WRONG: "


def off_outputs(case, address=1):
    """The channels that are off, of the four that are read."""
    return [nth for nth in range(4) if not case.line.units[address].outputs >> nth & 1]


def is_on(case, channel, address=1):
    """Whether an output really is on."""
    return bool(case.line.units[address].outputs >> channel & 1)


def wait_until(holds, seconds):
    """Waits until a condition is true; returns whether it is."""
    deadline = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def pulse(case, channel, millis):
    """A pulse that the daemon times."""
    return case.ask("POST", f"{case.point(channel)}/pulse", {"ms": millis, "by": "host"})


def lease(case, channel, millis):
    """A lease; also its renewal."""
    return case.ask("PUT", f"{case.point(channel)}/lease", {"value": True, "ttl_ms": millis})


def put(case, channel, value):
    """Sets an output."""
    return case.ask("PUT", case.point(channel), {"value": value})


def beside_a_pulse(begin):
    """A pulse or a lease of an output that is set off 0 to 5 ms later: it has to end off."""
    def row(case):
        for channel in off_outputs(case):
            for delay in (0.0, 0.002, 0.005):
                other = threading.Thread(target=begin, args=(case, channel, 300))
                other.start()
                time.sleep(delay)
                put(case, channel, False)
                other.join()
                time.sleep(0.3)
                if not wait_until(lambda c=channel: not is_on(case, c), ENDED):
                    yield f"{WRONG}on for good after {1000 * delay:.0f} ms"
                    return
        # Nor does an end come that is no longer due.
        time.sleep(0.5)
        yield WRONG + "on" if any(is_on(case, c) for c in off_outputs(case)) else "right"

    return row


def kill_after_takeover(case):
    """A pulse, a set that is answered, and kill -9 at once: the output stays as it was set."""
    channel = off_outputs(case)[0]
    pulse(case, channel, 1000)
    status, _ = put(case, channel, True)
    case.kill()
    case.start()
    time.sleep(ENDED)
    yield "right" if status == 200 and is_on(case, channel) else f"{WRONG}{status}, switched back"


def kill_within_a_lease(case):
    """A lease that was renewed, and kill -9: it holds as long as reported, and then ends."""
    channel = off_outputs(case)[0]
    lease(case, channel, 400)
    asked = time.monotonic()
    status, _ = lease(case, channel, 2500)
    renewed = time.monotonic()
    case.kill()
    case.start()
    time.sleep(max(renewed + 1.5 - time.monotonic(), 0))
    holds = is_on(case, channel)
    # If this script was held up until it may have ended, it has seen nothing wrong.
    holds = holds or time.monotonic() > asked + 2.5
    yield "right" if status == 200 and holds else f"{WRONG}{status}, ended early"
    ended = wait_until(lambda: not is_on(case, channel), 1.0 + ENDED)
    yield "right" if ended else WRONG + "it does not end"


def kills_within_a_lease(case):
    """A lease, and a daemon that is killed repeatedly: it still ends."""
    channel = off_outputs(case)[0]
    status, _ = lease(case, channel, 2000)
    due = time.monotonic() + 2.0 + ENDED
    ended = False
    while not ended and time.monotonic() < due:
        ended = wait_until(lambda: not is_on(case, channel), 1.2)
        case.kill()
        case.start()
    yield "right" if status == 200 and ended else f"{WRONG}{status}, it does not end"


def raw_late(case):
    """`raw` without a daemon: its reply is late, and the outputs have changed by then."""
    case.line.play(1, "late_within")
    yield raw(case, case.column.read)
    case.line.heal()
    case.flip(1)
    yield case.get(1)


def raw_echo(case):
    """`raw` without a daemon, an echoing adapter and a dead module: nothing acknowledges."""
    case.line.echo = True
    case.line.play(1, "dead", ("read", "write", "other"))
    yield raw(case, case.column.write)
    yield case.get(2)


def raw(case, frame):
    """How a raw frame ends: none of those here is answered in time."""
    done = subprocess.run(
        [case.program(), "raw", *frame, "-l", f"pty:{case.line.path}", "--direct", "-o", "json"],
        capture_output=True, text=True, timeout=15, check=False, cwd=case.folder.name)
    case.log.append(f"raw {frame}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return f"safe {done.returncode}" if done.returncode else f"{WRONG}{done.stdout[:80]}"


def taken_address(case):
    """The new address for a module belongs to another one, which answers after 0.4 s."""
    before = case.line.units[1].outputs
    case.line.add(9, before)
    case.line.play(9, "slow_module", ("read", "write", "other"))
    yield case.get(1)
    case.stop()
    done = subprocess.run(
        [case.program(), "config", "set", "a", "address=9", "--yes", "--direct", "-o", "json",
         "--config", case.config],
        capture_output=True, text=True, timeout=40, check=False, cwd=case.folder.name)
    case.log.append(f"config set: exit {done.returncode}\n{done.stdout}{done.stderr}")
    codes = re.findall(r"E0\d\d\d", done.stdout + done.stderr)
    refused = done.returncode and codes == [TAKEN]
    yield f"safe {TAKEN}" if refused else f"{WRONG}exit {done.returncode}, {codes}"


def grown_old(case):
    """Unit 1 stops answering; its cached values are not reported as good, and unit 2, which is
    polled as well, is not blamed for it."""
    yield case.get(1)
    time.sleep(0.5)
    case.line.play(1, "dead", ("read", "write", "other"))
    time.sleep(OLD)
    yield case.getting(1, fresh=False).wait()
    for _ in range(10):
        end = case.getting(2, fresh=False).wait()
        if end != "right":
            break
        time.sleep(0.1)
    yield end
    _, answer = case.ask("GET", "/modules")
    case.log.append(f"modules: {answer}")
    states = {module["module"]: module["state"] for module in answer["modules"]}
    told = states["a"] != "online" and states["b"] == "online"
    yield "right" if told else f"{WRONG}{states}"


def end_is_tried_again(case):
    """The module is away when its pulse is due to end, and comes back 4 s later."""
    channel = off_outputs(case)[0]
    status, _ = pulse(case, channel, 500)
    case.line.play(1, "dead", ("read", "write", "other"))
    time.sleep(4.5)
    case.line.heal()
    ended = wait_until(lambda: not is_on(case, channel), TRIED_AGAIN)
    yield "right" if status == 200 and ended else f"{WRONG}{status}, it does not end"


def borrower_is_killed(case):
    """The line is lent to a scan, which gets a kill -9; then the daemon takes the line back."""
    channel = off_outputs(case)[0]
    pulse(case, channel, 1500)
    scan = subprocess.Popen([case.program(), "scan", *case.way()], stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL, cwd=case.folder.name)
    before = case.line.asked(1)
    wait_until(lambda: case.line.asked(1) > before + 2, 1.0)
    scan.kill()
    scan.wait()
    ended = wait_until(lambda: not is_on(case, channel), 1.5 + ENDED)
    yield "right" if ended else WRONG + "it does not end"
    for _ in range(ASKED):
        end = case.get(1)
        if end == "right":
            break
        time.sleep(0.1)
    yield end


def stalls(case):
    """All replies are held up for a while and then arrive in their order, repeatedly; the outputs
    have changed by then."""
    yield case.get(1)
    for _ in range(4):
        case.line.stall(STALL)
        time.sleep(STALL - 0.1)
        case.flip(1)
        time.sleep(0.1)
        end = case.get(1)
        if end.startswith("WRONG"):
            break
        case.line.wait_idle(2)
        time.sleep(0.3)
    yield end
    time.sleep(BACK)
    yield case.get(1)
