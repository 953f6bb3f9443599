mod play;

use super::*;
use crate::message::ApiAnswer;

const S: fn(u64) -> Duration = Duration::from_secs;

fn intent(path: &str, token: u8) -> CommandIntent {
    CommandIntent {
        method: "PUT".to_owned(),
        path: path.to_owned(),
        body: b"{\"value\":true}".to_vec(),
        user: "li".to_owned(),
        boot: vec![1; 16],
        valid_until_ms: 5_000,
        token: vec![token],
        ..CommandIntent::default()
    }
}

fn said(outcome: CommandOutcome) -> Vec<u8> {
    let answer = Some(outcome);
    CommandAnswer { answer }.encode_to_vec()
}

fn done() -> Vec<u8> {
    said(CommandOutcome::Ended(ApiAnswer {
        status: 200,
        body: b"{\"value\":true}".to_vec(),
        ..ApiAnswer::default()
    }))
}

const NAME: CommandName<'_> = ("p1", "c1");

/// A centre that is connected.
struct Hub(Ledger, Duration, u64);

impl Hub {
    fn new() -> Hub {
        let mut hub = Hub(Ledger::default(), S(100), 0);
        hub.handle(LedgerInput::Connected);
        hub
    }

    fn handle(&mut self, input: LedgerInput<'_>) {
        self.0.handle(self.1, input);
    }

    fn outputs(&mut self) -> Vec<LedgerOutput> {
        let outputs: Vec<_> = std::iter::from_fn(|| self.0.poll(self.1)).collect();
        for output in &outputs {
            if let LedgerOutput::Store { number, .. }
            | LedgerOutput::Read(number, ..)
            | LedgerOutput::Send(number, ..) = output
            {
                self.2 = *number;
            }
        }
        outputs
    }

    /// The result of what is under way.
    fn stored(&mut self, end: StoreEnd) {
        self.handle(LedgerInput::Stored(NAME, self.2, end));
    }

    fn read(&mut self, found: Option<(&[u8], u64)>) {
        self.handle(LedgerInput::Read(NAME, self.2, Some(found)));
    }

    fn said(&mut self, said: SiteSaid<'_>) {
        self.handle(LedgerInput::Said(NAME, self.2, said));
    }

    fn given(&mut self, caller: u64, wanted: CommandIntent) -> Vec<LedgerOutput> {
        self.handle(LedgerInput::Given(caller, NAME, wanted, S(20)));
        self.outputs()
    }

    /// It is stored and sent.
    fn sent(&mut self) {
        assert!(is_store(&self.given(1, intent("/x", 1)), 0));
        self.stored(StoreEnd::Stored(7));
        let sent = self.outputs();
        assert!(matches!(&sent[..], [LedgerOutput::Send(_, site, request)]
            if site == "p1" && request.id == "c1" && !request.tell));
    }

    /// It waits, and asks its site for the result.
    fn asks(&mut self, wait: Duration) {
        self.1 += wait;
        let asked = self.outputs();
        assert!(
            matches!(&asked[..], [LedgerOutput::Send(_, _, request)] if request.tell),
            "{asked:?}"
        );
    }
}

fn is_store(outputs: &[LedgerOutput], after: u64) -> bool {
    matches!(outputs, [LedgerOutput::Store { after: found, .. }] if *found == after)
}

fn told(outputs: &[LedgerOutput]) -> Option<&CommandTold> {
    match outputs {
        [LedgerOutput::Tell(1, told)] => Some(told),
        _ => None,
    }
}

fn result(told: Option<&CommandTold>) -> Option<&CommandResult> {
    match told {
        Some(CommandTold::End(end)) => end.end.as_ref(),
        _ => None,
    }
}

#[test]
fn a_command_is_written_down_then_sent_then_its_end_is_written_down() {
    let mut hub = Hub::new();
    hub.sent();
    let stored = record(CommandKind::Intent(intent("/x", 1)));
    hub.handle(LedgerInput::Record(NAME, &stored, 7, S(0)));
    assert_eq!(hub.outputs(), []);
    hub.said(SiteSaid::Answer(&done()));
    assert!(is_store(&hub.outputs(), 7));
    hub.stored(StoreEnd::Stored(8));
    let outputs = hub.outputs();
    let end = result(told(&outputs));
    assert!(matches!(end, Some(CommandResult::Ended(answer)) if answer.status == 200));
    assert_eq!(hub.0.open(), 0);
    let recent: Vec<_> = hub.0.recent().collect();
    assert!(matches!(&recent[..], [one] if one.end.as_ref().unwrap().how == "answered"));
}

#[test]
fn what_could_not_be_written_down_is_not_sent() {
    for end in [Some(StoreEnd::Unknown), None] {
        let mut hub = Hub::new();
        hub.given(1, intent("/x", 1));
        match end {
            Some(end) => hub.stored(end),
            None => hub.handle(LedgerInput::Lost),
        }
        let outputs = hub.outputs();
        assert_eq!(told(&outputs), Some(&CommandTold::NotStored));
        // It was stored after all: it ends, and still is not sent.
        let late = record(CommandKind::Intent(intent("/x", 1)));
        hub.handle(LedgerInput::Record(NAME, &late, 7, S(0)));
        hub.handle(LedgerInput::Connected);
        assert!(is_store(&hub.outputs(), 7));
    }
}

/// The same id may stand for the command of another centre, which was sent.
#[test]
fn the_command_of_another_centre_is_not_ended_as_one_that_was_not_sent() {
    let mut hub = Hub::new();
    hub.given(1, intent("/x", 1));
    hub.stored(StoreEnd::Unknown);
    hub.outputs();
    let theirs = record(CommandKind::Intent(intent("/x", 2)));
    hub.handle(LedgerInput::Record(NAME, &theirs, 7, S(0)));
    assert_eq!(hub.outputs(), []);
}

#[test]
fn a_command_that_was_not_delivered_ends_as_never() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::NotDelivered);
    hub.outputs();
    hub.stored(StoreEnd::Stored(8));
    let outputs = hub.outputs();
    let end = result(told(&outputs));
    assert!(matches!(end, Some(CommandResult::Never(why)) if why.code == "E0168"));
}

#[test]
fn without_an_answer_the_site_is_asked_for_the_result() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Nothing);
    assert_eq!(hub.outputs(), []);
    hub.asks(ASK);
    // It was delivered once, perhaps: that it is not now says nothing.
    hub.said(SiteSaid::NotDelivered);
    assert_eq!(hub.outputs(), []);
    hub.asks(ASK * 2);
    let later = said(CommandOutcome::Later(FleetRefusal::default()));
    hub.said(SiteSaid::Answer(&later));
    hub.asks(ASK * 4);
    // Meanwhile the caller hears that it is not known.
    hub.said(SiteSaid::Answer(&[255]));
    hub.1 += ASK * 8 - Duration::from_millis(1);
    let outputs = hub.outputs();
    assert_eq!(told(&outputs), Some(&CommandTold::Waiting));
    hub.asks(Duration::from_millis(1));
    let lost = said(CommandOutcome::Lost(refusal("E0169", "a restart")));
    hub.said(SiteSaid::Answer(&lost));
    assert!(is_store(&hub.outputs(), 7));
}

#[test]
fn a_day_later_it_is_not_known_for_ever() {
    let mut hub = Hub::new();
    let other = record(CommandKind::Intent(intent("/x", 2)));
    hub.handle(LedgerInput::Record(NAME, &other, 7, S(0)));
    hub.asks(TAKEN_OVER);
    hub.1 += KNOWN - TAKEN_OVER - Duration::from_millis(1);
    assert_eq!(hub.outputs(), []);
    hub.1 += Duration::from_millis(1);
    let outputs = hub.outputs();
    let [
        LedgerOutput::Store {
            payload, after: 7, ..
        },
    ] = &outputs[..]
    else {
        panic!("{outputs:?}");
    };
    let record = CommandRecord::decode(&**payload).unwrap().record;
    let Some(CommandKind::End(end)) = record else {
        panic!("{record:?}");
    };
    assert!(matches!(end.end, Some(CommandResult::Unknown(why)) if why.code == "E0169"));
}

/// However often centres are started meanwhile.
#[test]
fn an_old_command_is_asked_for_once() {
    let mut hub = Hub::new();
    let old = record(CommandKind::Intent(intent("/x", 2)));
    hub.handle(LedgerInput::Record(NAME, &old, 7, KNOWN * 3));
    assert_eq!(hub.outputs(), []);
    hub.asks(TAKEN_OVER);
    hub.said(SiteSaid::NotDelivered);
    hub.asks(ASK * 2);
    hub.1 += TAKEN_OVER;
    assert!(is_store(&hub.outputs(), 7));
}

/// Without a heartbeat of its site a command can't begin: nothing is written down.
#[test]
fn what_can_not_begin_is_only_looked_for() {
    let given = |hub: &mut Hub| {
        let wanted = CommandIntent {
            boot: Vec::new(),
            ..intent("/x", 1)
        };
        let read = hub.given(1, wanted);
        assert!(matches!(&read[..], [LedgerOutput::Read(..)]), "{read:?}");
    };
    let mut hub = Hub::new();
    given(&mut hub);
    hub.read(None);
    assert_eq!(told(&hub.outputs()), Some(&CommandTold::Offline));
    assert_eq!(hub.0.open(), 0);
    // An earlier result is returned.
    given(&mut hub);
    let ended = CommandResult::Ended(ApiAnswer::default());
    let first = record(CommandKind::End((*end(&intent("/x", 9), ended, 0)).clone()));
    hub.read(Some((&first, 4)));
    let outputs = hub.outputs();
    assert!(matches!(
        result(told(&outputs)),
        Some(CommandResult::Ended(_))
    ));
    // That it can't be read says nothing.
    given(&mut hub);
    for _ in 0..=READS_MAX {
        hub.handle(LedgerInput::Read(NAME, hub.2, None));
        let outputs = hub.outputs();
        if let Some(told) = told(&outputs) {
            assert_eq!(told, &CommandTold::NotKnown);
        }
        hub.1 += READ_AGAIN;
        hub.outputs();
    }
    assert!(matches!(
        hub.given(2, intent("/x", 1))[..],
        [LedgerOutput::Tell(2, CommandTold::NotKnown)]
    ));
}

/// The stream was lost, and another command took the id.
#[test]
fn an_end_is_not_stored_for_another_command_of_the_same_id() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::NotDelivered);
    hub.outputs();
    hub.stored(StoreEnd::Conflict);
    hub.outputs();
    let other = record(CommandKind::Intent(intent("/x", 2)));
    hub.read(Some((&other, 3)));
    let outputs = hub.outputs();
    assert!(matches!(
        result(told(&outputs)),
        Some(CommandResult::Never(_))
    ));
    hub.asks(TAKEN_OVER);
    // Its own, under another number, or none, gets its end.
    for (found, after) in [(Some(3), 3), (None, 0)] {
        let mut hub = Hub::new();
        hub.sent();
        hub.said(SiteSaid::NotDelivered);
        hub.outputs();
        hub.stored(StoreEnd::Conflict);
        hub.outputs();
        let own = record(CommandKind::Intent(intent("/x", 1)));
        hub.read(found.map(|number| (own.as_slice(), number)));
        hub.1 += STORE_AGAIN;
        assert!(is_store(&hub.outputs(), after));
    }
}

#[test]
fn another_centre_ends_its_own_commands_first() {
    let mut hub = Hub::new();
    let other = record(CommandKind::Intent(intent("/x", 2)));
    hub.handle(LedgerInput::Record(NAME, &other, 7, S(0)));
    hub.1 += TAKEN_OVER - S(1);
    assert_eq!(hub.outputs(), []);
    hub.asks(S(1));
    hub.said(SiteSaid::Answer(&done()));
    assert!(is_store(&hub.outputs(), 7));
    // It was first.
    hub.stored(StoreEnd::Conflict);
    let read = hub.outputs();
    assert!(matches!(&read[..], [LedgerOutput::Read(_, site, id)] if site == "p1" && id == "c1"));
    let lost = CommandResult::Unknown(refusal("E0169", ""));
    let theirs = record(CommandKind::End((*end(&intent("/x", 2), lost, 0)).clone()));
    hub.read(Some((&theirs, 8)));
    assert_eq!((hub.outputs(), hub.0.open()), (Vec::new(), 0));
}

#[test]
fn the_same_command_again_gets_the_first_end() {
    let mut hub = Hub::new();
    hub.given(1, intent("/x", 1));
    hub.stored(StoreEnd::Conflict);
    assert!(matches!(&hub.outputs()[..], [LedgerOutput::Read(..)]));
    let answer = CommandResult::Ended(ApiAnswer::default());
    let first = record(CommandKind::End(
        (*end(&intent("/x", 9), answer, 0)).clone(),
    ));
    hub.read(Some((&first, 4)));
    let outputs = hub.outputs();
    assert!(matches!(
        result(told(&outputs)),
        Some(CommandResult::Ended(_))
    ));
    // And another one is refused.
    hub.given(1, intent("/y", 1));
    hub.stored(StoreEnd::Conflict);
    hub.outputs();
    hub.read(Some((&first, 4)));
    assert_eq!(told(&hub.outputs()), Some(&CommandTold::OtherCommand));
}

/// The result of storing an end comes when the same command was given again already.
#[test]
fn a_late_result_is_not_taken_for_that_of_the_next_one() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Answer(&done()));
    hub.outputs();
    let late = hub.2;
    let ended = CommandResult::Ended(ApiAnswer::default());
    let ended = record(CommandKind::End((*end(&intent("/x", 1), ended, 0)).clone()));
    hub.handle(LedgerInput::Record(NAME, &ended, 8, S(0)));
    hub.outputs();
    assert!(is_store(&hub.given(1, intent("/x", 2)), 0));
    hub.handle(LedgerInput::Stored(NAME, late, StoreEnd::Stored(8)));
    assert_eq!(hub.outputs(), [], "nothing is sent");
}

#[test]
fn an_end_that_can_not_be_stored_is_told_and_stored_again() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Answer(&done()));
    hub.outputs();
    hub.stored(StoreEnd::Unknown);
    let outputs = hub.outputs();
    assert!(result(told(&outputs)).is_some());
    hub.1 += STORE_AGAIN;
    assert!(is_store(&hub.outputs(), 7));
    assert_eq!(hub.0.open(), 1);
}

#[test]
fn so_many_are_open_and_no_more() {
    let mut hub = Hub::new();
    for at in 0..=OF_SITE_MAX {
        let id = format!("c{at}");
        hub.handle(LedgerInput::Given(1, ("p1", &id), intent("/x", 1), S(20)));
        let is_taken = is_store(&hub.outputs(), 0);
        assert_eq!(is_taken, at < OF_SITE_MAX, "{at}");
    }
    // Another site does not suffer from that.
    hub.handle(LedgerInput::Given(1, ("p", "c"), intent("/x", 1), S(20)));
    assert!(is_store(&hub.outputs(), 0));
    hub.1 += S(21);
    hub.outputs();
    let lost = record(CommandKind::Intent(intent("/x", 2)));
    for at in 0..OPEN_MAX {
        let (site, id) = (format!("q{}", at / 100), format!("d{at}"));
        hub.handle(LedgerInput::Record((&site, &id), &lost, 1, S(0)));
    }
    assert_eq!(hub.0.open(), OPEN_MAX);
    // So many are asked at a time, and of each site no more than its share.
    hub.1 += TAKEN_OVER;
    let asked = hub.outputs();
    let mut of_site = BTreeMap::<String, usize>::new();
    let mut numbers = Vec::new();
    for output in &asked {
        if let LedgerOutput::Send(number, site, request) = output {
            assert!(request.tell);
            *of_site.entry(site.clone()).or_default() += 1;
            numbers.push((*number, site.clone(), request.id.clone()));
        }
    }
    assert_eq!(numbers.len(), ASKED_MAX);
    let most = of_site.values().max().copied().unwrap_or_default();
    assert!(most <= ASKED_OF_SITE_MAX, "{of_site:?}");
    let (number, site, id) = numbers.remove(0);
    hub.handle(LedgerInput::Said((&site, &id), number, SiteSaid::Nothing));
    let next = hub.outputs();
    let sent = next.iter();
    let sent = sent.filter(|one| matches!(one, LedgerOutput::Send(..)));
    assert_eq!(sent.count(), 1);
}

/// A record arrives before it is known whether it could be stored.
#[test]
fn what_was_seen_in_the_stream_is_not_forgotten() {
    let mut hub = Hub::new();
    hub.given(1, intent("/x", 1));
    let ours = record(CommandKind::Intent(intent("/x", 1)));
    hub.handle(LedgerInput::Record(NAME, &ours, 7, S(0)));
    hub.stored(StoreEnd::Unknown);
    let outputs = hub.outputs();
    let is_ended = matches!(
        &outputs[..],
        [
            LedgerOutput::Tell(1, CommandTold::NotStored),
            LedgerOutput::Store { after: 7, .. }
        ]
    );
    assert!(is_ended, "{outputs:?}");
    // One of another centre is taken over.
    let mut hub = Hub::new();
    hub.given(1, intent("/x", 1));
    let theirs = record(CommandKind::Intent(intent("/x", 2)));
    hub.handle(LedgerInput::Record(NAME, &theirs, 7, S(0)));
    hub.stored(StoreEnd::Unknown);
    hub.outputs();
    hub.1 += TAKEN_OVER;
    assert_eq!(hub.outputs(), []);
    hub.asks(TAKEN_OVER);
}

#[test]
fn a_site_of_the_version_before_did_nothing() {
    // As it answers whatever it does not know.
    let refused = crate::message::ResendAnswer {
        refusal: Some(refusal("E0110", "")),
    };
    let refused = refused.encode_to_vec();
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Answer(&refused));
    hub.outputs();
    hub.stored(StoreEnd::Stored(8));
    let outputs = hub.outputs();
    let end = result(told(&outputs));
    assert!(matches!(end, Some(CommandResult::Never(why)) if why.code == "E0110"));
    // When it is only asked, it may have known more before.
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Nothing);
    hub.asks(ASK);
    hub.said(SiteSaid::Answer(&refused));
    assert_eq!(hub.outputs(), []);
}

#[test]
fn an_answer_that_is_none_is_not_stored_as_one() {
    let answer = |status, length: usize| {
        said(CommandOutcome::Ended(ApiAnswer {
            status,
            body: vec![b'x'; length],
            ..ApiAnswer::default()
        }))
    };
    for status in [0, 100, 600, 70_000] {
        let mut hub = Hub::new();
        hub.sent();
        hub.said(SiteSaid::Answer(&answer(status, 0)));
        assert_eq!(hub.outputs(), [], "{status}");
    }
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Answer(&answer(200, ANSWER_MAX + 1)));
    hub.outputs();
    hub.stored(StoreEnd::Stored(8));
    let outputs = hub.outputs();
    let end = result(told(&outputs));
    assert!(matches!(end, Some(CommandResult::Unknown(_))));
}

/// The streams are lost: its end can't be stored any more.
#[test]
fn what_can_not_be_stored_at_all_does_not_stay_for_ever() {
    let mut hub = Hub::new();
    hub.sent();
    hub.said(SiteSaid::Answer(&done()));
    hub.outputs();
    for _ in 0..STORES_MAX {
        assert_eq!(hub.0.open(), 1);
        hub.stored(StoreEnd::Unknown);
        hub.1 += STORE_AGAIN;
        hub.outputs();
    }
    assert_eq!(hub.0.open(), 0);
}

#[test]
fn what_is_no_record_is_counted() {
    let mut hub = Hub::new();
    for payload in [&[255_u8][..], &[]] {
        hub.handle(LedgerInput::Record(NAME, payload, 1, S(0)));
    }
    assert_eq!((hub.0.unreadable(), hub.0.open()), (2, 0));
}
