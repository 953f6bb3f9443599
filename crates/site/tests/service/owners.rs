//! Who owns an output, where several want it at once: a pulse or lease and another command, in
//! every order and at many distances. The judge is the board: of the writes that it carried out,
//! the last that was no end says what becomes of the relay. A pulse or lease writes one relay, who
//! comes between writes two, so that the board can tell them apart.

use crate::board::{self, Boards, Write, k};
use crate::safety::{Dice, config, folder, known};
use railbus_site::config::Place;
use railbus_site::{
    BatchDone, BatchTerms, By, CommandError, GroupState, LeaseTerms, Pulse, Service, ToggleTerms,
    Within, WriteTerms,
};
use railbus_wire::Micros;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinSet;

/// What is given to the output and ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timed {
    Pulse,
    /// Released first and pulled in after it.
    Inverted,
    Lease,
    /// Two pulses, one after the other.
    Twice,
    /// The caller goes away in the middle of it.
    Forsaken,
}

/// What comes between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rival {
    Write(bool),
    /// The module says no.
    Refused(bool),
    /// Another module says no, and all is taken back.
    TakenBack(bool),
    Group(bool),
    Scene,
    /// Nobody waits for its end.
    Forsaken(bool),
    EndLease,
    /// The holder says again that it holds the output.
    Renew,
    Toggle,
    Close,
}

const TIMED: [Timed; 5] = [
    Timed::Pulse,
    Timed::Inverted,
    Timed::Lease,
    Timed::Twice,
    Timed::Forsaken,
];
const RIVALS: [Rival; 15] = [
    Rival::Write(false),
    Rival::Write(true),
    Rival::Refused(false),
    Rival::Refused(true),
    Rival::TakenBack(false),
    Rival::TakenBack(true),
    Rival::Group(false),
    Rival::Group(true),
    Rival::Scene,
    Rival::Forsaken(false),
    Rival::Forsaken(true),
    Rival::EndLease,
    Rival::Renew,
    Rival::Toggle,
    Rival::Close,
];

const GROUPS: &str = "[group.both]\nmembers = [\"oven.k1\", \"oven.k2\"]\n[scene.both]\n\
    steps = [{ set = \"oven.k1\", to = false }, { set = \"oven.k2\", to = false }]\n";
const WIDTH: Micros = Micros::from_millis(60);

/// One case: what is done, and at which distance.
#[derive(Clone, Copy, Debug)]
struct Case {
    timed: Timed,
    rival: Rival,
    /// How much later the rival comes; where it is negative, so much earlier.
    after_us: i64,
    latency_ms: u8,
    is_kept: bool,
}

async fn timed(service: Service, timed: Timed) {
    let pulse = Pulse {
        width: Some(WIDTH),
        by: By::Host,
        off: timed == Timed::Inverted,
        confirm: false,
        within: Within::DEFAULT,
    };
    match timed {
        Timed::Lease => {
            let held = (true, Micros::from_millis(200));
            let _ = service
                .lease("oven", k(1), held, LeaseTerms::default())
                .await;
        }
        Timed::Twice => {
            let (first, second) = tokio::join!(
                service.pulse("oven", k(1), pulse),
                service.pulse("oven", k(1), pulse)
            );
            let _ = (first, second);
        }
        Timed::Forsaken => {
            let given = service.pulse("oven", k(1), pulse);
            let _ = tokio::time::timeout(Duration::from_millis(1), given).await;
        }
        Timed::Pulse | Timed::Inverted => {
            let _ = service.pulse("oven", k(1), pulse).await;
        }
    }
}

/// Does what comes between; says whether it was taken back.
async fn rival(service: Service, boards: Arc<Boards>, rival: Rival) -> bool {
    let both = |on| [(k(1), on), (k(2), on)];
    let terms = WriteTerms::default();
    match rival {
        Rival::Write(on) => {
            let _ = service.write("oven", &both(on), terms).await;
        }
        Rival::Refused(on) => {
            boards.refuse_together(1);
            // On a busy machine the refused frame may have been a second try.
            let _ = service.write("oven", &both(on), terms).await;
        }
        Rival::TakenBack(on) => {
            let oven = [1, 2].map(|number| (Place::new("oven", k(number)), on));
            let set = [&oven[..], &[(Place::new("yard", k(1)), true)]].concat();
            let terms = BatchTerms {
                all_or_nothing: true,
                ..BatchTerms::default()
            };
            boards.mute(4, true);
            let done = service.batch(&set, terms).await.unwrap();
            boards.mute(4, false);
            let mut ends = done.parts.iter().take(2);
            return ends.all(|part| part.end == Err(CommandError::Undone));
        }
        Rival::Group(on) => {
            let done = service.set_group("both", GroupState::Set(on), BatchTerms::default());
            let _: Result<BatchDone, CommandError> = done.await;
        }
        Rival::Scene => {
            let _ = service.play("both", BatchTerms::default()).await;
        }
        Rival::Forsaken(on) => {
            let written = both(on);
            let writing = service.write("oven", &written, terms);
            let _ = tokio::time::timeout(Duration::from_millis(1), writing).await;
        }
        Rival::EndLease => {
            let _ = service.end_lease("oven", k(1)).await;
        }
        Rival::Renew => {
            for _ in 0..4 {
                let held = (true, Micros::from_millis(200));
                let _ = service
                    .lease("oven", k(1), held, LeaseTerms::default())
                    .await;
                tokio::time::sleep(Duration::from_millis(40)).await;
            }
        }
        Rival::Toggle => {
            let _ = service.toggle("oven", k(2), ToggleTerms::default()).await;
        }
        Rival::Close => service.close().await,
    }
    false
}

/// What the board is to show in the end by what it was told, and nobody told it else.
fn judged(case: Case, writes: &[Write], is_undone: bool) -> bool {
    let (mut is_on, mut owed) = (case.timed == Timed::Inverted, None);
    let begins = case.timed != Timed::Inverted;
    for write in writes.iter().filter(|w| w.address == 3 && w.mask & 1 == 1) {
        let on = write.on & 1 == 1;
        let by_rival = write.function == 15 && !is_undone;
        match (write.function, by_rival) {
            (_, true) => (is_on, owed) = (on, None),
            // Taken back: what it was before holds, and how that is to end.
            (15, false) => {}
            _ if on == begins => owed = Some(!on),
            _ => (is_on, owed) = (on, None),
        }
    }
    owed.unwrap_or(is_on)
}

/// Comes back when everything that was asked of the output before has ended. It is refused,
/// since the last relay is never on.
async fn fence(service: &Service) {
    let terms = WriteTerms {
        only_if: Some(true),
        ..WriteTerms::default()
    };
    let both = [(k(1), true), (k(8), true)];
    let refused = service.write("oven", &both, terms).await;
    assert!(refused.is_err(), "{refused:?}");
}

/// Plays a case; says what was not so.
async fn play(case: Case, number: usize) -> Result<(), String> {
    let (port, boards) = board::start().await;
    let text = config(&port, GROUPS);
    let state = case.is_kept.then(|| folder(&format!("owners-{number}")));
    let service = match &state {
        Some(folder) => Service::start_in(text, folder),
        None => Service::start(text),
    };
    let service = service.unwrap();
    known(&service).await;
    if case.timed == Timed::Inverted {
        let on = [(k(1), true)];
        let done = service.write("oven", &on, WriteTerms::default()).await;
        done.unwrap();
    }
    boards.slow(case.latency_ms);
    let offset = Duration::from_micros(case.after_us.unsigned_abs());
    let (first, second) = match case.after_us < 0 {
        true => (offset, Duration::ZERO),
        false => (Duration::ZERO, offset),
    };
    let before = boards.writes().len();
    let ((), is_undone) = tokio::join!(
        async {
            tokio::time::sleep(first).await;
            timed(service.clone(), case.timed).await;
        },
        async {
            tokio::time::sleep(second).await;
            rival(service.clone(), Arc::clone(&boards), case.rival).await
        }
    );
    // Whose caller has gone may have to wait yet.
    fence(&service).await;
    let ended = tokio::time::timeout(Duration::from_secs(20), service.pulses_ended());
    let ended = ended.await.is_ok();
    fence(&service).await;
    let writes = boards.writes().split_off(before);
    let (is_on, should) = (boards.relays(3) & 1 == 1, judged(case, &writes, is_undone));
    let left = service.point("oven", k(1)).unwrap().left;
    service.close().await;
    if let Some(folder) = state {
        let _ = std::fs::remove_dir_all(folder);
    }
    let never_ends = left.pulse.is_some() || left.lease.is_some();
    match ended && is_on == should && !never_ends {
        true => Ok(()),
        false => Err(format!(
            "{case:?}: on {is_on}, should be {should}, all ended {ended}, {left:?}, {writes:?}"
        )),
    }
}

/// Many cases side by side.
async fn failures(cases: impl Iterator<Item = Case>) -> (usize, Vec<String>) {
    let (mut playing, mut wrong, mut count) = (JoinSet::new(), Vec::new(), 0);
    for case in cases {
        if playing.len() >= 24 {
            let end: Result<Result<(), String>, _> = playing.join_next().await.unwrap();
            wrong.extend(end.unwrap().err());
        }
        playing.spawn(play(case, count));
        count += 1;
    }
    while let Some(end) = playing.join_next().await {
        wrong.extend(end.unwrap().err());
    }
    (count, wrong)
}

#[tokio::test]
async fn an_output_ends_as_its_last_owner_wanted_and_every_pulse_ends() {
    let mut dice = Dice(20_251_122);
    let pairs = TIMED
        .into_iter()
        .flat_map(|timed| RIVALS.map(|rival| (timed, rival)));
    let pairs = pairs.filter(|(timed, rival)| {
        // A renewal asks for the output once more: it is told from the pulse by nothing.
        let held = matches!(rival, Rival::Renew | Rival::EndLease);
        !held || *timed == Timed::Lease
    });
    let cases = pairs.flat_map(|(timed, rival)| {
        [-1_500, 0, 300, 1_000, 2_500, 5_500].map(|after_us| Case {
            timed,
            rival,
            after_us: after_us + dice.below(500) as i64,
            latency_ms: dice.below(8) as u8,
            is_kept: dice.below(2) == 0,
        })
    });
    let (count, wrong) = failures(cases.collect::<Vec<_>>().into_iter()).await;
    assert!(
        wrong.is_empty(),
        "{} of {count}:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}
