//! Decides what to send next.

use super::ask::{PATIENCE, ProbeKind, ScanProbe};
use super::case::{Case, Turn};
use super::identify;
use super::likely::Likely;
use super::{
    FoundModule, LeftOut, ProbeOutcome, ScanCounts, ScanPosition, ScanProgress, ScanStep, Scope,
};
use railbus_bus::LateReply;
use railbus_bus::Probed;
use railbus_wire::{Address, Frame, Instant, Micros, SerialSettings, r55};
use std::collections::{HashSet, VecDeque};

/// How long a reply to a request may still arrive.
const LATE_MAX: Micros = Micros::from_millis(600);
/// After this many late replies the scan waits as long as the slowest of them took.
const LATE_MANY: usize = 3;

/// After this many corrupted replies in a row, to requests for different modules, the line counts
/// as never silent.
const NOISE: usize = 8;

/// Why a request is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Why {
    /// First pass.
    First,
    /// A module is there, or something was received. The number is that of the case.
    Case(usize),
    /// A module may be there, but slow.
    Again,
    /// To listen for late replies to the requests before it.
    Closing,
    /// To find a lone 0x55 board.
    Boards,
    /// No module was found; one is likely here, and may be slow.
    Likely,
    /// Identification of a module that was found. The number is that of the module.
    Describe(usize),
}

/// A scan.
#[derive(Clone, Debug)]
pub struct Scanner {
    scope: Scope,
    /// Configured modules, then those with factory settings.
    early: VecDeque<(ScanProbe, Micros)>,
    asked_early: HashSet<ScanProbe>,
    place: ScanPosition,
    /// Current speed and format of the line.
    at: Option<SerialSettings>,
    current: Option<(ScanProbe, Why)>,
    /// The last frame sent.
    last: Frame,
    cases: Vec<Case>,
    /// Requests to which a late reply may still arrive, oldest first.
    recent: VecDeque<(Instant, ScanProbe)>,
    /// Requests to slow modules.
    again: VecDeque<ScanProbe>,
    /// Those that were retried: once is enough.
    asked_again: HashSet<ScanProbe>,
    /// An unanswered request to be repeated at the end.
    unanswered: Option<ScanProbe>,
    /// Late replies still have to be listened for before the end.
    owes_closing: bool,
    /// Requests that were answered twice, by modules still under inspection.
    twice: Vec<ScanProbe>,
    looks_beyond: bool,
    /// The requests that are retried with a long timeout if no module is found.
    likely: Likely,
    /// The first module found replied only to a retry or a long timeout: the others may be as slow.
    waits: bool,
    crowd: bool,
    /// Number of consecutive requests with corrupted replies.
    spoilt: usize,
    late_count: usize,
    slowest: Micros,
    news: VecDeque<usize>,
    found: Vec<FoundModule>,
    counts: ScanCounts,
    done: usize,
    total: usize,
    cost_done: Micros,
    cost_left: Micros,
    /// Duration of the first requests that `cost_done` estimated.
    spent: Micros,
    asked_at: Instant,
}

impl Scanner {
    /// A new scan.
    #[must_use]
    pub fn new(scope: Scope) -> Scanner {
        let known = scope.known.iter().map(|known| waited_for(known.question()));
        let factory = scope
            .factory()
            .map(|asked| (asked, asked.silence(scope.silence)));
        let early = known.chain(factory).collect();
        Scanner::start(scope, early, ScanPosition::default(), Vec::new())
    }

    /// A resumed scan: from a position, with these requests first, and with what was found before.
    #[must_use]
    pub fn resume(
        scope: Scope,
        place: ScanPosition,
        first: &[ScanProbe],
        found: Vec<FoundModule>,
    ) -> Scanner {
        let early = first.iter().map(|asked| waited_for(*asked)).collect();
        Scanner::start(scope, early, place, found)
    }

    fn start(
        scope: Scope,
        early: VecDeque<(ScanProbe, Micros)>,
        place: ScanPosition,
        found: Vec<FoundModule>,
    ) -> Scanner {
        let mut scanner = Scanner {
            looks_beyond: scope.beyond,
            scope,
            early,
            asked_early: HashSet::new(),
            place,
            at: None,
            current: None,
            last: Frame::new(),
            cases: Vec::new(),
            recent: VecDeque::new(),
            again: VecDeque::new(),
            asked_again: HashSet::new(),
            unanswered: None,
            owes_closing: false,
            twice: Vec::new(),
            likely: Likely::default(),
            waits: false,
            crowd: false,
            spoilt: 0,
            late_count: 0,
            slowest: Micros::ZERO,
            news: VecDeque::new(),
            found: Vec::new(),
            counts: ScanCounts::default(),
            done: 0,
            total: 0,
            cost_done: Micros::ZERO,
            cost_left: Micros::ZERO,
            spent: Micros::ZERO,
            asked_at: Instant(0),
        };
        for found in found {
            scanner.add(found);
        }
        scanner.news.clear();
        if scanner.found.is_empty() && scanner.scope.silence < PATIENCE {
            let early = scanner.early.iter().map(|(question, _)| *question);
            let plan = early.chain(scanner.rest());
            scanner.likely = Likely::of(&scanner.scope, &scanner.early, plan);
        }
        scanner.count_what_is_left();
        scanner
    }

    /// The modules found so far, in the order of discovery.
    #[must_use]
    pub fn found(&self) -> &[FoundModule] {
        &self.found
    }

    /// Statistics so far.
    #[must_use]
    pub const fn counts(&self) -> ScanCounts {
        self.counts
    }

    /// Several 0x55 boards answered where only one was expected: some of them have addresses
    /// outside the scope.
    #[must_use]
    pub const fn is_crowded(&self) -> bool {
        self.crowd
    }

    /// Modules were found only by a long timeout, and not all addresses got one: other slow modules
    /// may have been missed.
    #[must_use]
    pub fn is_slow(&self) -> bool {
        self.place.slow && !self.found.is_empty() && self.scope.few().is_none()
    }

    /// The scan was aborted because the line is never silent.
    #[must_use]
    pub const fn is_noisy(&self) -> bool {
        self.spoilt >= NOISE
    }

    /// The configured modules that were tried and not found.
    pub fn missing(&self) -> impl Iterator<Item = &str> {
        let asked = |question: &ScanProbe| self.asked_early.contains(question);
        let found = |question: &ScanProbe| self.found.iter().any(|f| f.answers_to(question));
        let known = self.scope.known.iter();
        let missing = known.filter(move |known| {
            let question = known.question();
            asked(&question) && !found(&question)
        });
        missing.map(|known| known.name.as_str())
    }

    /// Progress. The remaining time is computed in bytes, and corrected by the time taken so far.
    #[must_use]
    pub fn progress(&self) -> ScanProgress {
        let long_enough = self.cost_done >= Micros::from_millis(500);
        let left = match long_enough {
            true => Micros(self.cost_left.0.saturating_mul(self.spent.0) / self.cost_done.0.max(1)),
            false => self.cost_left,
        };
        ScanProgress {
            done: self.done,
            total: self.total,
            left,
        }
    }

    /// Where to resume if the scan is stopped now, and which request to repeat first then.
    #[must_use]
    pub fn place(&self) -> (ScanPosition, Vec<ScanProbe>) {
        let current = self.current.iter();
        // As long as no module was found, all likely ones get a long timeout anyway.
        let current = current.filter(|(_, why)| match why {
            Why::First | Why::Again => true,
            Why::Likely => self.waits,
            _ => false,
        });
        let current = current.map(|(question, _)| *question);
        let cases = self.cases.iter().map(|case| case.asked);
        let early = self.early.iter().map(|(question, _)| *question);
        let again = self.again.iter().copied();
        let likely = self.likely.questions().filter(|_| self.waits);
        let early = early.chain(again).chain(likely);
        let mut first: Vec<ScanProbe> = current.chain(cases).chain(early).collect();
        first.retain(|question| !self.knows(question));
        (self.place, first)
    }

    /// What remains untried if the scan is stopped now.
    #[must_use]
    pub fn left_out(&self) -> Vec<LeftOut> {
        let runs = self.scope.runs.iter().enumerate().skip(self.place.run);
        let rest = runs.map(|(index, run)| {
            let from = if index == self.place.run {
                self.place.asked
            } else {
                0
            };
            LeftOut {
                settings: run.settings,
                ask: run.ask,
                addresses: run.addresses.get(from..).unwrap_or_default().to_vec(),
            }
        });
        rest.filter(|rest| !rest.addresses.is_empty()).collect()
    }

    /// The next action.
    pub fn next(&mut self, now: Instant) -> ScanStep {
        loop {
            if self.is_noisy() {
                // A module known only by corrupted bytes does not count.
                self.found.retain(|found| !found.answers.is_empty());
                return ScanStep::Done;
            }
            if let Some(news) = self.news.pop_front() {
                return ScanStep::Found(news);
            }
            let Some((question, patience, why)) = self.choose(now) else {
                return ScanStep::Done;
            };
            let safe = question.safe(self.last.bytes());
            let probe = safe.and_then(|question| {
                let patience = match why {
                    Why::First => question.begins_within(patience),
                    _ => patience,
                };
                Some((question, question.probe(patience)?))
            });
            let Some((question, probe)) = probe else {
                self.pass_over(question, why);
                continue;
            };
            self.last = question.frame().unwrap_or_default();
            self.at = Some(question.settings);
            self.current = Some((question, why));
            self.counts.probes += 1;
            self.asked_at = now;
            return ScanStep::Ask(probe);
        }
    }

    /// A request must not be sent now. One that is a problem only after the previous frame is sent
    /// later.
    fn pass_over(&mut self, question: ScanProbe, why: Why) {
        if matches!(why, Why::First | Why::Likely) && question.safe(&[]).is_some() {
            return self.ask_again(vec![question]);
        }
        self.counts.skipped += 1;
        if let Why::Describe(index) = why {
            self.meet_description(index, question, Vec::new());
        }
        if let Why::Case(index) = why {
            let turn = self.cases.remove(index).unasked();
            self.turn(Some(turn));
        }
    }

    /// The result of the request.
    pub fn met(&mut self, now: Instant, met: ProbeOutcome) {
        let Some((question, why)) = self.current.take() else {
            return;
        };
        while self
            .recent
            .front()
            .is_some_and(|(at, _)| now.since(*at) > LATE_MAX)
        {
            self.recent.pop_front();
        }
        for late in &met.late {
            self.hear_late(late);
        }
        if matches!(why, Why::First | Why::Likely) {
            self.spent += now.since(self.asked_at);
        }
        if why == Why::First && met.outcome == Probed::Silent {
            self.counts.silent += 1;
            self.unanswered.get_or_insert(question);
        }
        if matches!(why, Why::First | Why::Again | Why::Likely) {
            let spoilt = met.outcome == Probed::Garbled;
            self.spoilt = if spoilt { self.spoilt + 1 } else { 0 };
        }
        if self.heard_by_waiting(why, question, &met) {
            self.waits = true;
            self.place.slow |= self.is_late(question, &met);
        }
        self.owes_closing |= matches!(why, Why::First | Why::Again);
        let turn = match (why, met.outcome) {
            (Why::Case(index), _) => Some(self.cases.remove(index).met(now, met)),
            (Why::Boards, outcome) => {
                self.meet_boards(question, outcome, &met.bytes);
                None
            }
            (Why::Describe(index), outcome) => {
                let answered = outcome == Probed::Answered;
                let bytes = if answered { met.bytes } else { Vec::new() };
                self.meet_description(index, question, bytes);
                None
            }
            (_, Probed::Answered | Probed::Garbled) => {
                let suspects = self.recent.iter().map(|(_, question)| *question);
                Some(Case::open(now, question, met, suspects))
            }
            (_, Probed::Unsafe) => {
                self.counts.skipped += 1;
                None
            }
            (_, Probed::Silent) => None,
        };
        self.recent.push_back((now, question));
        self.turn(turn);
    }

    /// Whether the first module was found now, and only by a retry or a longer timeout than others
    /// get.
    fn heard_by_waiting(&self, why: Why, question: ScanProbe, met: &ProbeOutcome) -> bool {
        if !self.found.is_empty() || self.scope.silence >= PATIENCE {
            return false;
        }
        match (why, met.outcome) {
            (Why::Closing, Probed::Answered) => true,
            (Why::Likely, Probed::Answered | Probed::Garbled) => true,
            (Why::Boards, Probed::Answered) => self.is_late(question, met),
            // The request that resumes a scan gets a long timeout. So do configured modules, but
            // always: that says nothing about the others.
            (Why::First, Probed::Answered | Probed::Garbled) => {
                let mut known = self.scope.known.iter();
                self.asked_early.contains(&question)
                    && !known.any(|known| known.question() == question)
                    && self.is_late(question, met)
            }
            _ => false,
        }
    }

    /// Whether the reply began only after the scan's timeout. A first request waits for less, so
    /// that the whole reply is there by then; a module that misses that by little is not slow.
    fn is_late(&self, question: ScanProbe, met: &ProbeOutcome) -> bool {
        met.after > question.silence(self.scope.silence)
    }

    fn turn(&mut self, turn: Option<Turn>) {
        match turn {
            None => {}
            Some(Turn::Open(case)) => self.cases.push(case),
            Some(Turn::Found(found, suspects)) => {
                self.ask_again(suspects);
                self.add(found);
            }
            Some(Turn::Nobody(suspects)) => self.ask_again(suspects),
        }
    }

    /// The next request, its timeout, and its reason.
    fn choose(&mut self, now: Instant) -> Option<(ScanProbe, Micros, Why)> {
        let mut cases = self.cases.iter().enumerate();
        if let Some((index, case)) = cases.find(|(_, case)| case.ready_at <= now) {
            return Some((case.question(), case.patience(), Why::Case(index)));
        }
        let first = self.peek_first();
        if let Some((question, patience)) = first
            && self.at.is_none_or(|at| at == question.settings)
        {
            self.take_first(question);
            return Some((question, self.waits(patience), Why::First));
        }
        // Before the speed changes, and before the end, everything pending is completed.
        if let Some(question) = self.take_again() {
            return Some((question, PATIENCE, Why::Again));
        }
        if let Some(question) = self.unanswered
            && std::mem::take(&mut self.owes_closing)
        {
            return Some((question, PATIENCE, Why::Closing));
        }
        let earliest = self.cases.iter().enumerate();
        if let Some((index, case)) = earliest.min_by_key(|(_, case)| case.ready_at) {
            return Some((case.question(), case.patience(), Why::Case(index)));
        }
        if let Some(question) = self.take_boards() {
            return Some((question, PATIENCE, Why::Boards));
        }
        let Some((question, patience)) = first else {
            let likely = self.take_likely();
            return likely.or_else(|| self.take_description());
        };
        self.unanswered = None;
        self.owes_closing = false;
        self.take_first(question);
        Some((question, self.waits(patience), Why::First))
    }

    /// The timeout on a line with many slow modules.
    fn waits(&self, patience: Micros) -> Micros {
        match self.late_count >= LATE_MANY {
            true => patience.max(self.slowest).min(PATIENCE),
            false => patience,
        }
    }

    /// The next first request, without taking it; those that are not needed are skipped.
    fn peek_first(&mut self) -> Option<(ScanProbe, Micros)> {
        while let Some((question, patience)) = self.early.front().copied() {
            if !self.needs_no_asking(&question) {
                return Some((question, patience));
            }
            self.take_first(question);
        }
        loop {
            let run = self.scope.runs.get(self.place.run)?;
            match run.question(self.place.asked) {
                Some(question) if self.needs_no_asking(&question) => self.take_first(question),
                Some(question) => return Some((question, question.silence(self.scope.silence))),
                None => {
                    self.place.run += 1;
                    self.place.asked = 0;
                }
            }
        }
    }

    fn needs_no_asking(&self, question: &ScanProbe) -> bool {
        let asked = self.asked_early.contains(question);
        asked || self.knows(question) || self.cases.iter().any(|case| is_same(case, question))
    }

    fn knows(&self, question: &ScanProbe) -> bool {
        self.found.iter().any(|found| found.answers_to(question))
    }

    /// Takes the request that [`Scanner::peek_first`] returned.
    fn take_first(&mut self, question: ScanProbe) {
        self.done += 1;
        if self.early.pop_front().is_some() {
            self.asked_early.insert(question);
            return;
        }
        self.place.asked += 1;
        self.account(question.cost(question.silence(self.scope.silence)));
    }

    fn account(&mut self, cost: Micros) {
        self.cost_done += cost;
        self.cost_left = self.cost_left - cost;
    }

    /// The next address that may be slow, unless it has answered meanwhile.
    fn take_again(&mut self) -> Option<ScanProbe> {
        while let Some(question) = self.again.pop_front() {
            if !self.knows(&question) && !self.cases.iter().any(|case| is_same(case, &question)) {
                return Some(question);
            }
        }
        None
    }

    /// If at most one 0x55 board was found, it is asked for its address, whatever that is.
    fn take_boards(&mut self) -> Option<ScanProbe> {
        if !self.looks_beyond || self.at.is_some_and(|at| at != SerialSettings::FACTORY) {
            return None;
        }
        self.looks_beyond = false;
        let boards = self
            .found
            .iter()
            .filter(|found| found.asked.ask == ProbeKind::R55State);
        (boards.count() <= 1).then_some(ScanProbe {
            settings: SerialSettings::FACTORY,
            ask: ProbeKind::R55Address,
            address: r55::BROADCAST,
        })
    }

    /// If no module was found, or only by a long timeout, the next retry.
    fn take_likely(&mut self) -> Option<(ScanProbe, Micros, Why)> {
        while let Some(question) = self.likely.take() {
            self.done += 1;
            self.account(question.cost(PATIENCE));
            if !self.knows(&question) {
                return Some((question, PATIENCE, Why::Likely));
            }
        }
        None
    }

    /// A module was found without: the retries are dropped.
    fn drop_likely(&mut self) {
        self.total -= self.likely.len();
        self.cost_left = self.cost_left - self.likely.cost();
        self.likely = Likely::default();
    }

    /// The first requests of the remaining runs.
    fn rest(&self) -> impl Iterator<Item = ScanProbe> {
        let ScanPosition { run, asked, .. } = self.place;
        let runs = self.scope.runs.iter().enumerate().skip(run);
        runs.flat_map(move |(index, of)| {
            let from = if index == run { asked } else { 0 };
            (from..of.addresses.len()).filter_map(|place| of.question(place))
        })
    }

    fn meet_boards(&mut self, question: ScanProbe, outcome: Probed, bytes: &[u8]) {
        match outcome {
            Probed::Answered => {
                let board = identify::board(question, bytes);
                let state =
                    board.map(|address| at_address(question.with(ProbeKind::R55State), address));
                self.ask_again(state.into_iter().collect());
            }
            Probed::Garbled => self.crowd = true,
            Probed::Silent | Probed::Unsafe => {}
        }
    }

    /// After all were found, identification of those that support it.
    fn take_description(&self) -> Option<(ScanProbe, Micros, Why)> {
        let mut found = self.found.iter().enumerate();
        found.find_map(|(index, found)| {
            let (question, patience) = found.to_describe().filter(|_| self.scope.describes)?;
            Some((question, patience, Why::Describe(index)))
        })
    }

    fn meet_description(&mut self, index: usize, question: ScanProbe, bytes: Vec<u8>) {
        let mut found = self.found.get_mut(index);
        if found
            .as_mut()
            .is_some_and(|found| found.described(question.ask, bytes))
        {
            self.news.push_back(index);
        }
    }

    fn hear_late(&mut self, late: &LateReply) {
        let recent = self.recent.iter().map(|(_, question)| *question);
        let mut recent = recent.filter(|question| question.exchange() == Some(late.exchange));
        let Some(question) = recent.next_back() else {
            return;
        };
        if late.again {
            let twice = |(_, found): &(usize, &mut FoundModule)| found.answers_to(&question);
            let mut found = self.found.iter_mut().enumerate();
            match found.find(twice) {
                Some((index, found)) if !found.twice => {
                    found.twice = true;
                    self.news.push_back(index);
                }
                Some(_) => {}
                None => self.twice.push(question),
            }
            return;
        }
        self.late_count += 1;
        self.slowest = self.slowest.max(late.after);
        self.ask_again(vec![question]);
    }

    /// These are repeated once, with a long timeout.
    fn ask_again(&mut self, questions: Vec<ScanProbe>) {
        for question in questions {
            if self.asked_again.insert(question) {
                self.again.push_back(question);
            }
        }
    }

    fn add(&mut self, mut found: FoundModule) {
        if self
            .found
            .iter()
            .any(|known| known.answers_to(&found.asked))
        {
            return;
        }
        let mut known = self.scope.known.iter();
        if let Some(known) = known.find(|known| found.answers_to(&known.question())) {
            found.known = Some(known.name.clone());
            found.differs = found.rules_out(known.family)
                || found.checksum().is_some_and(|is| is != known.checksum);
        }
        found.twice |= self.twice.iter().any(|question| found.answers_to(question));
        self.news.push_back(self.found.len());
        self.found.push(found);
        if !self.waits {
            self.drop_likely();
        }
    }

    fn count_what_is_left(&mut self) {
        let rest: Vec<ScanProbe> = self.rest().collect();
        self.total = self.early.len() + rest.len() + self.likely.len();
        self.cost_left = self.likely.cost();
        if self.looks_beyond {
            self.cost_left += PATIENCE;
        }
        let mut settings = None;
        for question in rest {
            if settings.replace(question.settings) != Some(question.settings) {
                self.cost_left += PATIENCE;
            }
            self.cost_left += question.cost(question.silence(self.scope.silence));
        }
    }
}

/// A first request with the longest timeout.
fn waited_for(question: ScanProbe) -> (ScanProbe, Micros) {
    (question, question.shows_after(PATIENCE))
}

fn is_same(case: &Case, question: &ScanProbe) -> bool {
    case.asked.settings == question.settings
        && case.asked.address == question.address
        && case.asked.ask.protocol() == question.ask.protocol()
}

const fn at_address(question: ScanProbe, address: Address) -> ScanProbe {
    ScanProbe {
        address,
        ..question
    }
}
