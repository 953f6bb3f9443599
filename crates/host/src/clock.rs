//! The clock and the alarm of a line.
//!
//! tokio's own timers tick in milliseconds and round up, which costs a fifth of the line's rate
//! at 38400 baud and more. A timerfd is exact to the microseconds that waking a task takes.

use crate::ioctl;
use railbus_wire::{Instant, Micros};
use rustix::fd::OwnedFd;
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use std::future::poll_fn;
use std::io;
use std::pin::pin;
use std::task::{Context, Poll, ready};
use std::time;
use tokio::io::unix::AsyncFd;

/// Microseconds since the line was started. A copyable handle to the line's time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    origin: time::Instant,
}

impl Clock {
    /// Rounded down: an alarm set for `now() + gap` is never early by it.
    pub(crate) fn now(self) -> Instant {
        Instant(self.origin.elapsed().as_micros() as u64)
    }
}

/// Wakes the line's task at a deadline.
#[derive(Debug)]
pub(crate) struct Alarm {
    clock: Clock,
    timer: AsyncFd<OwnedFd>,
    deadline: Option<Instant>,
    /// What the kernel timer is set to: never later than the deadline. A timer that is too early
    /// just expires, because most deadlines are postponed long before they are reached.
    armed: Option<Instant>,
}

impl Alarm {
    /// An alarm with a clock that starts now.
    pub(crate) fn new() -> io::Result<Alarm> {
        let flags = TimerfdFlags::CLOEXEC | TimerfdFlags::NONBLOCK;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        Ok(Alarm {
            clock: Clock {
                origin: time::Instant::now(),
            },
            timer: ioctl::watch(timer)?,
            deadline: None,
            armed: None,
        })
    }

    pub(crate) fn clock(&self) -> Clock {
        self.clock
    }

    pub(crate) fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Replaces the deadline.
    pub(crate) fn set(&mut self, deadline: Option<Instant>) -> io::Result<()> {
        self.deadline = deadline;
        match (deadline, self.armed) {
            (None, _) => Ok(()),
            (Some(deadline), Some(armed)) if armed <= deadline => Ok(()),
            (Some(deadline), _) => self.arm(deadline),
        }
    }

    fn arm(&mut self, at: Instant) -> io::Result<()> {
        // Computed slightly before the kernel starts counting, so never early.
        let left = at.since(self.now()).0;
        let left = Timespec {
            tv_sec: i64::try_from(left / 1_000_000).unwrap_or(i64::MAX),
            // For a deadline that has passed: zero would disarm the timer.
            tv_nsec: i64::from((left % 1_000_000) as u32 * 1000).max(1),
        };
        let value = Itimerspec {
            it_interval: Timespec::default(),
            it_value: left,
        };
        timerfd_settime(&self.timer, TimerfdTimerFlags::empty(), &value)?;
        self.armed = Some(at);
        Ok(())
    }

    /// The moment at which the deadline was seen to be over; never before it.
    pub(crate) fn poll(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<Instant>> {
        loop {
            // The timer is not read: rearming clears it, and only another expiry makes it ready
            // again.
            ready!(self.timer.poll_read_ready(cx))?.clear_ready();
            let now = self.now();
            if self.armed.is_some_and(|armed| armed <= now) {
                self.armed = None;
            }
            match self.deadline {
                Some(deadline) if deadline <= now => {
                    self.deadline = None;
                    return Poll::Ready(Ok(now));
                }
                Some(deadline) if self.armed.is_none() => self.arm(deadline)?,
                Some(_) | None => {}
            }
        }
    }

    /// Waits this long.
    pub(crate) async fn sleep(&mut self, span: Micros) -> io::Result<()> {
        self.set(Some(self.now() + span))?;
        poll_fn(|cx| self.poll(cx)).await.map(drop)
    }
}

/// The result of a future, or none if it takes longer than this.
pub(crate) async fn within<T>(
    limit: Micros,
    work: impl Future<Output = T>,
) -> io::Result<Option<T>> {
    let mut alarm = Alarm::new()?;
    alarm.set(Some(alarm.now() + limit))?;
    let mut work = pin!(work);
    poll_fn(|cx| match work.as_mut().poll(cx) {
        Poll::Ready(value) => Poll::Ready(Ok(Some(value))),
        Poll::Pending => alarm.poll(cx).map(|end| end.map(|_| None)),
    })
    .await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_alarm_is_never_early_and_not_a_millisecond_late() {
        let mut alarm = Alarm::new().unwrap();
        let mut lateness = Vec::new();
        for _ in 0..50 {
            let at = alarm.now() + Micros(1750);
            alarm.set(Some(at)).unwrap();
            let fired = poll_fn(|cx| alarm.poll(cx)).await.unwrap();
            assert!(fired >= at);
            lateness.push(fired.since(at));
        }
        lateness.sort();
        // The worst of the better ones, because other programs may keep the processor busy.
        assert!(lateness[5] < Micros(1000), "{lateness:?}");
    }

    #[tokio::test]
    async fn a_deadline_replaces_the_one_before() {
        let mut alarm = Alarm::new().unwrap();
        let start = alarm.now();
        alarm.set(Some(start + Micros::from_millis(5))).unwrap();
        alarm.set(Some(start + Micros::from_secs(60))).unwrap();
        alarm.set(Some(start + Micros::from_millis(20))).unwrap();
        let fired = poll_fn(|cx| alarm.poll(cx)).await.unwrap();
        assert!(fired >= start + Micros::from_millis(20));
        assert!(fired < start + Micros::from_secs(30));
        alarm.set(Some(start)).unwrap();
        let fired = poll_fn(|cx| alarm.poll(cx)).await.unwrap();
        assert!(fired >= start);
    }
}
