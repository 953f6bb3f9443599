//! A site that is opened for one command.

use super::{AdHoc, Options};
use railbus_api::control::{BatchAnswer, GroupInfo, GroupRequest, SceneInfo, SceneRequest};
use railbus_api::problem::{Problem, codes};
use railbus_api::sending::{SendAnswer, SendRequest};
use railbus_api::types::{
    LineInfo, ModuleInfo, OutputsRequest, OutputsWritten, PointInfo, PulseRequest, Pulsed,
    ToggleRequest, WatchEvent, WriteRequest, Written,
};
use railbus_app::api::sending;
use railbus_app::api::watching::Watching;
use railbus_app::api::{ask, control, failures};
use railbus_app::config_file;
use railbus_bus::{EchoMode, Plan};
use railbus_device::{Layout, Setup};
use railbus_host::{LineState, Tap};
use railbus_site::config::{LineConfig, ModuleConfig, Name, Range};
use railbus_site::paths;
use railbus_site::{Config, Service};
use railbus_wire::{Address, Baud, Character, Instant, SerialSettings};
use railbus_words::Lang;
use std::collections::BTreeMap;

/// The name of a line that is described by flags.
const AD_HOC_LINE: &str = "line";

/// A site that is opened for one command.
#[derive(Debug)]
pub(crate) struct Local {
    service: Service,
    polls: bool,
}

/// What happens on it.
#[derive(Debug)]
pub(crate) struct Watch(Watching);

impl Watch {
    pub(super) async fn next(&mut self) -> Option<WatchEvent> {
        self.0.next().await
    }
}

impl Local {
    /// Opens the site of the flags, or of a configuration. A port that can't be opened is not an
    /// error here: what is asked of its line fails.
    pub(super) async fn open(options: &Options) -> Result<Local, Problem> {
        let config = match &options.ad_hoc {
            Some(ad_hoc) => described(ad_hoc)?,
            None => config_file::read(options.lang, options.config.as_deref())?.config,
        };
        let lines: Vec<String> = config.lines.keys().cloned().collect();
        let service = if options.polls {
            Service::start(config)
        } else {
            Service::start_quiet(config)
        };
        let service = service
            .map_err(|why| Problem::new(codes::BAD_REQUEST).with("reason", why.to_string()))?;
        for line in lines {
            // Whether it could be opened is checked below, where it matters.
            let _ = service.opened(&line).await;
        }
        Ok(Local {
            service,
            polls: options.polls,
        })
    }

    /// The lines that have a port, and their traffic.
    pub(super) async fn taps(&self) -> Vec<(LineInfo, Instant, Tap)> {
        let mut taps = Vec::new();
        for line in ask::lines(&self.service) {
            if let Ok((now, tap)) = self.service.tap(&line.line).await {
                taps.push((line, now, tap));
            }
        }
        taps
    }

    pub(super) async fn lines(&self) -> Result<Vec<LineInfo>, Problem> {
        Ok(ask::lines(&self.service))
    }

    pub(super) async fn modules(&self) -> Result<Vec<ModuleInfo>, Problem> {
        Ok(match self.polls {
            true => ask::modules(&self.service),
            false => ask::fresh_modules(&self.service).await,
        })
    }

    pub(super) async fn points(
        &self,
        selectors: &[String],
        _fresh: bool,
    ) -> Result<Vec<PointInfo>, Problem> {
        for selector in selectors {
            self.check(selector)?;
        }
        ask::fresh_points(&self.service, selectors).await
    }

    pub(super) fn known(&self, selectors: &[String]) -> Vec<PointInfo> {
        ask::points(&self.service, selectors)
    }

    pub(super) async fn write(&self, path: &str, wanted: WriteRequest) -> Result<Written, Problem> {
        self.read_before(path).await?;
        ask::write(&self.service, path, wanted).await
    }

    pub(super) async fn outputs(
        &self,
        module: &str,
        wanted: OutputsRequest,
    ) -> Result<OutputsWritten, Problem> {
        self.read_before(module).await?;
        ask::outputs(&self.service, module, wanted).await
    }

    pub(super) async fn groups(&self) -> Result<Vec<GroupInfo>, Problem> {
        Ok(control::groups(&self.service))
    }

    pub(super) async fn set_group(
        &self,
        group: &str,
        wanted: GroupRequest,
    ) -> Result<BatchAnswer, Problem> {
        let members = control::members(&self.service, group)?;
        self.read_all_before(members).await;
        control::set_group(&self.service, group, wanted).await
    }

    pub(super) async fn scenes(&self) -> Result<Vec<SceneInfo>, Problem> {
        Ok(control::scenes(&self.service))
    }

    pub(super) async fn play(
        &self,
        scene: &str,
        wanted: SceneRequest,
    ) -> Result<BatchAnswer, Problem> {
        let outputs = control::outputs_of_scene(&self.service, scene)?;
        self.read_all_before(outputs).await;
        control::play(&self.service, scene, wanted).await
    }

    pub(super) async fn toggle(
        &self,
        path: &str,
        wanted: ToggleRequest,
    ) -> Result<Written, Problem> {
        ask::toggle(&self.service, path, wanted).await
    }

    pub(super) async fn pulse(&self, path: &str, wanted: PulseRequest) -> Result<Pulsed, Problem> {
        ask::pulse(&self.service, path, wanted).await
    }

    pub(super) async fn send_frame(
        &self,
        line: &str,
        wanted: SendRequest,
    ) -> Result<SendAnswer, Problem> {
        let plan = sending::plan(&self.service, Lang::En, line, &wanted)?;
        sending::check_meant(&plan, &wanted)?;
        sending::carry_out(&self.service, Lang::En, plan).await
    }

    pub(super) async fn watch(&self, selectors: &[String]) -> Result<Watch, Problem> {
        for selector in selectors {
            self.check(selector)?;
        }
        Ok(Watch(Watching::new(self.service.clone(), selectors)))
    }

    pub(super) async fn finish(self, now: bool) {
        if !now {
            self.service.pulses_ended().await;
        }
        self.service.close().await;
    }

    /// Why a line has no port.
    pub(super) fn line_closed(&self, line: &str) -> Problem {
        failures::line_closed(&self.service, line)
    }

    /// Refuses a selector whose module or point does not exist.
    fn check(&self, selector: &str) -> Result<(), Problem> {
        ask::check_selector(&self.service, selector)
    }

    /// Reads the outputs of a module before they are switched: of one that was opened just now,
    /// nothing is known yet. A read that fails does not matter.
    async fn read_before(&self, path: &str) -> Result<(), Problem> {
        let module = paths::split(path).map_or(path, |(module, _)| module);
        let line = self.service.module(module).map(|status| status.line);
        let status = line.as_deref().and_then(|line| self.service.line(line));
        if let Some(status) = status
            && status.state != LineState::Up
        {
            return Err(failures::line_closed(&self.service, &status.name));
        }
        let _ = self.service.read_fresh(module).await;
        Ok(())
    }

    /// The same for several outputs.
    async fn read_all_before(&self, mut paths: Vec<String>) {
        let module = |path: &String| paths::split(path).map(|(module, _)| module.to_owned());
        paths.sort();
        paths.dedup_by_key(|path| module(path));
        for path in paths {
            // A line that is not open fails only the commands for its own outputs.
            let _ = self.read_before(&path).await;
        }
    }
}

/// The configuration that the flags describe.
pub(crate) fn described(ad_hoc: &AdHoc) -> Result<Config, Problem> {
    let wrong = |reason: String| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    let baud = match ad_hoc.baud {
        None => Baud::B9600,
        Some(rate) => {
            Baud::from_rate(rate).ok_or_else(|| wrong(format!("no such speed: {rate}")))?
        }
    };
    let serial = SerialSettings {
        baud,
        character: ad_hoc.format.unwrap_or(Character::N1),
    };
    let mut config = Config::default();
    let line = LineConfig {
        port: ad_hoc.port.clone(),
        serial,
        echo: EchoMode::Auto,
        name: Name::default(),
    };
    config.lines.insert(AD_HOC_LINE.to_owned(), line);
    if let Some(module) = &ad_hoc.module {
        let factory = Setup::new(module.family, Address(module.address));
        let layout = module.layout.unwrap_or(factory.layout);
        let (outputs, inputs) = match layout {
            Layout::Inputs => (0, 32),
            Layout::Mixed => (16, 16),
            Layout::Outputs => (factory.outputs, factory.inputs),
        };
        let setup = Setup {
            protocol: module.protocol.unwrap_or(factory.protocol),
            serial,
            checksum: module.checksum,
            outputs: module.outputs.unwrap_or(outputs),
            inputs: module.inputs.unwrap_or(inputs),
            layout,
            ..factory
        };
        setup.check().map_err(|why| wrong(why.to_string()))?;
        let described = ModuleConfig {
            line: AD_HOC_LINE.to_owned(),
            setup,
            plan: Plan::default(),
            range: Range::volts(),
            points: BTreeMap::new(),
            settings: railbus_commission::settings::Wanted::default(),
            name: Name::default(),
            area: None,
        };
        config.modules.insert(module.name.clone(), described);
    }
    Ok(config)
}
