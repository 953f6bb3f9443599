//! What happens at the site, and what of it is told.

use super::super::device::{Device, wall};
use super::super::payload::Metric;
use super::connection::Phase;
use super::own::answering;
use super::{Node, Now};
use railbus_device::Point;
use railbus_host::Presence;
use railbus_site::{Batch, ModuleStatus, Picture, PointStatus};
use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

impl Node {
    pub(super) fn picture(&mut self, now: Now, picture: &Picture) {
        let was_online = self.online();
        self.saw(picture.at);
        // Changes before it may have been missed.
        self.live_anew();
        let mut gone: BTreeSet<String> = self.devices.keys().cloned().collect();
        let mut points: BTreeMap<&str, BTreeSet<Point>> = BTreeMap::new();
        for module in &picture.modules {
            if self.setup.topics.has(&module.name) {
                gone.remove(&module.name);
                points.insert(&module.name, BTreeSet::new());
                self.devices.entry(module.name.clone()).or_default();
            }
        }
        let mut changed = BTreeMap::new();
        for status in &picture.points {
            if let Some(points) = points.get_mut(&*status.module) {
                points.insert(status.point);
                self.point(now, status, picture.at, &mut changed);
            }
        }
        for (name, its) in points {
            if let Some(device) = self.devices.get_mut(name) {
                device.keep(|point| its.contains(&point));
            }
        }
        for name in gone {
            self.bury(&name);
            self.devices.remove(&name);
            if let Some(backlog) = &mut self.backlog {
                backlog.forget(&name);
            }
        }
        self.modules(&picture.modules);
        self.tell(now, changed, was_online, true);
        self.all_queued(now);
    }

    pub(super) fn batch(&mut self, now: Now, batch: &Batch) {
        let was_online = self.online();
        let (mut changed, mut untold) = (BTreeMap::new(), BTreeSet::new());
        let mut has_skipped = false;
        for reading in &batch.points {
            self.saw(reading.at);
            let (module, point) = (&reading.status.module, reading.status.point);
            let device = self.devices.get(module);
            if device.is_some_and(|device| device.born.is_none()) {
                // A birth tells the last one of several only.
                has_skipped |= !untold.insert((module, point));
            }
            self.point(now, &reading.status, reading.at, &mut changed);
        }
        self.modules(&batch.modules);
        // With their line, modules come and go by their figures.
        self.modules(&batch.figures);
        self.tell(now, changed, was_online, false);
        if has_skipped {
            self.live_anew();
        }
        self.all_queued(now);
    }

    /// What happened until now may not all have been told live.
    fn live_anew(&mut self) {
        if self.is_born()
            && let Some(backlog) = &mut self.backlog
        {
            backlog.live_from(self.seen + 1);
        }
    }

    pub(super) fn is_born(&self) -> bool {
        let phase = self.link.as_ref().map(|link| link.phase);
        phase == Some(Phase::Born)
    }

    /// A change of this time is known.
    fn saw(&mut self, at: SystemTime) {
        let at = wall(at);
        if at == self.seen {
            // What was told of this millisecond is not all of it.
            let before = at.saturating_sub(1);
            if let Some(backlog) = &mut self.backlog {
                backlog.cap(before);
            }
            if let Some(link) = &mut self.link {
                link.seen = link.seen.min(before);
                let marks = link.marks.iter_mut();
                marks.for_each(|(_, seen)| *seen = (*seen).min(before));
                let queue = link.queue.iter_mut();
                queue.for_each(|queued| queued.seen = queued.seen.min(before));
            }
        }
        if at < self.seen {
            if let Some(backlog) = &mut self.backlog {
                backlog.set_back(at);
            }
            if let Some(link) = &mut self.link {
                link.marks.clear();
                link.seen = at.saturating_sub(1);
                link.queue.iter_mut().for_each(|queued| queued.seen = 0);
            }
            self.devices.values_mut().for_each(Device::set_back);
        }
        self.seen = at;
    }

    /// Everything that is known is in the messages that wait, or in those before them.
    fn all_queued(&mut self, now: Now) {
        let Some(link) = &mut self.link else {
            return;
        };
        let is_new = link.seen < self.seen;
        link.seen = self.seen;
        if !link.queue.is_empty() || link.phase != Phase::Born {
            return;
        }
        link.mark(self.seen);
        // Nothing more goes out that could be asked for.
        if is_new && link.arrived == link.handed {
            let last = link.arrived;
            self.arrived(now, last);
        }
    }

    /// A point is like this. A device that lives tells each change, also of several at once.
    fn point(
        &mut self,
        now: Now,
        status: &PointStatus,
        at: SystemTime,
        changed: &mut BTreeMap<String, Vec<Metric>>,
    ) {
        let Some(device) = self.devices.get_mut(&status.module) else {
            return;
        };
        let is_new = device.point(status, at);
        if is_new && device.born.is_some() {
            let metric = device.metric(status.point, now.wall);
            let its = changed.entry(status.module.clone()).or_default();
            its.extend(metric);
        }
    }

    fn modules(&mut self, modules: &[ModuleStatus]) {
        for module in modules {
            if let Some(device) = self.devices.get_mut(&module.name) {
                device.is_online = module.presence == Presence::Online;
            }
        }
    }

    pub(super) fn online(&self) -> usize {
        let online = self.devices.values().filter(|device| device.is_online);
        online.count()
    }

    /// Tells what has changed: births, deaths, and data of those that live. What a module is
    /// changes with a picture only.
    fn tell(
        &mut self,
        now: Now,
        mut changed: BTreeMap<String, Vec<Metric>>,
        was_online: usize,
        is_picture: bool,
    ) {
        let Some(link) = self.link.as_mut().filter(|link| link.phase == Phase::Born) else {
            return;
        };
        let (topics, rights) = (&self.setup.topics, &self.setup.rights);
        let mut has_births = false;
        for (name, device) in &mut self.devices {
            let is_other = |born: &Vec<_>| is_picture && *born != device.definitions(rights);
            let is_other = device.born.as_ref().is_some_and(is_other);
            let is_born = device.born.is_some();
            // Before its death, what it told last.
            if is_born
                && !is_other
                && let Some(metrics) = changed.remove(name)
            {
                link.push(topics.device("DDATA", name), metrics, false);
            }
            if is_born && (!device.is_online || is_other) {
                device.unborn();
                link.push(topics.device("DDEATH", name), Vec::new(), false);
            }
            if device.is_online && device.born.is_none() {
                let metrics = device.birth(rights, now.wall);
                link.push(topics.device("DBIRTH", name), metrics, true);
                has_births = true;
            }
        }
        if has_births && let Some(backlog) = &mut self.backlog {
            backlog.born();
        }
        let online = self.online();
        if online != was_online {
            self.tell_node([answering(online, now)]);
        }
        self.shorten(now);
    }

    /// A device is no more.
    fn bury(&mut self, name: &str) {
        let topic = self.setup.topics.device("DDEATH", name);
        if let Some(device) = self.devices.get_mut(name)
            && device.born.is_some()
            && let Some(link) = &mut self.link
        {
            device.unborn();
            link.push(topic, Vec::new(), false);
        }
    }
}
