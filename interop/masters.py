"""Drives a module through the steps of `modbus_cases.py` with a third-party master."""

from modbus_cases import LINES, SILENT, Ask, Do, Pulses, Speed, Unit
from rig import Rig, Tally

# How long masters wait for a reply, in seconds: if one must come, and if none may. Whether it
# really was silence is decided by the rig, which knows what its modules have sent.
PATIENCE = 10.0
SILENCE = 0.4


def drive(name, open_master, open_helper=None, lines=None):
    """The suites of one master, one per line: a name, and a function that returns a tally.
    `lines` are title, table, module and steps of each; all by default.

    Steps that the master can't send are not counted; if they would change the module, a helper
    sends them, so that later steps find what they expect.
    """
    lines = lines or [(table, table, *line) for table, line in LINES.items()]
    return [
        (f"{name}, {title}", lambda line=line: _suite(*line, open_master, open_helper))
        for title, *line in lines
    ]


def _suite(table, module, steps, open_master, open_helper):
    tally = Tally(table)
    with Rig(module) as rig, open_master(rig.port) as master:
        helper = open_helper(rig.port) if open_helper else None
        unit = 1
        for step in steps:
            match step:
                case Unit(address):
                    unit = address
                case Speed(rate):
                    master.speed(rate)
                    if helper:
                        helper.speed(rate)
                case Do(command):
                    rig.do(command)
                case Pulses(entries, module_name, want):
                    pulses = rig.pulses(module_name)
                    shape = len(pulses) == len(want) and all(
                        channel == wanted and low <= length <= high
                        for (channel, length), (wanted, low, high) in zip(pulses, want)
                    )
                    tally.check(entries, shape, True, f"pulses {pulses}, wanted {want},")
                case _ if not master.can(unit, step):
                    tally.cannot(step.entries)
                    if helper and (step.want == "done" or unit == 0):
                        rig.after(helper.request(unit, step, _timeout(step)))
                case _:
                    got = rig.after(master.request(unit, step, _timeout(step)))
                    tally.check(step.entries, got, step.want, f"unit {unit}, {_describe(step)}")
        if helper:
            helper.close()
    return tally


def _timeout(step):
    return SILENCE if step.want == SILENT else PATIENCE


def _describe(step):
    if isinstance(step, Ask):
        return f"fc{step.fc:02x} at {step.at}, {step.arg}"
    return getattr(step, "pdu", None) or step.frame
