//! What is asked of outputs: each call starts a procedure of the core and waits for its end.

use super::Service;
use crate::Failure;
use crate::config::Place;
use crate::core::{
    BatchDone, BatchTerms, GroupState, Leased, Pulse, PulseDone, ToggleTerms, WriteDone, WriteTerms,
};
use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;

impl Service {
    /// Brings outputs of one module into these states with one command of the line, and leaves
    /// the others alone.
    ///
    /// # Errors
    /// [`Failure`]; [`Failure::may_have_acted`] says whether something may have happened even
    /// so.
    pub async fn write(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, Failure> {
        let (module, set) = (module.to_owned(), set.to_vec());
        self.order(|core, who| async move { core.write(&who, &module, &set, terms).await })
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
    ) -> Result<WriteDone, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.toggle(&who, &module, point, terms).await })
            .await
    }

    /// Gives a pulse; returns when it has begun. One that is timed here is ended by the site,
    /// which also tries again until the output is released, another command takes the
    /// output over, or the site is closed. Its end is written down before it begins
    /// ([`Service::start_in`]), and done after a restart where that comes between.
    ///
    /// # Errors
    /// [`Failure::PulseWidth`] where the module has no such pulse, or as [`Service::write`].
    /// Where the module may have acted, the output is released all the same.
    pub async fn pulse(
        &self,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.pulse(&who, &module, point, pulse).await })
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
    /// [`Failure::LeaseTime`], or as [`Service::write`].
    pub async fn lease(
        &self,
        module: &str,
        point: Point,
        held: (bool, Micros),
        confirm: bool,
    ) -> Result<Leased, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.lease(&who, &module, point, held, confirm).await })
            .await
    }

    /// Gives an output back before its time is over: it goes where it would have gone then.
    /// Nothing comes back where it is to stay as it is.
    ///
    /// # Errors
    /// [`Failure::NoLease`], or as [`Service::write`].
    pub async fn end_lease(
        &self,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, Failure> {
        let module = module.to_owned();
        self.order(|core, who| async move { core.end_lease(&who, &module, point).await })
            .await
    }

    /// Switches outputs of any modules. Those of one module go together; where some of them
    /// exclude each other, what goes off goes before what goes on. Where it is all or nothing,
    /// nobody else commands the outputs meanwhile.
    pub async fn batch(&self, set: &[(Place, bool)], terms: BatchTerms) -> BatchDone {
        let asked = set.to_vec();
        let end = self.ask(|core, who| async move { core.batch(&who, &asked, terms).await });
        end.await.unwrap_or_else(|| BatchDone::unknown(set))
    }

    /// Brings a group into a state.
    ///
    /// # Errors
    /// [`Failure::NoSuchGroup`]; where it is to be toggled, also as [`Service::write`] while
    /// others command it.
    pub async fn set_group(
        &self,
        group: &str,
        to: GroupState,
        terms: BatchTerms,
    ) -> Result<BatchDone, Failure> {
        let group = group.to_owned();
        self.order(|core, who| async move { core.set_group(&who, &group, to, terms).await })
            .await
    }

    /// Plays a scene: its steps in their order, those of one module that follow each other and
    /// go the same way with one command. After a step that fails, nothing more is done: later
    /// ones may rely on it. It is played to its end, whether or not somebody waits.
    ///
    /// # Errors
    /// [`Failure::NoSuchScene`]; [`Failure::Playing`] while it is played already.
    pub async fn play(&self, scene: &str, terms: BatchTerms) -> Result<BatchDone, Failure> {
        let scene = scene.to_owned();
        self.order(|core, who| async move { core.play(&who, &scene, terms).await })
            .await
    }

    /// In how many frames these outputs can be brought into one state.
    #[must_use]
    pub fn frames_of(&self, outputs: &[Place]) -> usize {
        self.inner.read(|state| state.frames_of(outputs))
    }

    /// Asks a module for everything now. What it says is known when this returns.
    ///
    /// # Errors
    /// [`Failure::NoSuchModule`], or what the line said.
    pub async fn read_fresh(&self, module: &str) -> Result<(), Failure> {
        let module = module.to_owned();
        let read = self.ask_while(|core| async move { core.read_all(&module).await });
        read.await.unwrap_or_else(|| Err(Fault::Unknown.into()))
    }
}
