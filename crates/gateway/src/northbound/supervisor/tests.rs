use super::*;
use crate::northbound::kind::{TABLE, Work};
use crate::northbound::outlet::Outlet;
use railbus_site::Events;
use serde_json::json;

fn never(_: Outlet, _: Events) -> Work<Result<(), Problem>> {
    Box::pin(std::future::pending())
}

fn none(_: Outlet) -> Work<Result<String, Problem>> {
    Box::pin(std::future::pending())
}

static RESTARTED: OutletKind = OutletKind::new("a", ([""; 2], [""; 2]), &[], never, none);
static HANDED_OVER: OutletKind = OutletKind {
    on_change: OnChange::HandOver,
    ..OutletKind::new("b", ([""; 2], [""; 2]), &[], never, none)
};

/// A supervisor in virtual time.
struct Stage {
    supervisor: Supervisor,
    seconds: u64,
}

fn id(kind: &'static OutletKind, name: &str) -> OutletId {
    OutletId {
        kind: kind.name,
        name: name.to_owned(),
    }
}

fn error(code: &str) -> OutletError {
    OutletError {
        at: String::new(),
        tries: 1,
        problem: Problem {
            code: code.to_owned(),
            ..Problem::new(codes::INTERNAL)
        },
    }
}

impl Stage {
    fn new() -> Stage {
        Stage {
            supervisor: Supervisor::default(),
            seconds: 0,
        }
    }

    fn now(&self) -> Moment {
        Moment {
            at: Duration::from_secs(self.seconds),
            wall: Timestamp::from_second(1_000 + self.seconds as i64).unwrap(),
        }
    }

    /// What the supervisor says, in short: `start 1 x`, `stop 1`, `outlet_fails x`.
    fn said(&mut self) -> Vec<String> {
        let mut said = Vec::new();
        let now = self.now();
        while let Some(output) = self.supervisor.poll(now) {
            said.push(match output {
                Output::Start(run, id) => format!("start {} {}", run.0, id.name),
                Output::Settings(run, settings) => format!("settings {} {}", run.0, settings["v"]),
                Output::Stop(run) => format!("stop {}", run.0),
                Output::Tell(event) => {
                    let text = event.text.map(|text| format!(" {text}"));
                    let (code, text) = (event.code.unwrap(), text.unwrap_or_default());
                    format!("{code} {}{text}", event.what.unwrap())
                }
            });
        }
        said
    }

    fn input(&mut self, input: Input) -> Vec<String> {
        let now = self.now();
        self.supervisor.handle(now, input);
        self.said()
    }

    /// These outlets, each with a value of its settings; a negative one is disabled.
    fn config(&mut self, outlets: &[(&'static OutletKind, &str, i64)]) -> Vec<String> {
        let each = outlets.iter().map(|(kind, name, value)| {
            let settings = json!({ "v": value });
            let config = OutletConfig {
                kind,
                settings: settings.as_object().unwrap().clone(),
                is_enabled: *value >= 0,
            };
            (id(kind, name), config)
        });
        let wanted = each.collect();
        self.input(Input::Config(wanted))
    }

    /// Waits for the deadline, which comes after so many seconds.
    fn wait(&mut self, seconds: u64) -> Vec<String> {
        self.seconds += seconds - 1;
        assert_eq!(self.said(), [""; 0], "not earlier");
        self.seconds += 1;
        let at = self.supervisor.deadline();
        assert_eq!(at, Some(Duration::from_secs(self.seconds)));
        self.said()
    }

    fn ended(&mut self, run: u64) -> Vec<String> {
        self.input(Input::Ended(RunId(run), error("E1").problem))
    }

    fn state(&self, id: &OutletId) -> OutletState {
        self.supervisor.find(id).unwrap().state()
    }
}

const NOTHING: [&str; 0] = [];

#[test]
fn what_changed_is_restarted_and_nothing_else() {
    let mut stage = Stage::new();
    let (a, b) = (&RESTARTED, &HANDED_OVER);
    assert_eq!(
        stage.config(&[(a, "x", 1), (a, "y", 1), (b, "z", 1), (a, "off", -1)]),
        ["start 1 x", "start 2 y", "start 3 z"]
    );
    for run in 1..=3 {
        assert_eq!(stage.input(Input::Ready(RunId(run))), NOTHING);
    }
    let same = [(a, "x", 1), (a, "y", 1), (b, "z", 1), (a, "off", -1)];
    assert_eq!(stage.config(&same), NOTHING, "nothing changed");
    let other = [(a, "x", 2), (a, "y", 1), (b, "z", 2), (a, "off", 1)];
    assert_eq!(
        stage.config(&other),
        ["start 4 off", "stop 1", "settings 3 2"]
    );
    let x = stage.supervisor.find(&id(a, "x")).unwrap();
    x.counts().queue.store(3, Relaxed);
    assert_eq!(stage.state(&id(a, "x")), OutletState::Stopped);
    assert_eq!(stage.ended(1), ["start 5 x"], "once it has stopped");
    let x = stage.supervisor.find(&id(a, "x")).unwrap();
    assert_eq!(x.counts().queue.load(Relaxed), 0, "nothing waits any more");
    // Disabled, gone, and another one under the same name while it stops.
    let less = [(a, "x", -2), (b, "z", 2), (a, "off", 1)];
    assert_eq!(stage.config(&less), ["stop 5", "stop 2"]);
    assert_eq!(
        stage.config(&[(a, "y", 7), (a, "x", 2)]),
        ["stop 4", "stop 3"]
    );
    assert_eq!(stage.ended(2), ["start 6 y"]);
    assert_eq!(stage.ended(5), ["start 7 x"]);
    assert_eq!([stage.ended(4), stage.ended(3)], [NOTHING; 2]);
    assert_eq!(
        stage.supervisor.outlets.len(),
        2,
        "those that are gone are forgotten"
    );
}

#[test]
fn one_that_ends_is_started_again_after_longer_and_longer() {
    let mut stage = Stage::new();
    let x = id(&RESTARTED, "x");
    assert_eq!(stage.config(&[(&RESTARTED, "x", 1)]), ["start 1 x"]);
    let mut run = 1;
    for (failure, wait) in [1, 2, 4, 8, 16, 32, 60, 60].into_iter().enumerate() {
        assert_eq!(stage.input(Input::Ready(RunId(run))), NOTHING);
        // A run that is over is not heard any more.
        assert_eq!(stage.ended(run - 1), NOTHING);
        let told: &[&str] = if failure == 2 {
            &["outlet_fails x E1"]
        } else {
            &[]
        };
        assert_eq!(
            stage.ended(run),
            told,
            "an event at the third failure, and no other"
        );
        assert_eq!(stage.state(&x), OutletState::Waiting);
        let retry = stage.supervisor.find(&x).unwrap().retry_at();
        assert_eq!(retry, Some(Duration::from_secs(stage.seconds + wait)));
        run += 1;
        assert_eq!(stage.wait(wait), [format!("start {run} x")]);
    }
    assert_eq!(stage.input(Input::Ready(RunId(run))), NOTHING);
    assert_eq!(stage.state(&x), OutletState::Running);
    assert_eq!(
        stage.wait(60),
        ["outlet_works x"],
        "it has run for a minute"
    );
    assert_eq!(stage.ended(run), NOTHING);
    assert_eq!(stage.wait(1), [format!("start {} x", run + 1)]);
}

#[test]
fn a_new_configuration_is_tried_at_once() {
    let mut stage = Stage::new();
    stage.config(&[(&RESTARTED, "x", 1)]);
    for run in 1..=4 {
        stage.ended(run);
        let wait = stage.supervisor.deadline().unwrap().as_secs() - stage.seconds;
        stage.wait(wait);
    }
    stage.ended(5);
    assert_eq!(stage.config(&[(&RESTARTED, "x", 2)]), ["start 6 x"]);
    assert_eq!(stage.ended(6), NOTHING);
    assert_eq!(stage.wait(1), ["start 7 x"]);
    assert_eq!(stage.config(&[]), ["stop 7"]);
    assert!(stage.supervisor.find(&id(&RESTARTED, "x")).is_none());
}

#[test]
fn what_it_does_may_fail_while_it_runs() {
    let mut stage = Stage::new();
    let z = id(&HANDED_OVER, "z");
    stage.config(&[(&HANDED_OVER, "z", 1)]);
    stage.input(Input::Ready(RunId(1)));
    let failed = |wait| Input::Failed(RunId(1), error("E2"), wait);
    let wait = Some(Duration::from_secs(4));
    assert_eq!(stage.input(failed(wait)), NOTHING);
    assert_eq!(stage.state(&z), OutletState::Waiting);
    let found = stage.supervisor.find(&z).unwrap();
    assert_eq!(found.retry_at(), wait);
    assert_eq!(
        found.error().map(|error| error.problem.code.as_str()),
        Some("E2")
    );
    assert_eq!(stage.input(failed(wait)), NOTHING);
    assert_eq!(stage.input(failed(wait)), ["outlet_fails z E2"]);
    assert_eq!(stage.input(failed(wait)), NOTHING);
    assert_eq!(stage.input(Input::Worked(RunId(1))), ["outlet_works z"]);
    assert_eq!(stage.state(&z), OutletState::Running);
    assert_eq!(
        stage.input(failed(None)),
        ["outlet_fails z E2"],
        "it is not tried again"
    );
    assert_eq!(stage.config(&[(&HANDED_OVER, "z", 2)]), ["settings 1 2"]);
}

#[test]
fn one_that_does_not_stop_is_left_alone() {
    let mut stage = Stage::new();
    assert_eq!(stage.config(&[(&RESTARTED, "x", 0)]), ["start 1 x"]);
    for run in 1..=STUCK_MAX as u64 {
        let value = run as i64;
        assert_eq!(
            stage.config(&[(&RESTARTED, "x", value)]),
            [format!("stop {run}")]
        );
        let said = stage.wait(STOP_MAX.as_secs());
        match run < STUCK_MAX as u64 {
            true => assert_eq!(said, [format!("start {} x", run + 1)]),
            false => assert_eq!(said, NOTHING, "too many are left alone"),
        }
    }
    let found = stage.supervisor.find(&id(&RESTARTED, "x")).unwrap();
    let code = found.error().map(|error| error.problem.code.as_str());
    assert_eq!(code, Some(codes::OUTLET_STUCK.code));
    // One of them ends after all.
    assert_eq!(stage.ended(3), NOTHING);
    assert_eq!(stage.wait(1), ["start 9 x"]);
}

#[test]
fn at_the_end_all_are_stopped_and_none_is_started() {
    let mut stage = Stage::new();
    stage.config(&[(&RESTARTED, "x", 1), (&RESTARTED, "y", 1)]);
    stage.ended(2);
    assert_eq!(stage.input(Input::Close), ["stop 1"]);
    assert!(!stage.supervisor.is_idle());
    assert_eq!(stage.ended(1), NOTHING);
    assert!(stage.supervisor.is_idle());
    stage.seconds += 100;
    assert_eq!(stage.said(), NOTHING);
    assert_eq!(RESTARTED.table, TABLE);
}

/// A client that was turned away is told of without an event, unless there is something worse.
#[test]
fn what_is_noted_changes_nothing_but_the_last_error() {
    let mut stage = Stage::new();
    let x = id(&RESTARTED, "x");
    stage.config(&[(&RESTARTED, "x", 1)]);
    stage.input(Input::Ready(RunId(1)));
    let noted = || Input::Noted(RunId(1), error("E3"));
    let code = |stage: &Stage| {
        let found = stage.supervisor.find(&x).unwrap();
        found.error().map(|error| error.problem.code.clone())
    };
    for _ in 0..5 {
        assert_eq!(stage.input(noted()), NOTHING);
    }
    assert_eq!(stage.state(&x), OutletState::Running);
    assert_eq!(code(&stage).as_deref(), Some("E3"));
    let wait = Some(Duration::from_secs(4));
    stage.input(Input::Failed(RunId(1), error("E2"), wait));
    stage.input(noted());
    assert_eq!(stage.state(&x), OutletState::Waiting);
    assert_eq!(code(&stage).as_deref(), Some("E2"));
}
