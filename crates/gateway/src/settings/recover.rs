//! Searches for a module as an operation: one whose change was interrupted, or that is not where it
//! should be. It only reads; where the module is found, the configuration is updated.

use super::drive::{Run, journal, on_loan, open};
use super::settings_request::SettingsRequest;
use railbus_api::ops::{OpBegun, OpInfo};
use railbus_api::problem::Problem;
use railbus_api::settings::SettingsRun;
use railbus_app::settings::log::{not_found, parting};
use railbus_app::settings::outcome::{self, placed};
use railbus_app::settings::target::Target;
use railbus_commission::{
    BusAddress, Found, JournalRecord, ProcedureError, RecordState, Recovered, Search,
};
use railbus_commission::{look_up, recover};

/// A search in progress.
struct Work {
    wish: SettingsRequest,
    target: Target,
    who: String,
    /// The last record of a change without a known end.
    open: Option<JournalRecord>,
    run: Run,
}

/// The result in one word, and the module.
type Traced = (&'static str, Option<Found>);

/// Starts it.
pub(super) async fn begin(wish: SettingsRequest, who: String) -> Result<OpBegun, Problem> {
    let target = wish.target()?;
    let store = journal(&wish).await?;
    let mut records = store.log().open().into_iter();
    let record = records.find(|record| record.module == target.name).cloned();
    let run = SettingsRun {
        module: wish.module.clone(),
        change: record.as_ref().map_or(0, |record| record.change),
        stage: "looking".to_owned(),
        ..SettingsRun::default()
    };
    let lines = vec![target.line.clone()];
    let op = wish.site.ops.begin(OpInfo {
        settings: Some(run),
        ..wish.site.ops.begins_now("recovery", lines, who.clone())
    })?;
    let begun = OpBegun { op: op.info().op };
    let run = Run::new(&wish, op, store);
    let work = Work {
        wish,
        target,
        who,
        open: record,
        run,
    };
    tokio::spawn(work.run());
    Ok(begun)
}

impl Work {
    async fn run(mut self) {
        let (site, service) = (self.wish.site.clone(), self.wish.service.clone());
        let op = self.run.op.clone();
        let line = self.target.line.clone();
        let end = on_loan((&site, &op), &service, &line, self.on_line()).await;
        self.run.end(end);
    }

    async fn on_line(&mut self) -> Result<(), Problem> {
        let lang = self.wish.lang;
        let end = self.search().await?;
        let failed =
            |trouble: ProcedureError| outcome::trouble(lang, &self.target, &trouble).to_problem();
        let (word, found) = end.map_err(failed)?;
        let place = found.map(|found| placed(lang, found.place));
        let way = (word == "two").then(|| parting(&self.target.setup).0);
        self.run.op.tell(|info| {
            if let Some(run) = &mut info.settings {
                run.end = Some(word.to_owned());
                run.looking = None;
                run.place = place;
                run.parting = way.map(str::to_owned);
            }
        });
        let Some(found) = found else {
            return Err(not_found(lang, &self.target, word == "two").to_problem());
        };
        let change = self.open.as_ref().map(|record| record.change);
        let last = change.and_then(|change| self.run.journal.last(change));
        let last = last.filter(|last| last.state == RecordState::Done);
        let who = self.who.clone();
        self.run.follow(&self.wish, &who, found.place, last).await
    }

    /// Looks where it should be, then further out. Other modules are not mistaken for it.
    async fn search(&mut self) -> Result<Result<Traced, ProcedureError>, Problem> {
        let target = &self.target;
        let same = |other: &&railbus_commission::Neighbour| other.protocol == target.setup.protocol;
        let others = target.neighbours.iter().filter(same);
        let others: Vec<BusAddress> = others.map(|other| other.place).collect();
        let mut talk = open(target).await?;
        let here = BusAddress::of(&target.setup);
        if let Some(record) = self.open.clone() {
            let log = self.run.journal.log();
            let earlier = log.map(|log| log.places(record.change)).unwrap_or_default();
            let work = recover(record, earlier, target.setup, true, others);
            let end = self.run.procedure(&mut talk, work).await;
            return Ok(end.map(traced));
        }
        let known = self
            .run
            .journal
            .log()
            .and_then(|log| log.unfiled(&target.name));
        let search = Search {
            setup: target.setup,
            first: [here].into_iter().chain(known).collect(),
            outwards: true,
            others,
        };
        let end = self.run.procedure(&mut talk, look_up(search)).await;
        Ok(end.map(|(found, garbled)| match found {
            Some(found) if found.place == here => ("in_place", Some(found)),
            Some(found) => ("moved", Some(found)),
            None if garbled => ("two", None),
            None => ("lost", None),
        }))
    }
}

const fn traced(end: Recovered) -> Traced {
    match end {
        Recovered::New(found) => ("done", Some(found)),
        Recovered::Old(found) => ("unchanged", Some(found)),
        Recovered::Pending(found) => ("pending", Some(found)),
        Recovered::Else(found) => ("elsewhere", Some(found)),
        Recovered::Untold(found) => ("untold", Some(found)),
        Recovered::Nowhere(true) => ("two", None),
        Recovered::Nowhere(false) => ("lost", None),
    }
}
