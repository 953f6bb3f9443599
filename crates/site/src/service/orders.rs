//! What is asked of outputs: each call starts a procedure of the core and waits for its end. A
//! procedure gets the name it acts under from [`Service::order`] only, which asks for the rights
//! first: a command that forgets to ask does not compile.

use super::Service;
use crate::config::{Place, Step};
use crate::core::{
    BatchDone, BatchTerms, Context, GroupState, LeaseTerms, Leased, Pulse, PulseDone, ToggleTerms,
    WriteDone, WriteTerms,
};
use crate::rights::Who;
use crate::{CommandError, Config, Rights};
use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::sync::Arc;
use tokio::sync::oneshot;

/// The outputs that a command may switch.
#[derive(Clone, Copy)]
enum Outputs<'a> {
    Point(&'a str, Point),
    Label(&'a str, &'a str),
    OfModule(&'a str, &'a [(Point, bool)]),
    Places(&'a [(Place, bool)]),
    Group(&'a str),
    Scene(&'a str),
}

impl Outputs<'_> {
    /// Whether these rights cover all of them. A group or scene that does not exist has none.
    /// [`CommandError::NoSuchModule`] and [`CommandError::NoSuchPoint`] are about labels.
    fn permitted(self, config: &Config, rights: &Rights) -> Result<(), CommandError> {
        rights.may_command()?;
        if !rights.is_limited() {
            return Ok(());
        }
        let point = |module: &str, point: Point| rights.may_switch_in(config, module, point);
        let place = |place: &Place| point(&place.module, place.point);
        match self {
            Outputs::Point(module, at) => point(module, at),
            Outputs::Label(module, label) => point(module, labelled(config, module, label)?),
            Outputs::OfModule(module, set) => set.iter().try_for_each(|(at, _)| point(module, *at)),
            Outputs::Places(set) => set.iter().try_for_each(|(at, _)| place(at)),
            Outputs::Group(name) => match config.groups.get(name) {
                Some(group) => group.members.iter().try_for_each(place),
                None => Ok(()),
            },
            Outputs::Scene(name) => match config.scenes.get(name) {
                Some(scene) => scene.steps.iter().try_for_each(|step| match step {
                    Step::Set(at, _) => place(at),
                    Step::Wait(_) => Ok(()),
                }),
                None => Ok(()),
            },
        }
    }
}

/// The point of this label, as it is written at the terminal.
fn labelled(config: &Config, module: &str, label: &str) -> Result<Point, CommandError> {
    let described = config
        .modules
        .get(module)
        .ok_or(CommandError::NoSuchModule)?;
    described
        .setup
        .point(label)
        .ok_or(CommandError::NoSuchPoint)
}

impl Service {
    /// Starts a command if this handle's rights cover its outputs by the present configuration,
    /// both as one step. They are asked again for each output when its turn has come
    /// (`State::may_command`), by the configuration of that moment. It goes on if the caller is
    /// gone.
    async fn order<T, F>(
        &self,
        outputs: Outputs<'_>,
        procedure: impl FnOnce(Context, Who) -> F,
    ) -> Result<T, CommandError>
    where
        T: Send + 'static,
        F: Future<Output = Result<T, CommandError>> + Send + 'static,
    {
        let (end, ended) = oneshot::channel();
        let who = self.who.clone();
        self.inner.drive(|core, now| {
            outputs.permitted(core.state(now).site.config(), &self.who.rights)?;
            // Fails where nobody waits any more.
            let end = |value| _ = end.send(value);
            core.start(now, |context| procedure(context, who), end);
            Ok::<(), CommandError>(())
        })?;
        let end = ended.await;
        self.inner.count("hand-overs");
        // There is none only where a procedure has broken down.
        end.unwrap_or_else(|_| Err(Fault::Unknown.into()))
    }

    /// Brings outputs of one module into these states with one command of the line, and leaves
    /// the others alone.
    ///
    /// # Errors
    /// [`CommandError`]; [`CommandError::may_have_acted`] says whether something may have happened
    /// even so.
    pub async fn write(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, CommandError> {
        let (name, asked) = (module.to_owned(), set.to_vec());
        let outputs = Outputs::OfModule(module, set);
        self.order(outputs, |core, who| async move {
            core.write(&who, &name, &asked, terms).await
        })
        .await
    }

    /// The same for the board that had this name in an earlier configuration: for a caller who
    /// knows the outputs by that one.
    ///
    /// # Errors
    /// As [`Service::write`]; [`Fault::Closed`] where the name is another board's by now.
    pub async fn write_since(
        &self,
        since: &Arc<Config>,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, CommandError> {
        let (since, name, asked) = (Arc::clone(since), module.to_owned(), set.to_vec());
        let outputs = Outputs::OfModule(module, set);
        self.order(outputs, |core, who| async move {
            let until = core.expires(terms.within);
            core.write_since(&since, &who, &name, &asked, (terms, until))
                .await
        })
        .await
    }

    /// The same for the output of this label, which is looked up in the step in which the command
    /// begins.
    ///
    /// # Errors
    /// As [`Service::write`].
    pub async fn write_labelled(
        &self,
        (module, label): (&str, &str),
        on: bool,
        terms: WriteTerms,
    ) -> Result<WriteDone, CommandError> {
        let (name, text) = (module.to_owned(), label.to_owned());
        let output = Outputs::Label(module, label);
        self.order(output, |core, who| async move {
            let point = labelled(&core.config(), &name, &text)?;
            core.write(&who, &name, &[(point, on)], terms).await
        })
        .await
    }

    /// Switches an output over. Where it is read first and then set, someone else may come
    /// between.
    ///
    /// # Errors
    /// As [`Service::write`]; [`Fault::Unsupported`] where the model has no such command.
    pub async fn toggle(
        &self,
        module: &str,
        point: Point,
        terms: ToggleTerms,
    ) -> Result<WriteDone, CommandError> {
        let name = module.to_owned();
        self.order(Outputs::Point(module, point), |core, who| async move {
            core.toggle(&who, &name, point, terms).await
        })
        .await
    }

    /// The same for the output of this label, which is looked up in the step in which the command
    /// begins.
    ///
    /// # Errors
    /// As [`Service::toggle`].
    pub async fn toggle_labelled(
        &self,
        (module, label): (&str, &str),
        terms: ToggleTerms,
    ) -> Result<WriteDone, CommandError> {
        let (name, text) = (module.to_owned(), label.to_owned());
        let output = Outputs::Label(module, label);
        self.order(output, |core, who| async move {
            let point = labelled(&core.config(), &name, &text)?;
            core.toggle(&who, &name, point, terms).await
        })
        .await
    }

    /// Gives a pulse; returns when it has begun. One that is timed here is ended by the site,
    /// which also tries again until the output is released, another command takes the
    /// output over, or the site is closed. Its end is written down before it begins
    /// ([`Service::start_in`]), and done after a restart where that comes between.
    ///
    /// # Errors
    /// [`CommandError::PulseWidth`] where the module has no such pulse, or as [`Service::write`].
    /// Where the module may have acted, the output is released all the same.
    pub async fn pulse(
        &self,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, CommandError> {
        let name = module.to_owned();
        self.order(Outputs::Point(module, point), |core, who| async move {
            core.pulse(&who, &name, point, pulse).await
        })
        .await
    }

    /// The same for the output of this label, which is looked up in the step in which the command
    /// begins.
    ///
    /// # Errors
    /// As [`Service::pulse`].
    pub async fn pulse_labelled(
        &self,
        (module, label): (&str, &str),
        pulse: Pulse,
    ) -> Result<PulseDone, CommandError> {
        let (name, text) = (module.to_owned(), label.to_owned());
        let output = Outputs::Label(module, label);
        self.order(output, |core, who| async move {
            let point = labelled(&core.config(), &name, &text)?;
            core.pulse(&who, &name, point, pulse).await
        })
        .await
    }

    /// Waits until all pulses that are timed here have ended.
    pub async fn pulses_ended(&self) {
        self.ask_while(|core| async move { core.all_ended().await })
            .await;
    }

    /// Brings an output into a state and holds it there for a time. Before that time is over it
    /// is to be called again, or the output goes where its policy says (`on_offline`), and
    /// without one into its other state. Another command takes it over.
    ///
    /// # Errors
    /// [`CommandError::LeaseTime`], or as [`Service::write`].
    pub async fn lease(
        &self,
        module: &str,
        point: Point,
        held: (bool, Micros),
        terms: LeaseTerms,
    ) -> Result<Leased, CommandError> {
        let name = module.to_owned();
        self.order(Outputs::Point(module, point), |core, who| async move {
            core.lease(&who, &name, point, held, terms).await
        })
        .await
    }

    /// Gives an output back before its time is over: it goes where it would have gone then.
    /// Nothing comes back where it is to stay as it is.
    ///
    /// # Errors
    /// [`CommandError::NoLease`], or as [`Service::write`].
    pub async fn end_lease(
        &self,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, CommandError> {
        let name = module.to_owned();
        self.order(Outputs::Point(module, point), |core, who| async move {
            core.end_lease(&who, &name, point).await
        })
        .await
    }

    /// Switches outputs of any modules. Those of one module go together; where some of them
    /// exclude each other, what goes off goes before what goes on. Where it is all or nothing,
    /// nobody else commands the outputs meanwhile.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::NotPermitted`]: then none of them was
    /// commanded.
    pub async fn batch(
        &self,
        set: &[(Place, bool)],
        terms: BatchTerms,
    ) -> Result<BatchDone, CommandError> {
        let asked = set.to_vec();
        let done = self.order(Outputs::Places(set), |core, who| async move {
            Ok(core.batch(&who, &asked, terms).await)
        });
        match done.await {
            Err(CommandError::Line(Fault::Unknown)) => Ok(BatchDone::unknown(set)),
            done => done,
        }
    }

    /// Brings a group into a state.
    ///
    /// # Errors
    /// [`CommandError::NoSuchGroup`]; where it is to be toggled, also as [`Service::write`] while
    /// others command it.
    pub async fn set_group(
        &self,
        group: &str,
        to: GroupState,
        terms: BatchTerms,
    ) -> Result<BatchDone, CommandError> {
        let name = group.to_owned();
        self.order(Outputs::Group(group), |core, who| async move {
            core.set_group(&who, &name, to, terms).await
        })
        .await
    }

    /// Plays a scene: its steps in their order, those of one module that follow each other and
    /// go the same way with one command. After a step that fails, nothing more is done: later
    /// ones may rely on it. It is played to its end, whether or not somebody waits.
    ///
    /// # Errors
    /// [`CommandError::NoSuchScene`]; [`CommandError::Playing`] while it is played already.
    pub async fn play(&self, scene: &str, terms: BatchTerms) -> Result<BatchDone, CommandError> {
        let name = scene.to_owned();
        self.order(Outputs::Scene(scene), |core, who| async move {
            core.play(&who, &name, terms).await
        })
        .await
    }

    /// Whether this handle's rights cover the output of this label now.
    ///
    /// # Errors
    /// As [`Service::write_labelled`].
    pub fn may_write(&self, module: &str, label: &str) -> Result<(), CommandError> {
        Outputs::Label(module, label).permitted(&self.config(), &self.who.rights)
    }

    /// Whether this handle's rights cover a group now; one that does not exist has no outputs.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::NotPermitted`].
    pub fn may_set_group(&self, group: &str) -> Result<(), CommandError> {
        Outputs::Group(group).permitted(&self.config(), &self.who.rights)
    }

    /// Whether this handle's rights cover a scene now; one that does not exist has no outputs.
    ///
    /// # Errors
    /// As [`Service::may_set_group`].
    pub fn may_play(&self, scene: &str) -> Result<(), CommandError> {
        Outputs::Scene(scene).permitted(&self.config(), &self.who.rights)
    }

    /// In how many frames these outputs can be brought into one state.
    #[must_use]
    pub fn frames_of(&self, outputs: &[Place]) -> usize {
        self.inner.read(|state| state.frames_of(outputs))
    }

    /// Asks a module for everything now. What it says is known when this returns.
    ///
    /// # Errors
    /// [`CommandError::NoSuchModule`], or what the line said.
    pub async fn read_fresh(&self, module: &str) -> Result<(), CommandError> {
        let module = module.to_owned();
        let read = self.ask_while(|core| async move { core.read_fresh(&module).await });
        read.await.unwrap_or_else(|| Err(Fault::Unknown.into()))
    }
}
