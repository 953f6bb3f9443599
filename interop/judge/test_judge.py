"""The judge against false logs: it has to detect each kind of false claim, and accept true ones."""

import tempfile
import time
import unittest

from checksums import crc, total
from claims import Book, Claim, Part, Reading, take_answer
from judge import KINDS, Judge
from line import Line
from modules import Act, EdaAscii, EdaLc02, EdaRtu, Emd, Erc8, R55, Reply, World

RELAY = "oven.k1"


class Told:
    """A log and claims, made by hand."""

    def __init__(self, lives=None):
        self.world, self.book = World(), Book()
        self.lives = lives or [[0.0, None, None, ""]]
        self.world.change(RELAY, 0.0, False, "at the beginning")

    def acts(self, when, value, kind="set", moves=True, answered=True):
        """The relay is commanded at that time."""
        self.world.acts[RELAY].append(Act(when, when, kind, value, 1, answered))
        if moves:
            self.world.change(RELAY, when, value, "frame 1")
        return self

    def says(self, kind, want, since, until, answer, status=200, **more):
        """A command with this answer."""
        claim = Claim(kind, [Part(RELAY, want)], since, until, **more)
        self.book.begin(claim)
        if answer is not None:
            take_answer(claim, status, answer)
        return self

    def reads(self, since, until, value):
        """A good value was reported."""
        self.book.readings.append(Reading(RELAY, value, since, until, "get"))
        return self

    def tells(self, when, value, clean=True):
        """The module reported its state."""
        self.world.replies["oven"].append(Reply(when, when, {RELAY: value}, clean))
        return self

    def judge(self, over=100.0, left=False):
        """The kinds of false claims that are found."""
        judge = Judge(self.world, self.book, self.lives, (), {"oven": "rtu"})
        judge.over = over
        judge.judge()
        if left:
            judge.left(over)
        self.judged = judge
        return sorted({failure.kind for failure in judge.false})


def readback(value, **more):
    return {"value": value, "confirmed": "readback", "audit": "1", **more}


def reply(value, **more):
    return {"value": value, "confirmed": "reply", "audit": "1", **more}


NOTHING_DONE = {"code": "E0108", "status": 409}
MAY_HAVE = {"code": "E0302", "may_have_acted": True}


class Lies(unittest.TestCase):
    """Each false claim is found, and a true one that differs only in that is accepted."""

    def lie(self, told, *kinds, **more):
        self.assertEqual(told.judge(**more), sorted(kinds))

    def true(self, told, **more):
        self.assertEqual(told.judge(**more), [])
        self.assertTrue(told.judged.checked)

    def test_readback(self):
        self.true(Told().acts(10.1, True).says("set", True, 10, 10.2, readback(True)))
        self.lie(Told().acts(10.1, True, moves=False).says("set", True, 10, 10.2, readback(True)),
                 "readback")
        self.lie(Told().acts(10.3, True).says("set", True, 10, 10.2, readback(True)),
                 "nobody's", "readback")

    def test_reply_without_an_order(self):
        self.true(Told().acts(10.1, True).says("set", True, 10, 10.2, reply(True)))
        self.lie(Told().says("set", True, 10, 10.2, reply(True)), "reply")
        self.lie(Told().acts(10.1, True, answered=False).says("set", True, 10, 10.2, reply(True)),
                 "reply")
        self.lie(Told().acts(9.0, True).says("set", True, 8.9, 9.1, reply(True))
                 .says("set", True, 10, 10.2, reply(True)), "reply")

    def test_reply_that_a_reading_contradicts(self):
        stuck = Told().acts(10.1, True, moves=False).says("set", True, 10, 10.4, reply(True))
        self.true(stuck.tells(10.2, False, clean=False).tells(10.3, False, clean=False))
        stuck = Told().acts(10.1, True, moves=False).says("set", True, 10, 10.4, reply(True))
        self.lie(stuck.tells(10.2, False).tells(10.3, False, clean=False), "reply value")

    def test_before(self):
        self.true(Told().acts(10.1, True)
                  .says("set", True, 10, 10.2, readback(True, before=False)))
        # Another client's command came before, and its own was lost.
        self.true(Told().acts(5, True).says("set", True, 4.9, 5.1, readback(True))
                  .acts(10.1, False).says("set", False, 10, 10.2, readback(False))
                  .says("set", False, 10.05, 10.3, readback(False, before=False)))
        self.lie(Told().acts(10.1, True).acts(10.11, False)
                 .says("set", False, 10.1, 10.2, readback(False))
                 .says("set", True, 10, 10.2, readback(True))
                 .acts(20.1, True).says("set", True, 20, 20.2, readback(True, before=True)),
                 "before")

    def test_before_beside_the_end_of_a_lease(self):
        lease = {"seconds": 5, "by": "host"}
        held = Told().acts(5.1, True).says("lease", True, 5, 5.2, readback(True), **lease)
        self.true(held.acts(10.15, False).acts(10.25, True)
                  .says("set", True, 10.1, 10.3, readback(True, before=False)))
        held = Told().acts(5.1, True).says("lease", True, 5, 5.2, readback(True), **lease)
        self.lie(held.acts(12.1, False).says("set", False, 12, 12.3, readback(False, before=False)),
                 "before")

    def test_a_lease_given_back_that_is_another_ones(self):
        def given_back(told, **more):
            held = Told().acts(5.1, True).says("set", True, 5, 5.2, readback(True))
            held.acts(10.1, False)
            held.says("lease", False, 10, 10.2, readback(False), seconds=9, by="host")
            return held.acts(10.4, True).says("unlease", None, 10.3, 10.5, told, **more)

        self.true(given_back(readback(True)), left=True)
        self.lie(given_back(readback(False)), "left", left=True)
        self.lie(given_back(readback(True)).acts(10.45, False), "left", left=True)

    def test_a_lease_given_back_and_not_seen_is_tried_again(self):
        def given_back(told):
            held = Told().acts(10.1, True)
            held.says("lease", True, 10, 10.2, readback(True), seconds=9, by="host")
            held.acts(10.4, False).says("unlease", None, 10.3, 10.5, told)
            return held.acts(10.9, False)

        self.true(given_back(reply(False)), left=True)
        self.lie(given_back(readback(False)), "nobody's", left=True)
        self.lie(given_back(reply(False)).acts(33.0, False), "nobody's", left=True)

    def test_nothing_was_done(self):
        self.true(Told().acts(10.1, True).says("set", True, 10, 10.2, MAY_HAVE, 504))
        self.lie(Told().acts(10.1, True).says("set", True, 10, 10.2, NOTHING_DONE, 409), "nobody's")

    def test_an_order_after_its_time(self):
        self.lie(Told().acts(10.5, True).says("set", True, 10, 10.2, MAY_HAVE, 504), "nobody's")
        self.lie(Told().acts(10.1, False).says("set", True, 10, 10.2, MAY_HAVE, 504), "nobody's")

    def test_a_command_ends_with_the_daemon_that_was_told_to_stop(self):
        lives = [[0.0, 10.2, 11.0, "TERM"], [11.1, None, None, ""]]
        self.true(Told(lives).acts(10.8, True).says("set", True, 10, 10.3, None))
        self.lie(Told(lives).acts(11.5, True).says("set", True, 10, 10.3, None), "nobody's")

    def test_toggled_twice(self):
        once = Told().acts(10.1, True, "toggle")
        once.says("toggle", None, 10, 10.2, reply(True), is_raw=True)
        self.true(once)
        self.lie(once.acts(10.15, False, "toggle"), "twice")

    def test_the_same_key_acts_twice(self):
        asked = Told().acts(10.1, True, "toggle")
        for since in (10.0, 10.3):
            asked.says("toggle", None, since, since + 0.2, reply(True), is_raw=True, key="x")
        self.true(asked)
        self.lie(asked.acts(10.4, False, "toggle"), "twice")
        # The first answer was lost with its connection.
        late = Told().acts(10.1, True, "toggle")
        late.says("toggle", None, 10.0, 10.2, None, is_raw=True, key="x")
        self.true(late.says("toggle", None, 10.4, 10.6, reply(True), is_raw=True, key="x"))
        other = Told().acts(10.1, True, "toggle")
        other.says("toggle", None, 10, 10.2, reply(True), is_raw=True, key="x")
        other.says("toggle", None, 10.3, 10.5, reply(False), is_raw=True, key="x")
        self.lie(other, "twice")

    def test_undone(self):
        def batch():
            answer = {"results": [{"path": RELAY, "error": {"code": "E0456"}}], "undone": True}
            told = Told().acts(10.1, True)
            return told.says("batch", True, 10, 10.4, answer, all_or_nothing=True)
        self.true(batch().acts(10.3, False))
        self.lie(batch(), "undone")

    def test_readings(self):
        self.true(Told().acts(10, True).reads(9.9, 10.2, True).reads(9.9, 10.2, False)
                  .says("set", True, 9.9, 10.1, readback(True)))
        self.lie(Told().reads(9.9, 10.2, True), "reading")

    def pulse(self, ends=True, lives=None):
        told = Told(lives).acts(10.1, True)
        told.says("pulse", True, 10, 10.2, readback(True), seconds=1.0, by="host")
        return told.acts(11.1, False) if ends else told

    def test_a_pulse_that_does_not_end(self):
        self.true(self.pulse(), left=True)
        self.lie(self.pulse(ends=False), "end", "left", left=True)

    def test_a_pulse_that_ends_early(self):
        early = Told().acts(10.1, True).acts(10.5, False)
        early.says("pulse", True, 10, 10.2, readback(True), seconds=1.0, by="host")
        self.lie(early, "nobody's")

    def test_an_end_that_is_tried_again(self):
        def tried(*times):
            told = Told().acts(10.1, True)
            told.says("pulse", True, 10, 10.2, readback(True), seconds=1.0, by="host")
            for when in times:
                told.acts(when, False)
            return told

        self.true(tried(11.1, 12.6, 15.1, 19.6))
        self.lie(tried(11.1, 24.0), "nobody's")
        self.lie(tried(19.6), "end")

    def test_a_pulse_beside_a_set(self):
        """The set ended first, and the one that ended last leaves it off, too."""
        told = Told().acts(10.05, False).acts(10.1, True)
        told.says("pulse", True, 10, 10.2, readback(True), seconds=1.0, by="host")
        told.says("set", False, 10.01, 10.15, readback(False))
        self.lie(told, "left", left=True)

    def test_a_kill_undoes_a_takeover(self):
        lives = [[0.0, 10.55, 10.6, "KILL"], [10.7, None, None, ""]]
        told = self.pulse(ends=False, lives=lives)
        told.acts(10.4, True).says("set", True, 10.3, 10.5, readback(True))
        self.true(told, left=True)
        self.lie(told.acts(11.0, False), "left", left=True)

    def test_a_lease_that_was_renewed(self):
        def leased(end):
            told = Told().acts(10.1, True)
            told.says("lease", True, 10, 10.2, readback(True), seconds=0.5, by="host")
            told.says("lease", True, 10.4, 10.41, {"value": True, "renewed": True}, seconds=2.0,
                      by="host")
            return told.acts(end, False)
        self.true(leased(12.42), left=True)
        self.lie(leased(10.8), "nobody's")
        shorter = leased(10.8)
        renewed = {"value": True, "renewed": True}
        shorter.says("lease", True, 10.5, 10.51, renewed, seconds=0.25, by="host")
        self.true(shorter, left=True)
        self.lie(leased(26.0), "end", "nobody's")

    def test_what_this_machine_spoilt_is_not_judged(self):
        told = Told().reads(9.9, 10.2, True)
        told.world.overdue["rtu"].append(10.0)
        self.assertEqual(told.judge(), [])
        self.assertEqual(told.judged.outside["reading"], 1)

    def test_trouble_widens_what_is_bounded(self):
        told = self.pulse(ends=False).acts(25.0, False)
        told.world.trouble("oven", 11.0, 24.0)
        self.true(told)

    def test_replies_that_are_held_up_widen_the_time_of_an_end(self):
        told = self.pulse(ends=False).acts(20.0, False).acts(25.0, False)
        self.lie(told, "end", "nobody's")
        told = self.pulse(ends=False).acts(25.0, False)
        told.world.stall("rtu", 11.0, 18.0)
        told.world.stall("rtu", 17.0, 24.0)
        self.assertEqual(told.world.stalls["rtu"], [[11.0, 24.0]])
        self.true(told)

    def test_all_kinds_are_named(self):
        told = Told().reads(9.9, 10.2, True)
        told.judge()
        self.assertLessEqual(set(told.judged.checked), set(KINDS))


class Order(unittest.TestCase):
    """Bytes that are late are not overtaken."""

    def test_nothing_overtakes_what_is_held_up(self):
        with tempfile.TemporaryDirectory() as folder:
            line = Line(World(), "rtu", folder + "/rtu", [], 1)
            with open(line.path, "rb+", buffering=0) as port:
                now = time.monotonic()
                line.faults = {"late5"}
                line.do(lambda _: line._put(now + 0.6, b"late", lambda _: None))
                line.faults = set()
                line.do(lambda _: line._put(now, b"soon", lambda _: None))
                heard = b""
                while len(heard) < 8:
                    heard += port.read(8)
                took = time.monotonic() - now
            line.close()
        self.assertEqual(heard, b"latesoon")
        self.assertGreater(took, 0.59)
        self.assertEqual(len(line.world.stalls["rtu"]), 1)

    def test_a_module_answers_in_the_order_in_which_it_was_asked(self):
        with tempfile.TemporaryDirectory() as folder:
            world = World()
            modules = [Erc8(world, "oven", 1), Erc8(world, "hall", 2)]
            line = Line(world, "rtu", folder + "/rtu", modules, 1)
            line.faults = {"late", "pieces"}

            def fill(now):
                for number in range(200):
                    reply, at = bytes([number]) * 4, now + number / 1000
                    module = modules[number % 2]
                    line._fate(module, reply, False, (at, at, number), b"", False)
                return [data[0] for _, _, data, _ in sorted(line._queue, key=lambda due: due[:2])]
            came = line.do(fill)
            line.close()
        of_each = [[number for number in came if number % 2 == nth] for nth in range(2)]
        self.assertEqual([sorted(numbers) for numbers in of_each], of_each)
        # Modules answer independently of each other.
        self.assertNotEqual(sorted(came), came)


class Modules(unittest.TestCase):
    """The modules send the frames that are printed in the datasheets."""

    def answer(self, module, frame):
        self.assertEqual(module.take(frame), len(frame))
        self.assertTrue(module.is_for(frame))
        return module.act(frame, (1.0, 1.0, 1))[0]

    def test_erc8(self):
        module = Erc8(World(), "m", 1)
        on = bytes.fromhex("01 05 00 3C FF 00 4C 36")
        self.assertEqual(self.answer(module, on), on)
        read = bytes.fromhex("01 01 00 3C 00 01 3D C6")
        self.assertEqual(self.answer(module, read), bytes.fromhex("01 01 01 01 90 48"))

    def test_emd(self):
        module = Emd(World(), "m", 1)
        frame = bytes.fromhex("01 03 00 06 00 01 64 0B")
        body = bytes.fromhex("01 03 02 01 41")
        self.assertEqual(self.answer(module, frame), body + crc(body))

    def test_eda_rtu_pulses(self):
        world = World()
        module = EdaRtu(world, "m", 1)
        module.pulse_mask = 1
        frame = bytes.fromhex("01 05 00 00 FF 00")
        self.answer(module, frame + crc(frame))
        self.assertTrue(module.told()["m.do0"])
        module.settle(2.1)
        self.assertFalse(module.told()["m.do0"])
        self.assertEqual(world.changes["m.do0"][-1][0], 2.0)

    def test_ascii(self):
        module = EdaAscii(World(), "m", 8, 4, checksum=False)
        self.assertEqual(self.answer(module, b"$082\r"), b"!08400600\r")
        self.assertEqual(self.answer(module, b"#081201\r"), b">\r")
        self.assertEqual(self.answer(module, b"$086\r"), b"!040000\r")
        summed = EdaAscii(World(), "m", 1, 8)
        self.assertEqual(self.answer(summed, b"$016BB\r")[-3:-1], b"%02X" % total(b"!000000"))
        self.assertFalse(summed.is_for(b"$016BC\r"))

    def test_lc02(self):
        module = EdaLc02(World(), "m", 1, 8)
        module.state, module.levels = 0x11, 0x22
        frame = bytes.fromhex("4C 57 01 03 04 0D")
        self.assertEqual(self.answer(module, frame), bytes.fromhex("6C 63 01 11 22 34 0D"))

    def test_r55(self):
        module = R55(World(), "m", 1)
        frame = bytes.fromhex("55 01 12 00 00 00 01")
        on = self.answer(module, frame + bytes([total(frame)]))
        self.assertEqual(on, bytes.fromhex("22 01 12 00 00 00 01 36"))
        frame = bytes.fromhex("55 01 30 00 00 00 01")
        self.assertIsNone(self.answer(module, frame + bytes([total(frame)])))
        self.assertFalse(module.told()["m.k1"])


if __name__ == "__main__":
    unittest.main()
